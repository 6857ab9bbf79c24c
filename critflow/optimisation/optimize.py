"""Optimisation over all critical configurations: an objective in, the best configuration out.

The unknowns are θ = log σ, so every stress stays positive, or σ itself where compression is allowed; results are
scaled to Σσ² = N_b.  The residual of an optimum is the largest component of dO/dσ, the gradient projected on the
stresses of that scale.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
from numpy.typing import ArrayLike

from critflow.arguments import checked
from critflow.critical.manifold import CriticalConfiguration, CriticalManifold, require_one_self_stress
from critflow.critical.quantity import Evaluation, Quantity, evaluate, evaluate_at
from critflow.critical.transition import PenalisedModulus, TransitionModulus, dilation
from critflow.critical.variances import LengthVariance
from critflow.critical.vocabulary import only_positive, quantity
from critflow.lengths.from_lengths import critical_from_lengths
from critflow.lengths.length_iteration import iterate_lengths
from critflow.linalg.tolerances import EPS
from critflow.networks.checks import edge_values
from critflow.networks.network import Array, Network
from critflow.optimisation.descent import DESCENTS, Observer, descend
from critflow.optimisation.largest_modulus import Optimum, largest_modulus
from critflow.optimisation.stress_objective import SignedStressObjective, StressObjective
from critflow.response.at_transition import transition_modulus_error
from critflow.result import InputError, Solution

# Tolerance of dO/dσ times N_b above which the iteration towards equal lengths alone is faster than with Newton's method
# at its end: the same 15 to 35 steps for 100 to 10,000 vertices.
ROUGH = 1e-5


@checked
def optimize(
    network: Network | CriticalManifold,
    objective: str | Quantity,
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
) -> Optimum:
    """The critical configuration that is best by an objective; `Optimum` lists the results.

    objective  a name such as "V_L", "V_tau" (least), "B_0", "G_0" (largest; the last with the penalty that keeps σ
               above about `threshold`), "C_B" (least), or a `Quantity`
    method     "fire", "lbfgs", "newton"; "closed_form" for moduli without a penalty, in three dimensions for the bulk
               modulus; "conic" for the length variance, exactly; "auto": the cheapest that reaches the tolerance
    signs      "positive": every edge under tension; "any": compression too, and "G_0" without penalty
    start      initial σ, (N_b,); 1 on every edge by default
    tolerance  of the largest dO/dσ in units of O; saddles are left above 1e-12 from symmetric starts, above 1e-8 never
    max_steps  limit of the steps from each start, in all parts of the method together
    starts     number of starts; from the second on random, |N(0, 1)|, drawn from `rng`; the best optimum is returned
    observe    called with (step, value, σ, L) at the start and after every step of a descent; when it returns a true
               value the descent ends there, with `Status.step_limit`

    The statistics contain condition and error bound of the configuration for its stress; these and its coordinates are
    computed when one of them is read first.  With stresses of any sign a descent may cross stresses whose prestress
    matrix is singular, which have no configuration.

    An optimum that is not attained has a status: `Status.edge_collapse` for a tension variance whose infimum has an
    edge of zero length, `Status.slack_edges` for a length variance whose infimum has slack edges, `Status.singular`
    where lengths grow without end.  The objective is then the limit of the value.  Every optimum of a descent may be
    local: where no stress gives equal lengths, different starts end at different length variances.
    Raises `InputError` for bad arguments, `SolveError` when the status is not `ok` and `throw`.

    Many parameters: all after the method are options of a descent, by keyword only.

    >>> import critflow as cf
    >>> found = cf.optimize(cf.voronoi_network(n_vertices=20, seed=1), 'B_0')
    >>> abs(found.objective - found.bound) < 1e-12
    True
    """
    _check_options(method, tolerance, max_steps)
    problem = _problem(CriticalManifold.of(network), objective, signs, threshold)
    if method == "newton" and not problem.goal.has_differential:
        raise InputError(f"Newton's method needs {problem.goal.name}.differential: define it, or choose 'lbfgs'")
    given = _starts(problem, start, starts, rng)
    if method == "closed_form" or (method == "auto" and _closed_form_pays(problem)):
        optimum = _closed_form(problem)
    elif method == "conic":
        optimum = _cone_program(problem)
    else:
        free = method == "auto" and start is None and max_steps is None and observe is None
        equal = _equal_lengths(problem, tolerance) if free else None
        optimum = equal or _best_descent(problem, given, method, tolerance, max_steps, observe)
    return optimum.or_raise("no optimum") if throw else optimum


def _check_options(method: str, tolerance: float, max_steps: int | None) -> None:
    if method not in METHODS:
        raise InputError(f"no method is called {method!r}: choose one of {', '.join(METHODS)}")
    if not tolerance > 0:
        raise InputError(f"the tolerance must be positive, not {tolerance}")
    if max_steps is not None and (not isinstance(max_steps, int | np.integer) or max_steps < 0):
        raise InputError(f"max_steps must be a whole number of at least 0, or None, not {max_steps!r}")


def objective_of(network: Network, objective: str | Quantity, threshold: float | None = 0.1) -> Quantity:
    """What `optimize` minimises or maximises: the quantity, and for the name G_0 the modulus with its penalty.

    threshold  r of the penalty; None without it
    """
    goal = quantity(network, objective)
    if isinstance(objective, str) and goal.name == "G_0" and threshold is not None:
        return PenalisedModulus(goal, threshold)  # type: ignore[arg-type]
    return goal


@dataclass(frozen=True, eq=False)
class _Problem:
    """An objective over the positive stresses of a network, or over stresses of any sign."""

    manifold: CriticalManifold
    goal: Quantity
    positive: bool

    @cached_property
    def is_bulk(self) -> bool:
        """Whether the objective is the modulus of a dilation."""
        A = dilation(self.manifold.network.dimension)
        return isinstance(self.goal, TransitionModulus) and np.array_equal(self.goal.symmetric, A)


def _problem(manifold: CriticalManifold, objective: str | Quantity, signs: str, threshold: float) -> _Problem:
    positive = only_positive(signs)
    problem = _Problem(manifold, objective_of(manifold.network, objective, threshold if positive else None), positive)
    if problem.goal.one_self_stress and positive and not problem.is_bulk:
        # The maximum of the bulk modulus over all stresses of all configurations is at σ = k, which is positive.
        require_one_self_stress(manifold.network)
    return problem


def _starts(problem: _Problem, start: ArrayLike | None, n: int, rng: np.random.Generator | None) -> list[Array]:
    """Stresses (N_b,) of all starts: the given one or σ = 1, then random ones."""
    m = problem.manifold.network.n_edges
    if n < 1 or (n > 1 and rng is None):
        raise InputError("starts must be at least 1, and more than one start needs a random generator rng")
    first = np.ones(m) if start is None else edge_values(start, m, "start", problem.positive)
    return [first, *(np.abs(rng.standard_normal(m)) for _ in range(n - 1) if rng is not None)]


def _best_descent(
    problem: _Problem,
    starts: list[Array],
    method: str,
    tolerance: float,
    max_steps: int | None,
    observe: Observer | None,
) -> Optimum:
    """The best of the descents from all starts; one with status `ok` where there is one."""
    objective = (StressObjective if problem.positive else SignedStressObjective)(problem.manifold, problem.goal)
    optima = [descend(objective, method, start, tolerance, max_steps, observe) for start in starts]
    values = np.array([optimum.objective for optimum in optima])
    good = [n for n, optimum in enumerate(optima) if optimum.ok] or range(len(optima))
    best = min(good, key=lambda n: values[n] / objective.unit)
    return replace(optima[best], start=best, starts=values)


def _closed_form(problem: _Problem) -> Optimum:
    """The largest modulus in closed form."""
    manifold, goal = problem.manifold, problem.goal
    if not isinstance(goal, TransitionModulus):
        raise InputError("a closed form is known for moduli without a penalty only: choose another method")
    optimum = largest_modulus(manifold, goal.symmetric)
    compressed = int(np.sum(optimum.value.sigma < 0))
    if compressed and problem.positive:
        raise InputError(
            f"the largest modulus for this strain compresses {compressed} edges: allow it with signs='any', or choose "
            "another method"
        )
    if not optimum.ok:
        return replace(optimum, stats=replace(optimum.stats, residual=np.nan))
    stats = replace(optimum.stats, residual=_residual(evaluate(manifold, goal, optimum.value.sigma)))
    if problem.is_bulk:
        error = partial(transition_modulus_error, dilation(manifold.network.dimension), optimum.value)
    else:
        # Value and bound are both rounded, and the value is at most the exact bound.
        rounding = EPS * manifold.network.n_edges * optimum.bound
        error = partial(float, abs(optimum.bound - optimum.objective) + rounding)
    return replace(optimum, stats=stats, error_of=error)


def _closed_form_pays(problem: _Problem) -> bool:
    """Whether a configuration of the largest value is known, with no more compression than the signs allow."""
    plane = problem.manifold.network.dimension == 2
    return isinstance(problem.goal, TransitionModulus) and (problem.is_bulk or (not problem.positive and plane))


def _cone_program(problem: _Problem) -> Optimum:
    """The configuration of equal lengths, whose length variance is zero."""
    manifold, goal = problem.manifold, problem.goal
    if not isinstance(goal, LengthVariance):
        raise InputError("the cone program finds the least length variance only: choose another method")
    found = critical_from_lengths(manifold, np.ones(manifold.network.n_edges), throw=False)
    here = evaluate(manifold, goal, found.value.sigma) if found.ok else None
    optimum = _least_variance(found, manifold, "conic", found.stats.steps, here)
    return replace(optimum, note=found.note, slack_edges=found.slack_edges)


def _least_variance(
    found: Solution[CriticalConfiguration], manifold: CriticalManifold, method: str, steps: int, here: Evaluation | None
) -> Optimum:
    """The optimum at a configuration of equal lengths."""
    variance, residual = (here.value, _residual(here)) if here else (np.nan, np.nan)
    # An optimum of the stresses is of springs, without rest lengths.
    value = replace(found.value, rest_lengths=None)
    stats = replace(found.stats, method=method, steps=steps, residual=residual)
    # The least variance is zero.
    return Optimum(value, found.status, stats, objective=variance, error_of=partial(float, variance))


def _equal_lengths(problem: _Problem, tolerance: float) -> Optimum | None:
    """The configuration of equal lengths, to a rough tolerance by the iteration alone.

    None for other objectives, and where edges fall slack: the least variance is then not zero.
    """
    manifold, goal = problem.manifold, problem.goal
    n_edges = manifold.network.n_edges
    if not isinstance(goal, LengthVariance) or not problem.positive:
        return None
    if tolerance * n_edges < ROUGH:
        exact = _cone_program(problem)
        return exact if exact.ok else None
    for step, (balance, deviation) in enumerate(iterate_lengths(manifold, np.ones(n_edges))):
        if deviation > 2 * tolerance * n_edges:
            continue  # The gradient, which costs as much as a step, is about two deviations an edge.
        here = evaluate_at(balance, goal)
        if _residual(here) < tolerance:
            found = manifold.solve(balance.sigma, balance=balance)
            return _least_variance(found, manifold, "iteration", step, here)
    return None


def _residual(here: Evaluation) -> float:
    """The largest component of dO/dσ, in the unit of O."""
    return float(np.abs(here.gradient).max()) / here.quantity.unit(here.balance.network)


METHODS = (*DESCENTS, "closed_form", "conic")
