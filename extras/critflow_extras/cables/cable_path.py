"""Strain paths of cables: floppy vertices are placed before each correction, and a path may begin before its onset.

The energy of cables of a convex law is convex: every equilibrium is the global minimum, on the one branch
(`SpringState.unique`).  Corrections end on kinks of the energy, where cables are just tight: Newton's method iterates
to the tolerance of the forces, since the last correction alone does not reach across a kink.
"""

from __future__ import annotations

from dataclasses import replace

from critflow.networks import Array
from critflow.paths import NONE_FREE, Path, PathPoint
from critflow.sparse import Factor
from critflow.springs import SpringState
from critflow_extras.cables.floppy import unstressed_part
from critflow_extras.cables.slack import with_slack_placed


def cable_path(springs: type[Path]) -> type[Path]:
    """The class of a path of cables, from that of springs, such as one in a free cell."""
    return type(f"Cable{springs.__name__}", (CablePath, springs), {})


class CablePath(Path):
    """What cables change in a path of springs, of the vertices or of a free cell too."""

    within_reach = False

    def begin(self, springs: SpringState) -> list[PathPoint]:
        """The strains below the onset of cables that are floppy at γ = 0, which have no stress, and the onset."""
        floppy = unstressed_part(self, springs) if self.stress is None else None
        return super().begin(springs) if floppy is None else floppy

    def moved(self, here: PathPoint, strain: float, change: Array, free: Array = NONE_FREE) -> PathPoint:
        """The point after a change, with floppy vertices among slack cables placed where none of these is tight."""
        start = super().moved(here, strain, change, free)
        sigma = here.state.sigma if self.stress is None else self.stress
        return replace(start, state=with_slack_placed(start.state, sigma))

    def corrected(self, start: PathPoint) -> tuple[PathPoint, Factor | None]:
        """The equilibrium from a prediction, from a second one where corrections do not converge on kinks."""
        end, factor = super().corrected(start)
        # In a free cell a correction fails where no stress fixes the cell.
        if end.ok or len(end.free):
            return end, factor
        placed = with_slack_placed(end.state, end.state.sigma)
        if placed is end.state:
            return end, factor
        again, factor = super().corrected(replace(start, state=placed))
        return replace(again, steps=end.steps + again.steps), factor
