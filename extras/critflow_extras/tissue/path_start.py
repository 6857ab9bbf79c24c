"""Strain paths of tissues: the springs on the perimeters of a critical configuration, at rest there."""

from __future__ import annotations

from critflow.manifold import COLLAPSED
from critflow.paths import Beginning, of_state, start_of
from critflow.result import InputError
from critflow.springs import SpringLaw, require_directions
from critflow_extras.tissue.tissue import CriticalTissue


@start_of.register
def _(tissue: CriticalTissue, law: SpringLaw | None, taut_only: bool) -> Beginning:
    """All perimeters, at rest, with their tensions."""
    if not (tissue.face_tensions > 0).all():
        slack = int(tissue.face_tensions.argmin())
        raise InputError(f"face {slack} has no tension, so its perimeter is not determined: narrow their spread")
    state = tissue.at_rest()
    require_directions(state.lengths <= COLLAPSED * state.lengths.mean(), "increase the perimeters of its faces")
    of_state(state, law, taut_only)
    return state, tissue.face_tensions / state.spring_lengths, "", None
