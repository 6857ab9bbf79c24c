"""Optimise over all critical configurations: stress in, configuration out, the best of a kind returned.

The unknowns are θ = log σ, so every stress stays positive, and results are scaled to Σσ² = N_b.  The residual of an
optimum is the largest component of dO/dσ, the gradient projected on the stresses of that scale.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from critflow.critical import critical_from_lengths
from critflow.manifold import CriticalConfiguration, CriticalManifold
from critflow.minimize import Minimum, Point, fire, lbfgs, newton
from critflow.network import Array, Network, edge_values
from critflow.objectives import LengthVariance, Objective, TransitionModulus, dilation, named_objective
from critflow.result import InputError, Solution, Stats, Status

METHODS = ("auto", "fire", "lbfgs", "newton", "closed_form", "conic")

# Step limits that are several times what standard networks of 1,000 vertices need.
_MAX_STEPS = {"fire": 200_000, "lbfgs": 3_000, "newton": 200}

# An edge below this part of the mean length that keeps its tension is on its way to zero length.
_COLLAPSING = 1e-4
# A stress this small, where Σσ² = N_b, is on its way to zero.
_FADED = 1e-12
# Where edges collapse or fall slack, the configuration returned is the last on the way with no edge below this part
# of the mean and no stress below its square: shorter ones would lose the digits of their balance in the rounding of
# the coordinates.
_SOUND = 1e-2

# A relative gain in the objective that is not rounding.
_NOTICED = 1e-9


def optimize(
    network: Network | CriticalManifold,
    objective: str | Objective,
    method: str = "auto",
    *,
    start: ArrayLike | None = None,
    starts: int = 1,
    rng: np.random.Generator | None = None,
    threshold: float = 0.1,
    tolerance: float = 1e-12,
    max_steps: int | None = None,
    throw: bool = True,
) -> Solution[CriticalConfiguration]:
    """The critical configuration that is best by an objective, with its value in `stats.details["objective"]`.

    objective  "length_variance", "tension_variance" (least), "bulk_modulus", "shear_modulus" (largest; the last with
               the penalty that keeps σ above about `threshold`), or an `Objective`
    method     "fire", "lbfgs", "newton"; "closed_form" for the bulk modulus; "conic" for the length variance; "auto"
               takes the cheapest that reaches the tolerance
    start      σ to start from, (N_b,); by default 1 on every edge
    starts     number of starts; from the second on random, |N(0, 1)|, drawn from `rng`; the best optimum is returned
               and `stats.details["starts"]` lists the values of all

    A tension variance whose infimum wants an edge of zero length returns `Status.edge_collapse`, the edges and the
    limit of the value; a length variance for which edges fall slack does the same with `Status.slack_edges`.
    Raises `InputError` for bad arguments, `SolveError` when the status is not good and `throw`.
    """
    manifold = CriticalManifold.of(network)
    goal = named_objective(manifold.network, objective, threshold) if isinstance(objective, str) else objective
    if method not in METHODS:
        raise InputError(f"no method is called {method!r}: choose one of {', '.join(METHODS)}")
    if starts < 1 or (starts > 1 and rng is None):
        raise InputError("starts must be at least 1, and more than one start needs a random generator rng")
    if not tolerance > 0:
        raise InputError(f"the tolerance must be positive, not {tolerance}")
    is_bulk = isinstance(goal, TransitionModulus) and np.array_equal(goal.strain, dilation(manifold.network.dimension))
    if method == "closed_form" or (method == "auto" and is_bulk):
        if not isinstance(goal, TransitionModulus) or not is_bulk:
            raise InputError("a closed form is known for the bulk modulus only: choose another method")
        solution = _largest_bulk_modulus(manifold, goal)
    elif method == "conic":
        if not isinstance(goal, LengthVariance):
            raise InputError("the cone program finds the least length variance only: choose another method")
        solution = _equal_lengths(manifold)
    elif method == "auto" and start is None and isinstance(goal, LengthVariance):
        solution = _equal_lengths(manifold)
        if not solution.ok:
            # Equal lengths leave edges slack, so the least variance is not zero and has to be looked for.
            solution = _descend(manifold, goal, method, np.ones(manifold.network.n_edges), tolerance, max_steps)
    else:
        n_edges = manifold.network.n_edges
        first = np.ones(n_edges) if start is None else edge_values(start, n_edges, "start")
        others = [np.abs(rng.standard_normal(n_edges)) for _ in range(starts - 1)] if rng is not None else []
        solutions = [_descend(manifold, goal, method, sigma, tolerance, max_steps) for sigma in [first, *others]]
        values = np.array([s.stats.details["objective"] for s in solutions])
        good = [n for n, s in enumerate(solutions) if s.ok] or range(len(solutions))
        best = max(good, key=lambda n: values[n]) if goal.maximise else min(good, key=lambda n: values[n])
        solution = solutions[best]
        solution.stats.details.update(start=best, starts=values)
    return solution.or_raise("no optimum") if throw else solution


def bulk_modulus_bound(network: Network | CriticalManifold) -> float:
    """The largest B_0 that any stress can give, (1/d²V) Σ k|L*|² with L* the configuration at σ = k.

    Virtual work gives Σσ|L|² = Σσ L·L* for every compatible L*, and Cauchy–Schwarz does the rest.
    """
    manifold = CriticalManifold.of(network)
    k, d = manifold.network.stiffness, manifold.network.dimension
    L = manifold.balance(k)[1]
    return float(k @ np.sum(L**2, axis=1)) / (d**2 * manifold.network.volume)


def _largest_bulk_modulus(manifold: CriticalManifold, goal: TransitionModulus) -> Solution[CriticalConfiguration]:
    if not np.array_equal(goal.stiffness, manifold.network.stiffness):
        raise InputError("the closed form needs the stiffness of the network itself")
    value = manifold.configuration(manifold.network.stiffness)
    modulus, residual = _residual(manifold, goal, value)
    bound = bulk_modulus_bound(manifold)
    details = {"objective": modulus, "bound": bound, "gap": 1 - modulus / bound}
    return Solution(value, Status.ok, Stats("closed_form", 0, 1, residual, details))


def _equal_lengths(manifold: CriticalManifold) -> Solution[CriticalConfiguration]:
    network = manifold.network
    solution = critical_from_lengths(manifold, np.ones(network.n_edges), "conic", throw=False)
    stats = solution.stats
    if solution.ok:
        # The configuration of the stress itself balances to rounding.
        value = manifold.configuration(solution.value.sigma)
        variance, residual = _residual(manifold, LengthVariance(), value)
    else:
        value, residual, variance = solution.value, np.nan, np.nan
    details = {**stats.details, "objective": variance}
    return Solution(value, solution.status, Stats("conic", stats.iterations, stats.evaluations, residual, details))


def _residual(manifold: CriticalManifold, goal: Objective, value: CriticalConfiguration) -> tuple[float, float]:
    """Value of an objective at a configuration, and the largest component of dO/dσ."""
    _, L, factor = manifold.balance(value.sigma)
    O, partials = goal.evaluate(value.sigma, L)
    return O, float(np.abs(manifold.pull_back(L, factor, *partials)[0]).max())


def _descend(
    manifold: CriticalManifold, goal: Objective, method: str, sigma: Array, tolerance: float, max_steps: int | None
) -> Solution[CriticalConfiguration]:
    landscape = _Landscape(manifold, goal)
    end = _minimise(landscape, method, np.log(sigma), tolerance, max_steps)
    if end.status is Status.ok and end.iterations == 0:
        # A start without slope may be a saddle by symmetry; a step to the side, to no one's liking, tells.
        aside = np.log(sigma) + 0.1 * np.sin(1.0 + np.arange(len(sigma)))
        other = _minimise(landscape, method, aside, tolerance, max_steps)
        if other.status is Status.ok and other.point.value < end.point.value - _NOTICED * abs(other.point.value):
            end = other
    reached = manifold.solve(landscape.sigma(end.point.x))
    status, value = end.status, reached.value
    details: dict[str, object] = {"objective": landscape.sign * end.point.value}
    if status in (Status.edge_collapse, Status.slack_edges):
        details = _limit(end, value, landscape.sign)
        value = manifold.configuration(landscape.sigma(landscape.last_sound))
    elif not reached.ok:
        # A method that ran away ends where no configuration is.
        status, details = Status.singular, {"objective": np.nan}
    return Solution(value, status, Stats(method, end.iterations, end.evaluations, end.point.residual, details))


def _limit(end: Minimum, value: CriticalConfiguration, sign: float) -> dict[str, object]:
    """The infimum that a descent heads for without attaining it: its value, and the edges that vanish or fall slack.

    A vanishing length is ∝ 1/σ and brings a gain ∝ 1/σ, a vanishing stress one ∝ σ: what is left to gain there is the
    slope along log σ.
    """
    slope = end.point.gradient
    if end.status is Status.edge_collapse:
        # Short edges that gain by being shorter: others may be short by an isogonal mode, at no gain.
        gain = np.where(value.lengths < 0.5 * _SOUND * value.lengths.mean(), -slope / value.lengths, 0.0)
        edges, fate = np.flatnonzero(gain > 0.1 * gain.max()), "shrink to zero length"
    else:
        edges, fate = np.flatnonzero((value.sigma < 1e3 * _FADED) & (slope > 0)), "lose their tension"
    left = float(np.abs(slope[edges]).sum())
    limit = sign * (end.point.value - left)
    named = ", ".join(map(str, edges))
    return {
        "objective": limit,
        "uncertainty": left + float(np.abs(np.delete(slope, edges)).sum()),
        "collapsed_edges" if end.status is Status.edge_collapse else "slack_edges": edges,
        "note": f"edges {named} {fate} on the way to the infimum {limit:.8g}, which is not attained",
    }


def _minimise(landscape: _Landscape, method: str, x: Array, tolerance: float, max_steps: int | None) -> Minimum:
    if method == "fire":
        return fire(landscape, x, tolerance, max_steps or _MAX_STEPS[method], landscape.time_step, max_move=0.5)
    if method == "newton":
        return newton(landscape, x, tolerance, max_steps or _MAX_STEPS[method])
    end = lbfgs(landscape, x, tolerance, max_steps or _MAX_STEPS["lbfgs"])
    if method == "auto" and end.status in (Status.step_limit, Status.stalled):
        # Gradients alone did not get there; the Hessian converges in a few steps from where they ended.
        fine = newton(landscape, end.point.x, tolerance, _MAX_STEPS["newton"])
        return Minimum(fine.point, fine.status, end.iterations + fine.iterations, end.evaluations + fine.evaluations)
    return end


class _Landscape:
    """An objective as a function of θ = log σ, to be minimised."""

    def __init__(self, manifold: CriticalManifold, goal: Objective):
        self._manifold, self._goal = manifold, goal
        self.sign = -1.0 if goal.maximise else 1.0
        self.last_sound = np.zeros(manifold.network.n_edges)

    def sigma(self, x: Array) -> Array:
        """σ of log-stresses θ, scaled to Σσ² = N_b."""
        sigma = np.exp(x - x.max())
        return sigma * np.sqrt(len(x) / (sigma @ sigma))

    @property
    def time_step(self) -> float:
        # Curvatures per edge are of order 1/N_b.
        return 0.3 * np.sqrt(self._manifold.network.n_edges)

    def at(self, x: Array) -> Point:
        # Trials far out may overflow; they are told by a value that is not finite.
        with np.errstate(all="ignore"):
            sigma = self.sigma(x)
            _, L, factor = self._manifold.balance(sigma)
            value, partials = self._goal.evaluate(sigma, L)
            gradient, gy = self._manifold.pull_back(L, factor, *partials)
        self._last = (x, sigma, L, factor, gradient, gy)
        residual = float(np.abs(gradient).max())
        return Point(x, self.sign * value, self.sign * sigma * gradient, residual if np.isfinite(residual) else np.inf)

    def stiff_diagonal(self, point: Point) -> Array | float:
        return self._goal.stiff_diagonal(self._last[1])

    def verdict(self, point: Point) -> Status | None:
        _, sigma, L, *_ = self._last
        if not np.isfinite(point.value):
            return Status.singular
        length = np.linalg.norm(L, axis=1)
        tension = sigma * length
        if length.min() > _SOUND * length.mean() and sigma.min() > _SOUND**2:
            self.last_sound = point.x
        if sigma.min() < _FADED:
            return Status.slack_edges
        vanishing = (length < _COLLAPSING * length.mean()) & (tension > 0.01 * tension.mean())
        return Status.edge_collapse if vanishing.any() else None

    def curvature(self, point: Point, direction: Array) -> Array:
        x, sigma, L, factor, gradient, gy = self._last
        assert x is point.x, "the curvature belongs to the point evaluated last"
        dsigma = sigma * direction
        dL = self._manifold.tangent(L, factor, dsigma)
        second = self._goal.differential(sigma, L, dsigma, dL)
        dgradient = self._manifold.pull_back_tangent(factor, L, dL, gy, dsigma, second)
        return self.sign * (dsigma * gradient + sigma * dgradient)
