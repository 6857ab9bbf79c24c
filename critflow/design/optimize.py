"""Optimise over all critical configurations: stress in, configuration out, the best of a kind returned.

The unknowns are θ = log σ, so every stress stays positive, or σ itself where compression is allowed; results are
scaled to Σσ² = N_b.  The residual of an optimum is the largest component of dO/dσ, the gradient projected on the
stresses of that scale.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from critflow.critical.derivatives import evaluate
from critflow.critical.manifold import CriticalConfiguration, CriticalManifold, require_one_self_stress
from critflow.critical.objectives import (
    ConstrainedModulus,
    LengthVariance,
    Objective,
    TransitionModulus,
    dilation,
    named_objective,
    pure_shear,
    transition_modulus,
)
from critflow.design.from_lengths import critical_from_lengths
from critflow.design.modulus_bounds import largest_modulus
from critflow.design.stress_objective import FADED, SOUND, Landscape, Observer, SignedLandscape
from critflow.linalg.tolerances import EPS
from critflow.mechanics.moduli_bounds import transition_modulus_bound
from critflow.networks.network import Array, Network, edge_values
from critflow.result import InputError, Solution, Stats, Status
from critflow.solvers.minimize import Minimum, fire, lbfgs, newton
from critflow.solvers.saddles import aside, downhill

METHODS = ("auto", "fire", "lbfgs", "newton", "closed_form", "conic")

# Step limits that are several times what standard networks of 1,000 vertices need.
_MAX_STEPS = {"fire": 200_000, "lbfgs": 3_000, "newton": 200}

# An end with a steeper slope than this is a place on the way, as asked for, and not told from a saddle: that would
# cost more than the way there.
_STATIONARY = 1e-8
# More saddles than any way down has met.
_MAX_SADDLES = 20


def optimize(
    network: Network | CriticalManifold,
    objective: str | Objective,
    method: str = "auto",
    *,
    signs: str = "positive",
    start: ArrayLike | None = None,
    starts: int = 1,
    rng: np.random.Generator | None = None,
    threshold: float = 0.1,
    tolerance: float = 1e-12,
    max_steps: int | None = None,
    observe: Observer | None = None,
    throw: bool = True,
) -> Solution[CriticalConfiguration]:
    """The critical configuration that is best by an objective, with its value in `stats.details["objective"]`.

    objective  "length_variance", "tension_variance" (least), "bulk_modulus", "shear_modulus" (largest; the last with
               the penalty that keeps σ above about `threshold`), or an `Objective`
    method     "fire", "lbfgs", "newton"; "closed_form" for moduli without a penalty, in three dimensions for the bulk
               modulus; "conic" for the length variance; "auto" takes the cheapest that reaches the tolerance
    signs      "positive": every edge under tension; "any": compression too, and "shear_modulus" has no penalty then
    start      σ to start from, (N_b,); by default 1 on every edge
    starts     number of starts; from the second on random, |N(0, 1)|, drawn from `rng`; the best optimum is returned
               and `stats.details["starts"]` lists the values of all
    observe    called with (step, value, σ, L) at the start and after every step of a descent; when it returns a true
               value the descent ends there, with `Status.step_limit`

    The statistics hold condition and error bound of the configuration for its stress.  Where the optimum is known, by
    a closed form or as V_L = 0, `stats.details["value_error"]` bounds the distance of the value from it.

    With signs of both kinds a way may cross stresses whose prestress matrix is singular, where no configuration is:
    `stats.details["crossings"]` lists the steps that did, `stats.details["nearest_singular"]` how near a step came
    (the smallest pivot over the largest).  A way on which lengths grow without end, to a limit at a singular matrix,
    returns `Status.singular`, the limit of the value and the last configuration with lengths to be relied on.

    A tension variance whose infimum wants an edge of zero length returns `Status.edge_collapse`, the edges and the
    limit of the value; a length variance for which edges fall slack does the same with `Status.slack_edges`.
    Raises `InputError` for bad arguments, `SolveError` when the status is not good and `throw`.
    """
    manifold = CriticalManifold.of(network)
    if signs not in ("positive", "any"):
        raise InputError(f"signs must be 'positive' or 'any', not {signs!r}")
    if signs == "any" and objective == "shear_modulus":
        objective = transition_modulus(manifold.network, pure_shear(manifold.network.dimension))
    goal = named_objective(manifold.network, objective, threshold) if isinstance(objective, str) else objective
    if method not in METHODS:
        raise InputError(f"no method is called {method!r}: choose one of {', '.join(METHODS)}")
    if starts < 1 or (starts > 1 and rng is None):
        raise InputError("starts must be at least 1, and more than one start needs a random generator rng")
    if not tolerance > 0:
        raise InputError(f"the tolerance must be positive, not {tolerance}")
    if (
        isinstance(goal, TransitionModulus | ConstrainedModulus)
        and signs == "positive"
        and not _is_bulk(manifold, goal)
    ):
        # The bulk modulus is safe: over all stresses of all configurations σ = k, which is positive, is best.
        require_one_self_stress(manifold.network, "only its bulk modulus and its variances can be optimised")
    if method == "closed_form" or (method == "auto" and _has_closed_form(manifold, goal, signs)):
        solution = _largest(manifold, goal, signs)
    elif method == "conic":
        if not isinstance(goal, LengthVariance):
            raise InputError("the cone program finds the least length variance only: choose another method")
        solution = _equal_lengths(manifold)
    elif (
        method == "auto"
        and start is None
        and isinstance(goal, LengthVariance)
        and signs == "positive"
        and tolerance < _cone_pays(manifold.network.n_edges)
    ):
        solution = _equal_lengths(manifold)
        if not solution.ok:
            # Equal lengths leave edges slack, so the least variance is not zero and has to be looked for.
            landscape = Landscape(manifold, goal, observe)
            solution = _descend(landscape, method, np.ones(manifold.network.n_edges), tolerance, max_steps)
    else:
        n_edges = manifold.network.n_edges
        first = np.ones(n_edges) if start is None else edge_values(start, n_edges, "start", signs == "positive")
        others = [np.abs(rng.standard_normal(n_edges)) for _ in range(starts - 1)] if rng is not None else []
        landscape = (Landscape if signs == "positive" else SignedLandscape)(manifold, goal, observe)
        solutions = [_descend(landscape, method, sigma, tolerance, max_steps) for sigma in [first, *others]]
        values = np.array([s.stats.details["objective"] for s in solutions])
        good = [n for n, s in enumerate(solutions) if s.ok] or range(len(solutions))
        best = max(good, key=lambda n: values[n]) if goal.maximise else min(good, key=lambda n: values[n])
        solution = solutions[best]
        solution.stats.details.update(start=best, starts=values)
    return solution.or_raise("no optimum") if throw else solution


def _cone_pays(n_edges: int) -> float:
    """The tolerance below which the cone program finds equal lengths sooner than a descent.

    It takes the same time whatever the tolerance, and the lengths are then equal to the last digit.  L-BFGS takes as
    long at 5e-6, 1e-7 and 1e-9 for 100, 1,000 and 10,000 vertices (study `speed_accuracy`).
    """
    return max(0.2 / n_edges**2, 1e-11)


def _is_bulk(manifold: CriticalManifold, goal: Objective) -> bool:
    """Whether an objective is the modulus of a dilation."""
    return isinstance(goal, TransitionModulus) and np.array_equal(goal.strain, dilation(manifold.network.dimension))


def _has_closed_form(manifold: CriticalManifold, goal: Objective, signs: str) -> bool:
    """Whether a configuration of the largest value is known, with no more compression than the signs allow."""
    if not isinstance(goal, TransitionModulus) or not np.array_equal(goal.stiffness, manifold.network.stiffness):
        return False
    return _is_bulk(manifold, goal) or (signs == "any" and manifold.network.dimension == 2)


def _largest(manifold: CriticalManifold, goal: Objective, signs: str) -> Solution[CriticalConfiguration]:
    if not isinstance(goal, TransitionModulus):
        raise InputError("a closed form is known for moduli without a penalty only: choose another method")
    if not np.array_equal(goal.stiffness, manifold.network.stiffness):
        raise InputError("the closed form needs the stiffness of the network itself")
    solution = largest_modulus(manifold, goal.strain)
    compressed = int(np.sum(solution.value.sigma < 0))
    if compressed and signs == "positive":
        raise InputError(
            f"the largest modulus for this strain compresses {compressed} edges: allow it with signs='any', or choose "
            "another method"
        )
    stats, details = solution.stats, solution.stats.details
    residual = _residual(manifold, goal, solution.value)[1] if solution.ok else np.nan
    if solution.ok and _is_bulk(manifold, goal):
        details["value_error"] = transition_modulus_bound(goal, solution.value)
    elif solution.ok:
        # Value and bound are both rounded, and the value is at most the exact bound.
        rounding = EPS * manifold.network.n_edges * details["bound"]
        details["value_error"] = abs(details["bound"] - details["objective"]) + rounding
    return Solution(solution.value, solution.status, replace(stats, residual=residual))


def _equal_lengths(manifold: CriticalManifold) -> Solution[CriticalConfiguration]:
    network = manifold.network
    solution = critical_from_lengths(manifold, np.ones(network.n_edges), "conic", throw=False)
    stats = solution.stats
    value, residual, details = solution.value, np.nan, {**stats.details, "objective": np.nan}
    if solution.ok:
        variance, residual = _residual(manifold, LengthVariance(), value)
        # The least variance is zero.
        details |= {"objective": variance, "value_error": variance}
    return Solution(value, solution.status, replace(stats, residual=residual, details=details))


def _residual(manifold: CriticalManifold, goal: Objective, value: CriticalConfiguration) -> tuple[float, float]:
    """Value of an objective at a configuration, and the largest component of dO/dσ."""
    evaluation = evaluate(manifold, goal, value.sigma)
    return evaluation.value, float(np.abs(evaluation.gradient).max())


def _descend(
    landscape: Landscape, method: str, sigma: Array, tolerance: float, max_steps: int | None
) -> Solution[CriticalConfiguration]:
    manifold = landscape.manifold
    end, saddles = _settle(landscape, method, landscape.unknowns(sigma), tolerance, max_steps)
    reached = manifold.solve(landscape.sigma(end.point.x))
    status, value = end.status, reached.value
    details: dict[str, object] = {"objective": landscape.sign * end.point.value, **saddles, **landscape.told()}
    if status in (Status.edge_collapse, Status.slack_edges):
        details = _limit(end, value, landscape.sign)
        value = manifold.configuration(landscape.sigma(landscape.last_sound))
    elif landscape.runs_away(end) and np.isfinite(landscape.last_sound).all():
        limit = f"the value tends to {details['objective']:.8g} as the prestress matrix turns singular and lengths grow"
        status, details = Status.singular, {**details, "note": f"{limit} without end"}
        value = manifold.configuration(landscape.sigma(landscape.last_sound))
    elif not reached.ok:
        # A method that ran away ends where no configuration is.
        status, details = reached.status, {**details, "objective": np.nan}
    stats = Stats(method, end.iterations, end.evaluations, end.point.residual, details)
    return Solution(value, status, replace(stats, condition=reached.stats.condition, error_bound=value.error_bound))


def _limit(end: Minimum, value: CriticalConfiguration, sign: float) -> dict[str, object]:
    """The infimum that a descent heads for without attaining it: its value, and the edges that vanish or fall slack.

    A vanishing length is ∝ 1/σ and brings a gain ∝ 1/σ, a vanishing stress one ∝ σ: what is left to gain there is the
    slope along log σ.
    """
    slope = end.point.gradient
    if end.status is Status.edge_collapse:
        # Short edges that gain by being shorter: others may be short by an isogonal mode, at no gain.
        gain = np.where(value.lengths < 0.5 * SOUND * value.lengths.mean(), -slope / value.lengths, 0.0)
        edges, fate = np.flatnonzero(gain > 0.1 * gain.max()), "shrink to zero length"
    else:
        edges, fate = np.flatnonzero((value.sigma < 1e3 * FADED) & (slope > 0)), "lose their tension"
    left = float(np.abs(slope[edges]).sum())
    limit = sign * (end.point.value - left)
    named = ", ".join(map(str, edges))
    return {
        "objective": limit,
        "uncertainty": left + float(np.abs(np.delete(slope, edges)).sum()),
        "collapsed_edges" if end.status is Status.edge_collapse else "slack_edges": edges,
        "note": f"edges {named} {fate} on the way to the infimum {limit:.8g}, which is not attained",
    }


def _settle(
    landscape: Landscape, method: str, x: Array, tolerance: float, max_steps: int | None
) -> tuple[Minimum, dict[str, int]]:
    """The end of a descent, and of others from beside it as long as it is a saddle; and how many saddles there were."""
    end = _minimise(landscape, method, x, tolerance, max_steps)
    steps, evaluations, saddles = end.iterations, end.evaluations, 0
    while end.status is Status.ok and end.point.residual <= _STATIONARY:
        direction, products = downhill(landscape, end.point)
        evaluations += products
        if direction is None:
            return Minimum(end.point, end.status, steps, evaluations), {"saddles": saddles}
        saddles += 1
        lower, tried = aside(landscape, end.point, direction)
        evaluations += tried
        left = None if max_steps is None else max_steps - steps
        if lower is None or left == 0 or saddles > _MAX_SADDLES:
            end = replace(end, status=Status.stalled if lower is None else Status.step_limit)
            break
        end = _minimise(landscape, method, lower.x, tolerance, left)
        steps, evaluations = steps + end.iterations, evaluations + end.evaluations
    return Minimum(end.point, end.status, steps, evaluations), {"saddles": saddles} if saddles else {}


def _minimise(landscape: Landscape, method: str, x: Array, tolerance: float, max_steps: int | None) -> Minimum:
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
