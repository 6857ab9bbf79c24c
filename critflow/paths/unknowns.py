"""The unknowns of a strain path, chosen once for each path: the vertices, or what an extra adds to them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from critflow.extensions import provided
from critflow.linalg.factor import FixedPattern
from critflow.networks.deformation import Deformation
from critflow.networks.network import Array, Network
from critflow.paths.continuation import Cell, Correction, Interval, PathPoint, PathProblem, Unknowns, begin, refused
from critflow.paths.start import Beginning, balanced
from critflow.paths.tangent import Tangent
from critflow.result import InputError, Status
from critflow.springs.equilibrium import LOOSEST_TOLERANCE, relaxed
from critflow.springs.state import SpringState

NONE_FREE = np.zeros(0)  # q of a cell without free components
LOOSENING_WORK = 1e-9  # work of a strain on the stress of a transition, relative to its size, below which it loosens
_LOOSENED = "the strain loosens the network, which is floppy on this side of the transition: change its sign"


def unknowns_of(
    springs: SpringState, deformation: Deformation, gamma: Array, pattern: FixedPattern, method: str, tolerance: float
) -> Unknowns:
    """The vertices, with the free components of a cell that has some, and as cables demand it if springs are cables.

    Raises `InputError` where a strain γ inverts the cell.
    Raises `InputError` where the extra with one of these is not installed.
    """
    kind = provided("free_cell_unknowns", "free components of the cell") if deformation.free else Vertices
    # Predictions for springs are within reach of the last correction of Newton's method.
    rough = method == "newton" and not springs.law.one_sided and not deformation.free
    gradients = {strain: deformation.gradient(strain) for strain in gamma.tolist()}
    vertices = kind(
        *(springs.network, deformation, gradients, pattern, method),
        LOOSEST_TOLERANCE if rough else tolerance,
    )
    return provided("cable_unknowns", "paths of cables")(vertices) if springs.law.one_sided else vertices


@dataclass(frozen=True, eq=False)
class Vertices:
    """The coordinates y (n_free, d) that move with the cell, x = F(γ) y: the `Unknowns` of springs.

    gradients          F (d, d) of the strains of the path
    method, tolerance  of `relaxed`
    """

    reference: Network
    deformation: Deformation
    gradients: dict[float, Array]
    pattern: FixedPattern
    method: str
    tolerance: float

    def cell(self, strain: float, free: Array | None = None) -> Cell:
        """The cell F(γ)."""
        return Cell(strain, self.gradient(strain), NONE_FREE)

    def gradient(self, strain: float) -> Array:
        """F(γ), (d, d)."""
        F = self.gradients.get(strain)
        return self.deformation.gradient(strain) if F is None else F

    def point(self, state: SpringState, cell: Cell) -> Array:
        """y, (n_free·d,)."""
        return np.asarray(state.coordinates[state.network.free_rows] @ cell.inverse.T).ravel()

    def velocity(self, along: Tangent, cell: Cell) -> Array:
        """dy/dγ, (n_free·d,)."""
        return np.asarray(along.relaxation @ cell.inverse.T).ravel()

    def predicted(
        self, state: SpringState, here: Cell, strain: float, change: Array, stress: Array | None = None
    ) -> tuple[SpringState, Cell]:
        """The state after a change of y (n_free·d,) and the affine motion to another cell."""
        cell = self.cell(strain)
        return self.moved(state, here, cell, change), cell

    def moved(self, state: SpringState, here: Cell, cell: Cell, change: Array) -> SpringState:
        """A state in a cell after a change of y (n_free·d,) and the affine motion to another."""
        before, after = here.gradient, cell.gradient
        displacement = change.reshape(-1, len(before)) @ before.T
        return state.deformed_to(self.reference.deformed(after), after @ here.inverse, displacement)

    def corrected(self, start: SpringState, cell: Cell) -> Correction:
        """The equilibrium from a prediction."""
        solution, factor = relaxed(start, self.pattern, self.method, self.tolerance, condition=False)
        # FIRE at its step limit gains nothing from smaller strain steps.
        limited = self.method == "fire" and solution.status is Status.step_limit
        return Correction(solution, factor, cell, retry_smaller=not limited)

    def rates(self, cell: Cell) -> tuple[Array, Array]:
        """F'F⁻¹ and F''F⁻¹, (1, d, d)."""
        velocity = self.deformation.rate(cell.strain) @ cell.inverse
        return velocity[None], (self.deformation.second_rate(cell.strain) @ cell.inverse)[None]

    def beginning(self, problem: PathProblem, first: Beginning, gamma: Array) -> tuple[list[Interval], PathPoint]:
        """A transition, or springs relaxed at γ = 0: an end where they are not, or where γ loosens a transition."""
        springs, stress = first.springs, first.stress
        if stress is None and not balanced(springs):
            raise InputError(
                f"the springs are not in equilibrium, a force of {springs.max_force:.2g} is left: call equilibrium() "
                "first"
            )
        start = begin(problem, springs, stress)
        if stress is None:
            return [start] if gamma[0] == 0 or not start.end.ok else [], start.point
        if loosened(springs, stress, self.deformation, gamma[0]):
            return [refused(start.point, gamma[0], Status.floppy, _LOOSENED)], start.point
        return [], start.point


def loosened(springs: SpringState, stress: Array, deformation: Deformation, strain: float) -> bool:
    """Whether a strain of this sign loosens a network in tension, which is then floppy: γ Σ σ L·A L < 0."""
    sigma = springs.edge_tension(stress * springs.spring_lengths) / springs.lengths
    L, A = springs.bond_vectors, np.copysign(1.0, strain) * deformation.velocity(0.0)
    work, size = np.sum(sigma[:, None] * L * (L @ A.T)), np.linalg.norm(A) * np.sum(sigma * springs.lengths**2)
    return bool((sigma >= 0).all() and work < -LOOSENING_WORK * size)
