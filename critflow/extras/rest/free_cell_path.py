"""Strain paths in a cell with free components: unknowns z = (y, q) of vertices x = (1 + Σ_m q_m E_m) F(γ) y.

With S = 1 + Σ q E and A = F'F⁻¹ the strain γ and the free components have the rates S A S⁻¹ and E_m S⁻¹, and the second
derivatives by γ and each are S F''F⁻¹ S⁻¹ and E_m A S⁻¹.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from critflow.extras.rest.free_cell import FreeCellState, relaxed_with_cell, stretched
from critflow.networks import Array
from critflow.paths import FLOPPY, Cell, Correction, Tangent, Vertices, keeps_lengths, weakly_stressed
from critflow.result import InputError, Status
from critflow.springs import SpringState


@dataclass(frozen=True, eq=False)
class FreeCell(Vertices):
    """The vertices and the free components q (m,) of the cell, by Newton's method; else an `InputError`."""

    def __post_init__(self) -> None:
        if self.method != "newton":
            raise InputError("free components of the cell need Newton's method: method='newton'")

    @cached_property
    def strains(self) -> Array:
        """E, (m, d, d)."""
        return self.deformation.free_strains

    def cell(self, strain: float, free: Array | None = None) -> Cell:
        """The cell (1 + Σ q E) F(γ)."""
        q = np.zeros(len(self.strains)) if free is None else free
        return Cell(strain, stretched(q, self.strains) @ self.gradient(strain), q)

    def point(self, state: SpringState, cell: Cell) -> Array:
        """(y, q), (n_free·d + m,)."""
        return np.concatenate([super().point(state, cell), cell.free])

    def velocity(self, along: Tangent, cell: Cell) -> Array:
        """The rate of (y, q), (n_free·d + m,)."""
        return np.concatenate([super().velocity(along, cell), along.free_rate])

    def predicted(
        self, state: SpringState, here: Cell, strain: float, change: Array, stress: Array | None = None
    ) -> tuple[SpringState, Cell]:
        """The state after a change of (y, q) and the affine motion to another cell; of y alone where q inverts it."""
        n, q = len(change) - len(here.free), here.free
        moved = q + change[n:]
        cell = self.cell(strain, moved if np.linalg.det(stretched(moved, self.strains)) > 0 else q)
        return self.moved(state, here, cell, change[:n]), cell

    def corrected(self, start: SpringState, cell: Cell) -> Correction:
        """The equilibrium of vertices and cell; `Status.floppy` where springs keep their lengths in some cell."""
        strain, F = cell.strain, self.gradient(cell.strain)
        free = FreeCellState(start, cell.free, self.strains)
        solution, factor, q = relaxed_with_cell(free, self.reference, F, self.pattern, self.tolerance)
        cell = self.cell(strain, q)
        # The energy of cables is convex: in a floppy cell smaller steps gain nothing.
        retry_smaller = not (solution.status is Status.floppy and solution.value.unique)
        if solution.status is Status.ill_conditioned and weakly_stressed(solution.value, strain):
            # Nearly balanced stresses remain that the tolerance of the forces hides, though all lengths can be kept.
            near = FreeCellState(solution.value, q, self.strains).near_rest(self.pattern)
            if keeps_lengths(near.springs, strain):
                solution = replace(solution, status=Status.floppy, note=FLOPPY.format(strain))
                retry_smaller = False
        return Correction(solution, factor, cell, retry_smaller)

    def rates(self, cell: Cell) -> tuple[Array, Array]:
        """Rates and second derivatives of the module, (1 + m, d, d)."""
        back = np.linalg.inv(self.gradient(cell.strain))
        velocity = self.deformation.rate(cell.strain) @ back
        acceleration = self.deformation.second_rate(cell.strain) @ back
        E, S = self.strains, stretched(cell.free, self.strains)
        G = np.linalg.inv(S)
        rates = np.concatenate([(S @ velocity @ G)[None], E @ G])
        return rates, np.concatenate([(S @ acceleration @ G)[None], E @ velocity @ G])
