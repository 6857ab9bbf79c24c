"""Strain paths in a cell with free components: unknowns z = (y, q) of vertices x = (1 + Σ_m q_m E_m) F(γ) y.

With S = 1 + Σ q E and A = F'F⁻¹ the strain γ and the free components have the rates S A S⁻¹ and E_m S⁻¹, and the second
derivatives by γ and each are S F''F⁻¹ S⁻¹ and E_m A S⁻¹.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from critflow.deformation import Deformation
from critflow.manifold import CriticalConfiguration
from critflow.networks import Array
from critflow.paths import NONE_FREE, Path, PathPoint, keeps_lengths, weakly_stressed
from critflow.result import InputError, Status
from critflow.sparse import Factor
from critflow_extras.rest.free_cell import FreeCellState, relaxed_with_cell, stretched


class FreeCellPath(Path):
    """The path of the vertices and the free components q (m,) of the cell, by Newton's method; else an `InputError`."""

    def __init__(self, *arguments: Any):
        super().__init__(*arguments)
        if self.method != "newton":
            raise InputError("free components of the cell need Newton's method: method='newton'")
        self.free_strains = self.deformation.free_strains

    def gradient(self, strain: float, free: Array = NONE_FREE) -> Array:
        """(1 + Σ q E) F(γ), with q = 0 where it is not given."""
        F = super().gradient(strain)
        return stretched(free, self.free_strains) @ F if len(free) else F

    def unknowns(self, point: PathPoint) -> Array:
        """(y, q), (n_free·d + m,)."""
        return np.concatenate([super().unknowns(point), point.free])

    def velocity(self, point: PathPoint, relaxation: Array, along: Array) -> Array:
        """The rate of (y, q), (n_free·d + m,)."""
        return np.concatenate([super().velocity(point, relaxation, along), along[1:]])

    def moved(self, here: PathPoint, strain: float, change: Array, free: Array = NONE_FREE) -> PathPoint:
        """The point after a change of (y, q) and the affine motion to another cell; of y alone where q inverts it."""
        n, q = len(change) - len(here.free), here.free
        free = q + change[n:]
        inverted = not np.linalg.det(stretched(free, self.free_strains)) > 0
        return super().moved(here, strain, change[:n], q if inverted else free)

    def corrected(self, start: PathPoint) -> tuple[PathPoint, Factor | None]:
        """The equilibrium of vertices and cell; `Status.floppy` where springs keep their lengths in some cell."""
        strain, F = start.strain, super().gradient(start.strain)
        state = FreeCellState(start.state, start.free, self.free_strains)
        solution, factor, q = relaxed_with_cell(state, self.network, F, self.tolerance)
        # The energy of cables is convex: in a floppy cell smaller steps gain nothing.
        final = solution.status is Status.floppy and solution.value.unique
        end = replace(start.relaxed_to(solution, final), gradient=self.gradient(strain, q), free=q)
        if end.status is Status.ill_conditioned and weakly_stressed(end.state, F):
            # Nearly balanced stresses remain that the tolerance of the forces hides, though all lengths can be kept.
            near = FreeCellState(end.state, q, self.free_strains).near_rest()
            if keeps_lengths(near.springs, F):
                end = self.floppy(end)
        return end, factor

    def rates(self, point: PathPoint, path: Deformation | None = None) -> tuple[Array, Array]:
        """Rates and second derivatives of the module, (1 + m, d, d)."""
        path = path or self.deformation
        back = np.linalg.inv(super().gradient(point.strain))
        velocity = path.rate(point.strain) @ back
        acceleration = path.second_rate(point.strain) @ back
        E, S = self.free_strains, stretched(point.free, self.free_strains)
        G = np.linalg.inv(S)
        rates = np.concatenate([(S @ velocity @ G)[None], E @ G])
        return rates, np.concatenate([(S @ acceleration @ G)[None], E @ velocity @ G])

    def along(self, E: Array) -> Array:
        """(1, q̇); free components that no stress resists do not follow."""
        return np.concatenate([[1.0], -np.linalg.lstsq(E[1:, 1:], E[1:, 0], rcond=None)[0]])


def relaxing_component(critical: CriticalConfiguration, path: Deformation) -> str:
    """Which free component of the cell relaxes the self-stress, as a sentence; `InputError` where none does."""
    sigma, L = critical.sigma, critical.bond_vectors
    stress = (sigma[:, None] * L).T @ L
    works = np.abs(np.einsum("mij,ij->m", path.free_strains, stress))
    if works.max() > 1e-9 * np.linalg.norm(stress):
        free = path.free[int(works.argmax())]
        return (
            f"the free component {free} of the cell relaxes the only self-stress, so the network is floppy along this "
            "path at the transition: fix the cell, or follow strain_path() from a rigid state"
        )
    raise InputError(
        "the free components of the cell do not relax the self-stress: fix the cell, or use strain_path() and fit its "
        "moduli"
    )
