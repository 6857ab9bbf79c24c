"""The state at γ = 0 of a strain path, from a critical configuration, a state of springs, or a solution with one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from critflow.arguments import held, shown
from critflow.critical.backbone import backbone
from critflow.critical.edge_lengths import COLLAPSED
from critflow.critical.manifold import CriticalConfiguration
from critflow.extensions import extensible, provided
from critflow.linalg.factor import FixedPattern
from critflow.networks.deformation import Deformation
from critflow.networks.network import Array
from critflow.result import InputError, Solution, Status
from critflow.springs.laws import HOOKEAN, SpringLaw, checked_law
from critflow.springs.state import SpringState

# Largest force of a state from which a path starts, in units of stiffness times length: the first relaxation removes
# rounding, and a larger force would hide a jump.
BALANCED_START = 1e-6

_ADVICE = "CriticalManifold(network).configuration(sigma) or optimize(network, 'B_0') makes one"
_OF_STRESS = "change its stress, or remove it"

Start = Any
"""What a path starts from: each kind of which `start_of` knows the springs, or a solution with one."""


@dataclass(frozen=True, eq=False)
class Beginning:
    """Springs at γ = 0.

    stress   tension over length of each spring at a transition, σ (N_b,) or T/p (N_f,); None for a state of springs
    part     whether they are a part of the network, whose slack edges were left out
    pattern  of the Hessian, where the manifold of the start has it
    total_strains  strains (n,) of the network as given, of strains (n,) along a path from here; None: the same
    """

    springs: SpringState
    stress: Array | None = None
    part: bool = False
    note: str = ""
    pattern: FixedPattern | None = None
    total_strains: Callable[[Deformation, Array], Array] | None = None


@extensible
def start_of(start: Start, law: SpringLaw | None, taut_only: bool) -> Beginning:
    """The springs from which a path starts, with the stress of a transition; `InputError` for other kinds."""
    known = held(start, (CriticalConfiguration, SpringState))
    if known is not None:
        return start_of(known, law, taut_only)
    kinds, advice = "a CriticalConfiguration or a SpringState or a Solution", getattr(start, "alone", "") or _ADVICE
    raise InputError(f"start must be {kinds}, not {shown(start)}: {advice}")


@start_of.register
def _(start: Solution, law: SpringLaw | None, taut_only: bool) -> Beginning:
    """That of the value; slack edges are no failure."""
    if start.status is not Status.slack_edges:
        start.or_raise("no path starts from this solution")
    return start_of(start.value, law, taut_only)


@start_of.register
def _(start: CriticalConfiguration, law: SpringLaw | None, taut_only: bool) -> Beginning:
    """Springs at rest: all edges, or the taut ones; cables where rest lengths are known."""
    if start.rest_lengths is not None and not taut_only:
        return provided("cables_at_onset", "paths of cables")(start, start.rest_lengths, law)
    require_directions((start.lengths <= COLLAPSED * start.lengths.mean()) & (start.sigma != 0), _OF_STRESS)
    part, note = start, ""
    if not start.sigma.all():
        part, n_slack = backbone(start).configuration, int(np.count_nonzero(start.sigma == 0))
        note = f"{n_slack} of {len(start.sigma)} edges are slack, so the path is that of the taut part alone"
    law = checked_law(HOOKEAN if law is None else law, part.lengths, part.network.stiffness)
    springs = SpringState(part.network, part.lengths, part.coordinates, part.bond_vectors, law)
    if part is not start:
        return Beginning(springs, part.sigma, True, note)
    # A solver that was chosen for the manifold may not serve the Hessian.
    shared = start.maker is not None and start.maker.backend == "auto"
    return Beginning(springs, part.sigma, pattern=start.manifold.hessian if shared else None)


@start_of.register
def of_state(state: SpringState, law: SpringLaw | None, taut_only: bool) -> Beginning:
    """A state of springs, which has its own law and all of its edges."""
    if law is not None and law != state.law:
        raise InputError("the state has a spring law: leave out law=, or make a state with the other law")
    if taut_only:
        raise InputError("a state of springs has no slack part to leave out: taut_only belongs to a configuration")
    require_directions(state.lengths == 0, "move its ends apart")
    return Beginning(state)


def require_directions(short: NDArray[np.bool_], instead: str) -> None:
    """`InputError` where an edge of these (N_b,) has no length."""
    if short.any():
        raise InputError(f"edge {int(short.argmax())} has no length, so its spring has no direction: {instead}")


def balanced(springs: SpringState) -> bool:
    """Whether the forces of springs vanish but for rounding."""
    return springs.max_force <= BALANCED_START * springs.stiffness_scale * springs.length_scale
