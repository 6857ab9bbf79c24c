"""Design for targets: a configuration or a state with requested properties, or the reason why it does not exist.

    minimise  preference(z)  subject to  l_i ≤ O_i(z) ≤ u_i.
There are many variables z and few targets O_i, so feasible ones have many solutions and the preference selects one.
All gradients are exact.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from critflow.arguments import of_kind, shown
from critflow.calls import running
from critflow.manifold import Balance, CriticalConfiguration, CriticalManifold
from critflow.networks import Array, Network, validated_coordinates
from critflow.quantities import ALIASES, LengthVariance, Quantity, TensionVariance
from critflow.result import InputError, Record, Solution, Stats, Status
from critflow.springs import SpringState
from critflow_extras.targets.constrained import Minimum, minimise_constrained
from critflow_extras.targets.problem import (
    DesignOptions,
    Preference,
    Target,
    TargetProblem,
    Variables,
    parse_targets,
)
from critflow_extras.targets.stresses import Stresses

# Least eigenvalue of the cosines of the gradients of targets that can be changed independently.
INDEPENDENT_TARGETS = 1e-6

Value = TypeVar("Value")

# Component of the gradient of a preference along the surface of the targets, relative to 1 plus the largest component
# of the gradient, below which it is least.
TARGET_OPTIMAL = 1e-3

PREFERENCES: dict[str, type[Quantity]] = {"V_L": LengthVariance, "V_tau": TensionVariance}
"""Preferences that are quantities, by name."""

_POISSON = "Poisson's ratio is 'poisson' of change='stiffness'"
_YOUNG = "isotropic_targets(dimension, youngs_modulus, poissons_ratio) has the targets of change='stiffness'"
_OTHER_NAMES = {"nu": _POISSON, "ν": _POISSON, "poissons_ratio": _POISSON, "E": _YOUNG, "youngs_modulus": _YOUNG}

# What `design` may change, and its kind of variables, whose module is imported at its first use: it imports this one.
_KINDS = {
    "faces": "critflow_extras.targets.faces:FaceAmplitudes",
    "force_densities": "critflow_extras.loads.force_densities:ForceDensities",
    "pressures": "critflow_extras.design_pressures.stresses_and_pressures:StressesAndPressures",
    "rest_lengths": "critflow_extras.design_rest_lengths.rest_lengths:RestLengths",
    "stiffness": "critflow_extras.design_stiffness.stiffnesses:Stiffnesses",
    "stress": "critflow_extras.targets.stresses:Stresses",
}


@dataclass(frozen=True, repr=False)
class TargetResult(Record):
    """What a design has of one target.

    value         of the quantity
    error         of the value (estimate): from the errors of the bond vectors, and rounding
    multiplier    cost of the target: derivative of the least preference by its value, 0 inside an interval
    independence  sine of the angle between the gradient of the target and the span of the others, which is the part of
                  a unit change of this target alone; 0 where the others determine it
    """

    value: float
    error: float
    multiplier: float
    independence: float


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Design(Solution[Value]):
    """A configuration or a state with requested properties.

    reached     whether all targets are reached, whatever became of the preference
    targets     what is achieved of each target, by name
    preference  value of the preference: ½|z − z_0|² of the variables z, unless `design` was given another one
    distance    root mean square of the change: of log σ (of σ where `signs` is "any"), log lengths, log k or log ℓ
    gram        (n, n) cosines between the gradients of the targets, in their order; 0 in the row of a target that no
                variable changes
    solved      the solve that gives the values: the balance of forces, the elasticity at rest, or the onset
    """

    reached: bool
    targets: dict[str, TargetResult]
    preference: float
    distance: float
    gram: Array = field(repr=False)
    solved: Solution[Any] = field(repr=False)

    @property
    def independent(self) -> bool:
        """Whether all targets can be changed independently here: the least eigenvalue of `gram` is not zero."""
        return bool(np.isfinite(self.gram).all() and np.linalg.eigvalsh(self.gram)[0] > INDEPENDENT_TARGETS)


@running("design")
def design(
    start: Any,
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
             (stiffness, rest_lengths), the value of `loaded` (force_densities)
    targets  name or `Quantity` → value, (low, high), or "largest" or "smallest" for one of them
    change   "stress": the configuration follows the stress; quantities are those of the transition
             "stiffness": springs at rest at the coordinates of a state; moduli, components "C_xxxx", ..., and
             "poisson", which makes them isotropic
             "faces": lengths at a constant force network, which keeps S, D and every modulus at the transition
             "rest_lengths": of cables, for "onset[simple_shear]", ... at strains other than zero
             "force_densities": of a network under loads, with their scale, for "position[5,z]", "reaction[0,x]",
             "tension[3]", "rest_length[3]", and "lengths", "tensions", "rest_lengths" of all edges
             "pressures": positive stresses and pressures in the faces, for lengths, areas, V_L and V_tau
    prefer   "least_change" from the start; for stress also "V_L", "V_tau", or a configuration or coordinates (N_v, d)
             to be near to; for rest lengths also "ratios": one factor for all
    within   limits (low, high), each a number, one an edge, or None: of "lengths", of "tensions" and "force_densities"
             in units of their mean (stress), of "lengths" (faces), of "stiffnesses" (stiffness); also in singular
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
    kind = _kind(change)
    of_kind(bool, throw=throw)
    start, prefer, max_steps = _checked(kind, start, targets, prefer, max_steps)
    network = start if isinstance(start, Network) else start.network
    try:
        parsed = parse_targets(network, kind.all_targets(network, targets))
    except InputError:
        _require_targets(change, targets)
        raise
    variables = kind.of(start, DesignOptions(network, change, prefer, within, signs, free, initial))
    refusal = variables.refusal(parsed)
    extreme = next((target for target in parsed if target.sense), None)
    preference = preference_of(variables, network, prefer, extreme)
    solution = _searched(TargetProblem(variables, preference, parsed), parsed, refusal, max_steps)
    return solution.or_raise("no design with these properties was found") if throw else solution


def _searched(problem: TargetProblem, targets: Sequence[Target], refusal: str, max_steps: int) -> Design[Any]:
    """The design at the end of the search; at its start where a proof refuses the targets."""
    variables, preference = problem.variables, problem.preference
    if refusal:
        end = minimise_constrained(problem, variables.origin, np.inf, variables.longest, 0)
        return _report(problem, targets, end, Status.infeasible, refusal)
    with np.errstate(all="ignore"):
        end = variables.search(problem, preference.tolerance, max_steps)
    # The least change only selects: a design that has its targets is complete without it.
    status = Status.ok if end.reached and preference.name == "change" else end.status
    return _report(problem, targets, end, status, "" if status is Status.ok else _note(problem, end))


def _checked(kind: type[Variables], start: Any, targets: Any, prefer: Any, max_steps: Any) -> tuple[Any, Any, int]:
    """The start, the preference and the limit of the steps, of the kinds that `design` takes."""
    start = of_kind(Network, CriticalManifold, CriticalConfiguration, *kind.starts, SpringState, start=start)
    if not isinstance(targets, Mapping):
        raise InputError(f"targets must be a Mapping of values by name, such as {{'B_0': 0.25}}, not {shown(targets)}")
    prefer = of_kind(np.ndarray, str, CriticalConfiguration, prefer=prefer)
    max_steps = of_kind(int, max_steps=max_steps)
    if max_steps < 0:
        raise InputError(f"max_steps must not be negative, not {max_steps}")
    return start, prefer, max_steps


def change_of(targets: Mapping[Any, Any]) -> str:
    """The change that alone has one of the targets, such as "stiffness" for "poisson"; "stress" without any."""
    own = {name: change for change in _KINDS for name in _kind(change).own_targets}
    return next((own[name] for name in targets if isinstance(name, str) and name in own), "stress")


def _require_targets(change: str, targets: Mapping[Any, Any]) -> None:
    """Raise `InputError` for a target that only another change has, or that has another name."""
    for name in targets:
        if isinstance(name, str) and name in _OTHER_NAMES:
            raise InputError(f"{name} is no target: {_OTHER_NAMES[name]}")
        other = change_of({name: 0.0})
        if other not in ("stress", change):
            raise InputError(f"{name} is a target of change={other!r}, not of change={change!r}")


def _kind(change: str) -> type[Variables]:
    """The kind of variables of this name; `InputError` for unknown ones."""
    of_kind(str, change=change)
    if change not in _KINDS:
        raise InputError(f"no change is called {change!r:.40}: choose from {', '.join(_KINDS)}")
    module, _, name = _KINDS[change].partition(":")
    kind: type[Variables] = getattr(import_module(module), name)
    return kind


def least_change(variables: Variables) -> Preference:
    """The change that the variables define."""
    return Preference("change", variables.tolerance, variables.change)


def best_value(variables: Variables, quantity: Quantity, name: str, sign: float) -> Preference:
    """V_L, V_τ, or a target that is to be largest or smallest, times its sign and the number of edges."""
    size = sign * variables.size / variables.unit_of(quantity)

    def at(state: Any, z: Array) -> tuple[float, Array]:
        values, rows = variables.values(state, [quantity])
        return size * float(values[0]), size * rows[0]

    return Preference(name, TARGET_OPTIMAL, at, size)


def nearness(stresses: Stresses, coordinates: Array) -> Preference:
    """½Σ|x + c − x̂|² over the number of vertices, with the translation c of periodic networks."""
    size = 1 / (stresses.network.spacing * stresses.network.spacing)

    def at(state: Balance, z: Array) -> tuple[float, Array]:
        network = state.network
        apart = network.all_coordinates(state.coordinates) - coordinates
        if not network.pins:
            apart -= apart.mean(axis=0)
        y = state.factor.solve(apart[network.free])
        by_sigma = -size / len(apart) * np.einsum("ad,ad->a", state.bond_vectors, network.free_incidence @ y)
        return 0.5 * size * float(np.sum(apart**2)) / len(apart), stresses.gradients(by_sigma, state.sigma)

    # Components of the gradient of a mean fall as a network grows.
    return Preference("distance", min(stresses.nearest, TARGET_OPTIMAL / len(coordinates)), at, size)


def preference_of(
    variables: Variables, network: Network, prefer: str | CriticalConfiguration | ArrayLike, extreme: Target | None
) -> Preference:
    """The preference of the arguments of `design`; `InputError` for unknown ones.

    extreme  the target that is to be largest or smallest
    """
    change = isinstance(prefer, str) and prefer in ("least_change", *variables.preferences)
    if extreme is not None:
        if not change:
            word = {1: "smallest", -1: "largest"}[extreme.sense]
            raise InputError(f"{extreme.name} is to be {word}, which leaves no choice: omit prefer")
        return best_value(variables, extreme.quantity, extreme.name, float(extreme.sense))
    if change:
        return least_change(variables)
    if not isinstance(variables, Stresses):
        raise InputError("other preferences than 'least_change' are those of a change of stress: omit prefer")
    if isinstance(prefer, str):
        name = ALIASES.get(prefer, prefer)
        if name not in PREFERENCES:
            names = ", ".join(("least_change", *PREFERENCES))
            raise InputError(f"no preference is called {prefer!r:.40}: choose from {names}, or give coordinates")
        return best_value(variables, PREFERENCES[name](), name, 1.0)
    x = prefer.coordinates if isinstance(prefer, CriticalConfiguration) else prefer
    return nearness(variables, validated_coordinates(network, x))


def _note(problem: TargetProblem, end: Minimum) -> str:
    """The error that remains, and the next step."""
    if end.reached:
        more = "raise max_steps" if end.status is Status.step_limit else "give another start"
        return f"the targets are reached, and {problem.preference.name} is not yet at its minimum: {more}"
    c, n = end.point.constraints, len(problem.targets)
    excess = np.abs(c - np.clip(c, problem.low, problem.high))
    if not np.isfinite(excess[:n]).all():
        name = problem.targets[int(np.argmin(np.isfinite(excess[:n])))].name
        return f"{name} has no value at the start of the search: change this target, or give another start"
    worst = int(np.argmax(excess))
    if worst >= n:
        return "no start reached the targets inside the limits of the edges: widen the limits, or relax a target"
    more = "raise max_steps, " * (end.status is Status.step_limit) + "widen the limits of the edges, " * (len(c) > n)
    missed = f"{problem.targets[worst].name} misses by {excess[worst] * problem.sizes[worst]:.3g}"
    return f"no start reached all targets together, {missed}: {more}relax one, or give another start"


def _report(problem: TargetProblem, targets: Sequence[Target], end: Minimum, status: Status, note: str) -> Design[Any]:
    """The design at the end of a search."""
    variables, preference, z = problem.variables, problem.preference, end.point.z
    result = variables.designed(z, [target.quantity for target in targets])
    names = [target.name for target in problem.targets]
    # dpreference/dlimit = −μ of the constraint in units of its size.
    multipliers = -end.multipliers[: len(names)] / problem.sizes
    costs = {name: float(one) / preference.size for name, one in zip(names, multipliers, strict=True)}
    gram, independence = cosines(result.rows)
    achieved = {
        target.name: TargetResult(float(value), float(error), costs.get(target.name, 0.0), float(sine))
        for target, value, error, sine in zip(targets, result.values, result.errors, independence, strict=True)
    }
    if not result.solved.ok:
        status, note = result.solved.status, result.solved.note
    elif status is Status.ok:
        note = variables.remark(result, targets)
    return Design(
        value=result.value,
        status=status,
        stats=Stats("sqp", end.steps, end.violation, error_bound=result.error_bound),
        note=note,
        reached=end.reached,
        targets=achieved,
        preference=end.point.value / preference.size,
        distance=variables.distance(z),
        gram=gram,
        solved=result.solved,
    )


def cosines(rows: Array) -> tuple[Array, Array]:
    """Cosines (n, n) between gradients (n, N), and the sine of each to the span of the others (n,)."""
    if not np.isfinite(rows).all():
        return np.full((len(rows), len(rows)), np.nan), np.full(len(rows), np.nan)
    norm = np.linalg.norm(rows, axis=1)
    unit = rows / np.where(norm > 0, norm, 1.0)[:, None]
    gram = unit @ unit.T
    return gram, np.sqrt(1 / np.maximum(np.diag(np.linalg.pinv(gram)), 1.0)) * (norm > 0)
