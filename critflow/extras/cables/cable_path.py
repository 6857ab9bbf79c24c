"""Strain paths of cables: floppy vertices are placed before each correction, and a path may begin before its onset.

The energy of cables of a convex law is convex: every equilibrium is the global minimum, on the one branch
(`SpringState.unique`).  Corrections end on kinks of the energy, where cables are just tight: Newton's method iterates
to the tolerance of the forces, since the last correction alone does not reach across a kink.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from critflow.extras.cables.floppy import unstressed_part
from critflow.extras.cables.slack import with_slack_placed
from critflow.networks import Array
from critflow.paths import Beginning, Cell, Correction, Interval, PathPoint, PathProblem, Tangent, Unknowns
from critflow.springs import SpringState


@dataclass(frozen=True, eq=False)
class Cables:
    """The unknowns of a path of springs, for cables: `unknowns` of the vertices, or of a free cell too."""

    unknowns: Unknowns

    def cell(self, strain: float, free: Array | None = None) -> Cell:
        return self.unknowns.cell(strain, free)

    def point(self, state: SpringState, cell: Cell) -> Array:
        return self.unknowns.point(state, cell)

    def velocity(self, along: Tangent, cell: Cell) -> Array:
        return self.unknowns.velocity(along, cell)

    def rates(self, cell: Cell) -> tuple[Array, Array]:
        return self.unknowns.rates(cell)

    def predicted(
        self, state: SpringState, here: Cell, strain: float, change: Array, stress: Array | None = None
    ) -> tuple[SpringState, Cell]:
        """The state after a change, with floppy vertices among slack cables placed where none of these is tight."""
        start, cell = self.unknowns.predicted(state, here, strain, change, stress)
        return with_slack_placed(start, state.sigma if stress is None else stress), cell

    def corrected(self, start: SpringState, cell: Cell) -> Correction:
        """The equilibrium from a prediction, from a second one where corrections do not converge on kinks."""
        correction = self.unknowns.corrected(start, cell)
        solution = correction.solution
        # In a free cell a correction fails where no stress fixes the cell.
        if solution.ok or len(cell.free):
            return correction
        placed = with_slack_placed(solution.value, solution.value.sigma)
        if placed is solution.value:
            return correction
        again = self.unknowns.corrected(placed, cell)
        steps = solution.stats.steps + again.solution.stats.steps
        return again._replace(solution=replace(again.solution, stats=replace(again.solution.stats, steps=steps)))

    def beginning(self, problem: PathProblem, first: Beginning, gamma: Array) -> tuple[list[Interval], PathPoint]:
        """The strains below the onset of cables that are floppy at γ = 0, which have no stress, and the onset."""
        floppy = unstressed_part(problem, first.springs, gamma) if first.stress is None else None
        return self.unknowns.beginning(problem, first, gamma) if floppy is None else floppy
