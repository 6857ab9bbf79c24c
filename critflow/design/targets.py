"""Design for targets: a configuration or a state with requested properties, or the reason why it does not exist.

    minimise  preference(z)  subject to  l_i ≤ O_i(z) ≤ u_i.
There are many variables z and few targets O_i, so feasible ones have many solutions and the preference selects one.
All gradients are exact.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from critflow.arguments import checked
from critflow.critical.manifold import CriticalConfiguration, CriticalManifold
from critflow.critical.pressures import PressurisedConfiguration
from critflow.design.faces import FaceAmplitudes
from critflow.design.limits import Target, edge_limits, parse_targets
from critflow.design.pressures import StressesAndPressures
from critflow.design.problem import TargetProblem, preference_of
from critflow.design.rest_lengths import RestLengths
from critflow.design.result import Achieved, Design, cosines
from critflow.design.stiffnesses import Stiffnesses
from critflow.design.stresses import Stresses
from critflow.design.variables import Variables, require_unused
from critflow.networks.network import Network
from critflow.result import InputError, Stats, Status
from critflow.solvers.constrained import Minimum, minimise_constrained
from critflow.springs.state import SpringState

CHANGES = ("stress", "stiffness", "faces", "rest_lengths", "pressures")


@checked
def design(
    start: Network | CriticalManifold | CriticalConfiguration | PressurisedConfiguration | SpringState,
    targets: Mapping[Any, Any],
    *,
    change: str = "stress",
    prefer: str | CriticalConfiguration | ArrayLike = "least_change",
    within: Mapping[str, Any] | None = None,
    signs: str | ArrayLike | None = None,
    free: ArrayLike | None = None,
    initial: ArrayLike | None = None,
    max_steps: int = 300,
    throw: bool = True,
) -> Design[Any]:
    """The configuration or state with requested properties that a preference selects.

    start    what is changed: a network or a configuration (stress, pressures), a configuration (faces), a state
             (stiffness, rest_lengths)
    targets  name or `Quantity` → value, (low, high), or "largest" or "smallest" for one of them
    change   "stress": the configuration follows the stress; quantities are those of the transition
             "stiffness": springs at rest at the coordinates of a state; moduli and components "C_xxxx", ...
             "faces": lengths at a constant force network, which keeps S, D and every modulus at the transition
             "rest_lengths": of cables, for "onset[simple_shear]", ... at strains other than zero
             "pressures": positive stresses and pressures in the faces, for lengths, areas, V_L and V_tau
    prefer   "least_change" from the start; for stress also "V_L", "V_tau", or a configuration or coordinates (N_v, d)
             to be near to; for rest lengths also "ratios": one factor for all
    within   limits (low, high), each a number, one an edge, or None: of "lengths", of "tensions" and "force_densities"
             in units of their mean (stress), of "lengths" (faces), of "stiffnesses" (stiffness)
    signs    of the stress: "positive", 1 or −1 for each edge (N_b,), or "any"
    free     edges whose stress may change, indices or a mask; all by default
    initial  stresses, stiffnesses or rest lengths (N_b,) that are changed least, in place of those of the start

    Many parameters: each is a part of the problem.

    The optimum is local.  `Status.infeasible` is a proof that no variables have the targets, with the bound in the
    note; `Status.not_reached` says that the search ended without them: the value is the best compromise found.
    `reached` tells whether all targets are; with `Status.step_limit` or `Status.stalled` they are, and the preference
    is not at its minimum, which for the least change only selects, so that the status is then `ok`.
    `stats.residual` is the largest error of a target relative to its size.
    Raises `InputError` for unknown or contradictory targets and wrong shapes or signs, `SolveError` with `throw`.
    """
    if max_steps < 0:
        raise InputError(f"max_steps must not be negative, not {max_steps}")
    network = start if isinstance(start, Network) else start.network
    parsed = parse_targets(network, targets)
    ratios = change == "rest_lengths" and isinstance(prefer, str) and prefer == "ratios"
    variables = _variables(start, change, within or {}, signs, free, initial, ratios)
    refusal = variables.excluded(parsed)
    goal = next((target for target in parsed if target.goal), None)
    preference = preference_of(variables, network, "least_change" if ratios else prefer, goal)
    problem = TargetProblem(variables, preference, parsed)
    if refusal:
        end = minimise_constrained(problem, variables.origin, np.inf, variables.longest, 0)
        solution = _report(problem, parsed, end, Status.infeasible, refusal)
    else:
        with np.errstate(all="ignore"):
            end = variables.search(problem, preference.tolerance, max_steps)
        # The least change only selects: a design that has its targets is complete without it.
        status = Status.ok if end.reached and preference.name == "change" else end.status
        solution = _report(problem, parsed, end, status, "" if status is Status.ok else _note(problem, end))
    return solution.or_raise("no design with these properties was found") if throw else solution


def _variables(
    start: Network | CriticalManifold | CriticalConfiguration | PressurisedConfiguration | SpringState,
    change: str,
    within: Mapping[str, Any],
    signs: str | ArrayLike | None,
    free: ArrayLike | None,
    initial: ArrayLike | None,
    ratios: bool,
) -> Variables:
    """The variables of the arguments of `design`."""
    if change not in CHANGES:
        raise InputError(f"no change is called {change!r:.40}: choose from {', '.join(CHANGES)}")
    network = start if isinstance(start, Network) else start.network
    limits = edge_limits(network.n_edges, within, change)
    if change == "stress":
        sigma = start.sigma if isinstance(start, CriticalConfiguration) and initial is None else initial
        manifold = start if isinstance(start, CriticalManifold) else CriticalManifold(network)
        return Stresses(manifold, sigma, free, "positive" if signs is None else signs, limits)
    require_unused(change, signs=signs, free=free)
    if change == "pressures":
        sigma = getattr(start, "sigma", None) if initial is None else initial
        return StressesAndPressures(network, sigma, getattr(start, "pressures", None))
    if change == "faces":
        require_unused(change, initial=initial)
        if not isinstance(start, CriticalConfiguration):
            raise InputError("change='faces' starts from a critical configuration: give one")
        return FaceAmplitudes(start, limits)
    if not isinstance(start, SpringState) or start.faces is not None:
        raise InputError(
            f"change={change!r} starts from springs on edges at coordinates: give spring_state(network, ...)"
        )
    return Stiffnesses(start, initial, limits) if change == "stiffness" else RestLengths(start, ratios, initial)


def _note(problem: TargetProblem, end: Minimum) -> str:
    """The error that remains, and the next step."""
    if end.reached:
        return f"the targets are reached, and {problem.preference.name} is not yet at its minimum: raise max_steps"
    c = end.point.constraints
    excess = np.abs(c - np.clip(c, problem.low, problem.high))
    worst = int(np.argmax(excess[: len(problem.targets)])) if len(problem.targets) else 0
    if len(problem.targets) and not excess[worst] <= 0.1 * excess.max():
        name = problem.targets[worst].name
        return (
            f"no start reached all targets together, {name} misses by {excess[worst] * problem.sizes[worst]:.3g}: "
            + ("raise max_steps, " if end.status is Status.step_limit else "")
            + ("widen the limits of the edges, " if len(problem.variables.low) else "")
            + "relax one, or give another start"
        )
    return "no start reached the targets inside the limits of the edges: widen the limits, or relax a target"


def _report(problem: TargetProblem, targets: Sequence[Target], end: Minimum, status: Status, note: str) -> Design[Any]:
    """The design at the end of a search."""
    variables, preference, z = problem.variables, problem.preference, end.point.z
    made = variables.designed(z, [target.quantity for target in targets])
    names = [target.name for target in problem.targets]
    # dpreference/dlimit = −μ of the constraint in units of its size.
    multipliers = -end.multipliers[: len(names)] / problem.sizes
    costs = {name: preference.shown(float(one)) for name, one in zip(names, multipliers, strict=True)}
    gram, independence = cosines(made.rows)
    achieved = {
        target.name: Achieved(float(value), float(error), costs.get(target.name, 0.0), float(sine))
        for target, value, error, sine in zip(targets, made.values, made.errors, independence, strict=True)
    }
    if not made.solved.ok:
        status, note = made.solved.status, made.solved.note
    return Design(
        value=made.value,
        status=status,
        stats=Stats("sqp", end.steps, end.violation, error_bound=made.error_bound),
        note=note,
        reached=end.reached,
        targets=achieved,
        preference=preference.shown(end.point.value),
        distance=variables.distance(z),
        gram=gram,
        solved=made.solved,
    )
