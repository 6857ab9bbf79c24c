"""Fronts of two objectives over the stresses: evenly spread points, each certified by its first-order conditions.

Both objectives are written as φ_1, φ_2 to be minimised, in units in which the ends of the front are (0, 1) and (1, 0).
Normal-boundary intersection (Das and Dennis 1998) moves from n evenly spaced points of the line between the ends in the
direction of its normal,
    minimise ½(φ_1 + φ_2)  subject to  φ_1 − φ_2 = d_j  and the limits of the edges,
with exact gradients by log σ.  With the multiplier μ of the constraint, w = (½ + μ, ½ − μ) are the weights of the
first-order condition  w_1 ∇φ_1 + w_2 ∇φ_2 + Σ ν ∇(limits) = 0,  ν ≥ 0: a point of a front needs w ≥ 0.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from critflow.arguments import of_kind
from critflow.calls import counted, running
from critflow.descent import FADED
from critflow.manifold import (
    COLLAPSING,
    SOUND,
    Balance,
    CriticalConfiguration,
    CriticalManifold,
    require_one_stress_by_count,
)
from critflow.networks import Array, Network
from critflow.numerics import norms
from critflow.quantities import quantity
from critflow.result import InputError, Solution, Stats, Status
from critflow_extras.targets.constrained import Minimum, Point, minimise_constrained
from critflow_extras.targets.problem import POWERS, Target, edge_limits, parse_targets, require_all_valid
from critflow_extras.targets.stress_form import same
from critflow_extras.targets.stresses import Stresses

FRONT_CERTIFIED = 1e-5  # largest relative residual of the first-order conditions of a certified point
FRONT_FLAT = 1e-4  # gradients below this, in units of the ends, count as zero
# Gradient at which the search for a point ends, in units of the ends: a fifth of what the certificate asks.
FRONT_OPTIMAL = 0.2 * FRONT_CERTIFIED * FRONT_FLAT
BETTER_END = 1e-3  # improvement of an end, in units of the ends, with which a front is computed again
SAME_VALUE = 1e-12  # difference of values, in their natural units, that is rounding
SAME_END = 1e-4  # relative difference of values below which both objectives have the same best configuration
# Weight of the other objective at an end: without it ends with many best configurations are arbitrary.
END_WEIGHT = 1e-2

_MOST_STEPS = 1000
# Steps in which the position on the front must be reached.
_RESTORING = 60
_LONGEST = 1.0
# Growth of steps from a start at which an objective curves away, as G_0 at equal stresses.
_LONGER = 4.0
# Change of log σ from the start to the second one.
_SHAKEN = 0.3
# Fronts that are computed at most, each from better ends.
_FRONTS = 3
_BEST = {-1: "largest", 1: "smallest"}
_LIMIT_EDGES = "limit the edges, as by within={'force_densities': (0.2, None)}"
_OUTSIDE = "the front has no point at this position: relax a limit of the edges"
_STEPS = "its steps are used up before the first-order conditions hold: raise max_steps"
_ROUNDED = f"rounding stops its search before the first-order conditions hold: give another start, or {_LIMIT_EDGES}"
_BACKWARDS = "a multiplier is negative: here an objective improves without cost, so the point is not on the front"


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Front(Solution[tuple[CriticalConfiguration, ...]]):
    """Configurations of a front in the order of the first objective, from its best value on.

    names        of both objectives
    achieved     their values, (n, 2)
    units        differences of each value between the two ends, the units of the weights, (2,)
    weights      multipliers w ≥ 0 of the first-order conditions in units of the ends of the front, (n, 2), sum 1
    residuals    largest component of w_1 ∇φ_1 + w_2 ∇φ_2 + Σ ν ∇(limits) by log σ, relative to that of its first two
                 terms or to `FRONT_FLAT`, (n,)
    statuses     outcome of each point: `ok` where it is certified
    n_limited    number of limits of edges that are active, (n,)
    dominated    whether another point is better in both objectives, (n,): such a point is a local optimum only
    """

    names: tuple[str, str]
    achieved: Array
    units: Array = field(repr=False)
    weights: Array = field(repr=False)
    residuals: Array = field(repr=False)
    statuses: tuple[Status, ...]
    n_limited: NDArray[np.intp] = field(repr=False)
    dominated: NDArray[np.bool_] = field(repr=False)


@running("pareto")
def pareto(
    network: Network | CriticalManifold,
    objectives: Mapping[Any, str] | Sequence[Any],
    n: int = 11,
    *more: object,
    within: Mapping[str, Any] | None = None,
    start: ArrayLike | None = None,
    max_steps: int = _MOST_STEPS,
    throw: bool = True,
) -> Front:
    """The front of two objectives over all positive stresses: n points, evenly spread in units of its ends.

    objectives  two quantities, by name or a `Quantity`, each → "largest" or "smallest"; in a list, moduli are to be
                largest and the others smallest
    within      limits (low, high) of "lengths", "tensions" and "force_densities" of the edges, as for `design`.  Some
                objectives have no extreme value without them, as C_B, which grows without limit as edges shrink
    start       stresses (N_b,) from which the ends are found; 1 by default
    max_steps   of each point
    more        nothing: further arguments are named

    A point is certified, `Status.ok`, if its weights are not negative and the residual of its first-order conditions is
    below `FRONT_CERTIFIED`.  That is a proof of stationarity up to the residual, not of a global optimum: fronts are
    local, as every optimum of a descent.  The ends minimise one objective and a hundredth of the other.
    `Status.not_reached` at a point where the front has no point in front of the line between its ends;
    `Status.edge_collapse` or `Status.slack_edges` at a point that is not attained, as edges shrink or lose their stress
    towards it: its values are near their limits.  Where the objective of such an end has no limit, as the largest C_B,
    the front has two ends only, and needs limits of the edges.
    Raises `InputError` for unknown objectives, for two that have the same best configuration or no front without limits
    of the edges, and networks with several self-stresses; `SolveError` where a point is not certified and `throw`.
    """
    network = of_kind(Network, CriticalManifold, network=network)
    if more or isinstance(objectives, str):
        raise InputError("both objectives stand in one list, such as pareto(network, ['B_0', 'V_L'], 11)")
    of_kind(Mapping, Sequence, objectives=objectives)
    n, max_steps = of_kind(int, n=n, max_steps=max_steps)
    of_kind(Mapping, None, within=within)
    of_kind(np.ndarray, None, start=start)
    of_kind(bool, throw=throw)
    manifold = CriticalManifold.of(network)
    if n < 2:
        raise InputError(f"a front has at least its two ends, n = 2 points, not {n}")
    pair = _pair(manifold, objectives)
    stresses = Stresses(manifold, start, limits=edge_limits(manifold.network.n_edges, within or {}, tuple(POWERS)))
    require_all_valid(stresses, pair)
    search = _Search(stresses, pair, max_steps)
    solution = _front(stresses, pair, search.points(n), search.units)
    return solution.or_raise("the front is not complete") if throw else solution


def _pair(manifold: CriticalManifold, objectives: Mapping[Any, str] | Sequence[Any]) -> list[Target]:
    """The two objectives; `InputError` where there are not two, or one is no objective."""
    if len(objectives) != 2:
        raise InputError(f"a front has two objectives, such as ['B_0', 'V_L'], not {len(objectives)}")
    if isinstance(objectives, Mapping):
        extremes = list(objectives.items())
    else:
        best = [quantity(manifold.network, key).maximise for key in objectives]
        extremes = [(key, "largest" if one else "smallest") for key, one in zip(objectives, best, strict=True)]
    for name, extreme in extremes:
        if extreme not in ("largest", "smallest"):
            raise InputError(f"the objective {name!s:.40} must be 'largest' or 'smallest', not {extreme!r:.40}")
    pair = [parse_targets(manifold.network, {key: extreme})[0] for key, extreme in extremes]
    if same(pair[0].quantity, pair[1].quantity):
        raise InputError("both objectives are the same quantity: give two different ones")
    if any(one.quantity.one_self_stress for one in pair):
        require_one_stress_by_count(manifold.network)
    return pair


@dataclass(frozen=True, eq=False)
class _Point:
    """The end of the search for one point of the front, φ (2,) there, and the multipliers of the limits of edges."""

    minimum: Minimum
    values: Array
    weights: Array
    limits: Array
    residual: float
    status: Status
    note: str

    @property
    def z(self) -> Array:
        return self.minimum.point.z


class _Weighted:
    """w·φ, with φ_1 − φ_2 as first constraint where it is prescribed, then the limits of the edges."""

    def __init__(self, search: _Search, weights: tuple[float, float], difference: float | None = None):
        self._search, self.weights = search, np.array(weights)
        first = [] if difference is None else [difference]
        self.n_prescribed, stresses = len(first), search.stresses
        self.low, self.high = np.concatenate([first, stresses.low]), np.concatenate([first, stresses.high])

    def at(self, z: Array) -> Point:
        state, values, gradients = self._search.objectives(z)
        rounding = self._search.rounding(values, self.weights)
        stresses, n = self._search.stresses, self.n_prescribed
        apart, along = (values[:1] - values[1:])[:n], (gradients[:1] - gradients[1:])[:n]

        def rows(indices: NDArray[np.intp]) -> Array:
            limits = stresses.limited_rows(state, indices[indices >= n] - n)
            return np.concatenate([along[indices[indices < n]], limits])

        constraints = np.concatenate([apart, stresses.limited(state)])
        return Point(z, float(self.weights @ values), self.weights @ gradients, constraints, rows, rounding)


class _Search:
    """The points of one front."""

    def __init__(self, stresses: Stresses, pair: list[Target], max_steps: int):
        self.stresses, self._pair, self._max_steps = stresses, pair, max_steps
        self._signs = np.array([float(one.sense) for one in pair])
        self._natural = np.array([one.quantity.unit(stresses.network) for one in pair])
        self._ideal, self.units = np.zeros(2), self._natural

    def objectives(self, z: Array) -> tuple[Balance, Array, Array]:
        """The balance at z, φ (2,), and their gradients (2, N)."""
        state = self.stresses.at(z)
        with np.errstate(all="ignore"):
            values, gradients = self.stresses.values(state, [one.quantity for one in self._pair])
        return state, (self._signs * values - self._ideal) / self.units, (self._signs / self.units)[:, None] * gradients

    def rounding(self, values: Array, weights: Array) -> float:
        """Rounding error of w·φ: that of the objectives, which are large in units of the ends if these are close."""
        return SAME_VALUE * float(weights @ np.abs(values + self._ideal / self.units))

    def points(self, n: int) -> list[_Point]:
        """The front between the best ends that are known: a better end that a front contains begins another one."""
        starts: list[list[Array]] = [[], []]
        for _ in range(_FRONTS):
            points = self._between(self._ends(starts), n)
            values = np.array([one.values if one.minimum.reached else [np.inf, np.inf] for one in points])
            if values.min() > -BETTER_END:
                break
            starts = [[points[i].z] for i in values.argmin(axis=0)]
        return points

    def _between(self, ends: list[_Point], n: int) -> list[_Point]:
        """The ends and the points between them, each from its neighbour, and back where that is not the best."""
        without_limit = any(
            end.status in (Status.edge_collapse, Status.slack_edges) and not np.isfinite(self._extreme(target))
            for end, target in zip(ends, self._pair, strict=True)
        )
        if n == 2 or without_limit or not all(end.minimum.reached for end in ends):
            return ends
        points = [ends[0]]
        first, last = (float(end.values[0] - end.values[1]) for end in ends)
        problems = [_Weighted(self, (0.5, 0.5), float(difference)) for difference in np.linspace(first, last, n)[1:-1]]
        for problem in counted(problems, "point"):
            points.append(self._point(problem, points[-1].z))
        points.append(ends[1])
        # Where the front jumps, the points beyond belong to the branch of the other end.
        for i in range(n - 2, 0, -1):
            if points[i].status is not Status.ok or dominated(np.array([one.values for one in points]))[i]:
                again, old = self._point(problems[i - 1], points[i + 1].z), points[i]
                better = old.status is not Status.ok or again.minimum.point.value < old.minimum.point.value
                points[i] = again if again.status is Status.ok and better else old
        return [points[0], *(self._attained(one, "this point of the front") for one in points[1:-1]), points[-1]]

    def _ends(self, starts: list[list[Array]]) -> list[_Point]:
        """Each end first alone, which gives the units, then with a small weight of the other objective.

        starts  more of them for each end
        """
        self._ideal, self.units = np.zeros(2), self._natural
        minima = [self._alone(weights, more) for weights, more in zip(((1.0, 0.0), (0.0, 1.0)), starts, strict=True)]
        alone = [minimum.point.z for minimum in minima]
        values = np.array([self.objectives(z)[1] for z in alone]) * self.units
        spread = np.diag(values[::-1]) - np.diag(values)
        if not (spread > SAME_END * np.abs(values).max(axis=0)).all():
            for z, target in zip(alone, self._pair, strict=True):
                leaving = self._leaving(z)
                if leaving and not np.isfinite(self._extreme(target)):
                    _, edge, change = leaving
                    best = f"{_BEST[target.sense]} {target.name}"
                    raise InputError(f"there is no {best}: it has no limit as edge {edge} {change}; {_LIMIT_EDGES}")
            for minimum, target in zip(minima, self._pair, strict=True):
                if minimum.status is Status.step_limit:
                    best = f"{_BEST[target.sense]} {target.name}"
                    raise InputError(f"the {best} is not reached: raise max_steps, {self._max_steps} here")
            raise InputError("both objectives have the same best configuration: change one")
        self._ideal, self.units = np.diag(values).copy(), spread
        weights = ((1 - END_WEIGHT, END_WEIGHT), (END_WEIGHT, 1 - END_WEIGHT))
        ends = [self._point(_Weighted(self, pair), z) for pair, z in zip(weights, alone, strict=True)]
        return [
            self._attained(end, f"the end of the {_BEST[target.sense]} {target.name}")
            for end, target in zip(ends, self._pair, strict=True)
        ]

    def _attained(self, point: _Point, name: str) -> _Point:
        """A point towards which edges shrink or lose their stress, with this as its reason."""
        leaving = None if point.note == _BACKWARDS else self._leaving(point.z, point.status is Status.ok)
        if not leaving:
            return point
        status, edge, change = leaving
        return replace(point, status=status, note=f"{name} is not attained, edge {edge} {change}: {_LIMIT_EDGES}")

    def _leaving(self, z: Array, stationary: bool = False) -> tuple[Status, int, str] | None:
        """The edge that shrinks or loses its stress, with the status that names this; None where none does.

        stationary  whether the first-order conditions hold: only an edge that is far beyond then counts, since near a
                    limit the gradient by log σ vanishes too
        """
        balance = self.stresses.at(z)
        sigma, length = balance.sigma, norms(balance.bond_vectors)
        if length.min() < (COLLAPSING if stationary else SOUND) * length.mean():
            return Status.edge_collapse, int(length.argmin()), "shrinks"
        if sigma.min() < (FADED if stationary else SOUND**2) * sigma.mean():
            return Status.slack_edges, int(sigma.argmin()), "loses its stress"
        return None

    def _extreme(self, target: Target) -> float:
        """The best value that the objective can have."""
        return float(target.quantity.extreme(self.stresses.manifold, True)[target.sense < 0])

    def _alone(self, weights: tuple[float, float], more: list[Array]) -> Minimum:
        """The best point of one objective: from the start, where B_0 and C_B may be stationary, near it, and more."""
        origin, problem = self.stresses.origin, _Weighted(self, weights)
        shaken = origin + _SHAKEN * np.random.default_rng(0).standard_normal(len(origin))
        minima = [self._minimum(problem, start) for start in (origin, shaken, *more)]
        values = np.array([end.point.value if end.reached else np.inf for end in minima])
        # The first of several that differ by rounding only, which would choose another one in other units.
        return minima[int(np.argmax(values <= values.min() + SAME_VALUE))]

    def _minimum(self, problem: _Weighted, start: Array) -> Minimum:
        return minimise_constrained(
            problem, start, FRONT_OPTIMAL, _LONGEST, self._max_steps, restoring=_RESTORING, growth=_LONGER
        )

    def _point(self, problem: _Weighted, start: Array) -> _Point:
        minimum, weights = self._minimum(problem, start), problem.weights.copy()
        if problem.n_prescribed:
            weights += minimum.multipliers[0] * np.array([1.0, -1.0])
        _, values, gradients = self.objectives(minimum.point.z)
        # Where both objectives are stationary, as B_0 and C_B at σ = k, the gradients are rounding.
        residual = minimum.residual / max(float(np.abs(weights[:, None] * gradients).max()), FRONT_FLAT)
        if not minimum.reached:
            status, note = Status.not_reached, _OUTSIDE
        elif weights.min() < -FRONT_CERTIFIED:
            status, note = Status.not_reached, _BACKWARDS
        elif residual < FRONT_CERTIFIED:
            status, note = Status.ok, ""
        elif minimum.status is Status.step_limit:
            status, note = Status.step_limit, _STEPS
        else:
            status, note = Status.stalled, _ROUNDED
        limits = minimum.multipliers[problem.n_prescribed :]
        return _Point(minimum, values, weights, limits, residual, status, note)


def dominated(values: Array) -> NDArray[np.bool_]:
    """Whether another point is better in both objectives, (n,), of values to be minimised (n, 2)."""
    return np.any(np.all(values[:, None, :] > values[None, :, :], axis=2), axis=1)


def _front(stresses: Stresses, pair: list[Target], points: list[_Point], units: Array) -> Front:
    """The front with the values at configurations that are solved to the last digit."""
    solved = [stresses.manifold.solve(stresses.stress(one.z)) for one in points]
    statuses = [one.status if balance.ok else balance.status for one, balance in zip(points, solved, strict=True)]
    achieved = np.array([[each.quantity.evaluate(one.value)[0] for each in pair] for one in solved])
    worst = next((i for i, status in enumerate(statuses) if status is not Status.ok), None)
    note = "" if worst is None else f"point {worst}: {points[worst].note or statuses[worst].message}"
    residuals = np.array([one.residual for one in points])
    stats = Stats("normal-boundary intersection", sum(one.minimum.steps for one in points), float(residuals.max()))
    return Front(
        tuple(one.value for one in solved),
        Status.ok if worst is None else statuses[worst],
        stats,
        note,
        names=(pair[0].name, pair[1].name),
        achieved=achieved,
        units=units,
        weights=np.array([one.weights for one in points]),
        residuals=residuals,
        statuses=tuple(statuses),
        n_limited=np.array([np.count_nonzero(one.limits) for one in points]),
        dominated=dominated(achieved * [each.sense for each in pair]),
    )
