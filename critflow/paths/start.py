"""The state at γ = 0 of a strain path, from a critical configuration, a state of springs, or a solution with one."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from critflow.critical.backbone import backbone
from critflow.critical.edge_lengths import COLLAPSED
from critflow.critical.manifold import CriticalConfiguration
from critflow.extras.tissue.tissue import CriticalTissue
from critflow.networks.network import Array
from critflow.result import InputError, Solution, Status
from critflow.springs.laws import HOOKEAN, Cable, SpringLaw, checked_law
from critflow.springs.state import SpringState

# Largest force of a state from which a path starts, in units of stiffness times length: the first relaxation removes
# rounding, and a larger force would hide a jump.
BALANCED_START = 1e-6
CONSISTENT_LENGTHS = (
    1e-6  # relative deviation of the lengths of taut edges from their rest lengths; solutions have 1e-9
)
OPENING = 1e-3  # displacements of floppy vertices that give collapsed slack edges a direction, in units of ⟨ℓ⟩

Start = CriticalConfiguration | CriticalTissue | SpringState | Solution[Any]
"""What a path starts from."""


@dataclass(frozen=True, eq=False)
class Beginning:
    """Springs at γ = 0.

    stress  tension over length of each spring at a transition, σ (N_b,) or T/p (N_f,); None for a state of springs
    part    whether they are a part of the network, whose slack edges were left out
    """

    springs: SpringState
    stress: Array | None = None
    part: bool = False
    note: str = ""


def start_of(start: Start, law: SpringLaw | None, taut_only: bool) -> Beginning:
    """The springs from which a path starts, with the stress of a transition."""
    while isinstance(start, Solution):
        if start.status is not Status.slack_edges:
            start.or_raise("no path starts from this solution")
        value: Any = start.value
        start = value if isinstance(value, CriticalTissue) else getattr(value, "configuration", value)
    if isinstance(start, CriticalTissue):
        return _of_tissue(start, law, taut_only)
    if isinstance(start, SpringState):
        return _of_state(start, law, taut_only)
    if not isinstance(start, CriticalConfiguration):
        raise InputError(f"a path starts from a critical configuration or a state of springs, not {start!r:.60}")
    if start.rest_lengths is not None and not taut_only:
        return _of_cables(start, start.rest_lengths, law)
    short = (start.lengths <= COLLAPSED * start.lengths.mean()) & (start.sigma != 0)
    _require_directions(short, "change its stress, or remove it")
    part, note = start, ""
    if not start.sigma.all():
        part, n_slack = backbone(start).configuration, int(np.count_nonzero(start.sigma == 0))
        note = f"{n_slack} of {len(start.sigma)} edges are slack, so the path is that of the taut part alone"
    law = checked_law(HOOKEAN if law is None else law, part.lengths, part.network.stiffness)
    springs = SpringState(part.network, part.lengths, part.coordinates, part.bond_vectors, law)
    return Beginning(springs, part.sigma, part is not start, note)


def _of_state(state: SpringState, law: SpringLaw | None, taut_only: bool) -> Beginning:
    """A state of springs, which has its own law and all of its edges."""
    if law is not None and law != state.law:
        raise InputError("the state has a spring law: leave out law=, or make a state with the other law")
    if taut_only:
        raise InputError("a state of springs has no slack part to leave out: taut_only belongs to a configuration")
    _require_directions(state.lengths == 0, "move its ends apart")
    return Beginning(state)


def _of_tissue(tissue: CriticalTissue, law: SpringLaw | None, taut_only: bool) -> Beginning:
    """The springs on the perimeters of a critical configuration, at rest there."""
    if not (tissue.face_tensions > 0).all():
        slack = int(tissue.face_tensions.argmin())
        raise InputError(f"face {slack} has no tension, so its perimeter is not determined: narrow their spread")
    state = tissue.at_rest()
    _require_directions(state.lengths <= COLLAPSED * state.lengths.mean(), "increase the perimeters of its faces")
    return replace(_of_state(state, law, taut_only), stress=tissue.face_tensions / state.spring_lengths)


def _require_directions(short: NDArray[np.bool_], instead: str) -> None:
    """`InputError` where an edge of these (N_b,) has no length."""
    if short.any():
        raise InputError(f"edge {int(short.argmax())} has no length, so its spring has no direction: {instead}")


def balanced(springs: SpringState) -> bool:
    """Whether the forces of springs vanish but for rounding."""
    return springs.max_force <= BALANCED_START * springs.stiffness_scale * springs.length_scale


def _of_cables(critical: CriticalConfiguration, rest: Array, law: SpringLaw | None) -> Beginning:
    """All edges of an onset as cables: taut ones at rest, slack ones below their rest lengths."""
    taut, law = critical.sigma != 0, Cable() if law is None else law
    if not (law.one_sided or taut.all()):
        raise InputError(
            "slack springs would be compressed at this configuration: choose law=Cable(), or taut_only=True, or relax "
            "a spring_state with equilibrium() and start from it"
        )
    if not np.abs(critical.lengths[taut] / rest[taut] - 1).max() <= CONSISTENT_LENGTHS:
        raise InputError("the taut edges do not have these rest lengths: give those of which the configuration is made")
    if not (critical.lengths > COLLAPSED * critical.lengths.mean()).all():
        critical = _opened(critical, float(rest.mean()))
    rest = np.where(taut, critical.lengths, rest)
    law = checked_law(law, rest, critical.network.stiffness)
    return Beginning(
        SpringState(critical.network, rest, critical.coordinates, critical.bond_vectors, law), critical.sigma
    )


def _opened(critical: CriticalConfiguration, length: float) -> CriticalConfiguration:
    """The configuration with its floppy vertices displaced a little, so that every slack edge has a direction."""
    network, floppy = critical.network, backbone(critical).floppy_vertices
    x = critical.coordinates.copy()
    x[floppy] += OPENING * length * np.random.default_rng(0).standard_normal((len(floppy), network.dimension))
    x = x if network.pins else x - x[0]
    L = np.where((critical.sigma != 0)[:, None], critical.bond_vectors, network.bond_vectors(x))
    lengths = np.linalg.norm(L, axis=1)
    if not (lengths > COLLAPSED * lengths.mean()).all():
        raise InputError(
            f"the slack edge {int(lengths.argmin())} joins two vertices of the taut part at one place, so it has no "
            "direction: vary the rest lengths a little, or follow the taut part with taut_only=True"
        )
    return replace(critical, coordinates=x, bond_vectors=L)
