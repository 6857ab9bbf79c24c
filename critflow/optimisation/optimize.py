"""Optimisation over all critical configurations: an objective in, the best configuration out.

1. Name → quantity, with the penalty for G_0 (`objective_of`).
2. Where the optimum is known without a descent, take it (`known_optima`).
3. Else the best of the descents from all starts (`descent`).

Stresses of a result are scaled to Σσ² = N_b.  The residual of an optimum is the largest component of dO/dσ, the
gradient projected on the stresses of that scale.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from critflow.arguments import of_kind
from critflow.calls import running
from critflow.critical.manifold import CriticalManifold, require_one_self_stress
from critflow.critical.quantity import Quantity, only_positive, own, require_exact_hessian, require_valid
from critflow.critical.transition import PENALTY_THRESHOLD, PenalisedModulus, TransitionModulus
from critflow.critical.vocabulary import quantity
from critflow.networks.checks import edge_values
from critflow.networks.network import Array, Network
from critflow.optimisation.descent import DESCENTS, SignedStressObjective, StressObjective, descend
from critflow.optimisation.descent_end import Observer
from critflow.optimisation.known_optima import KNOWN, known_optimum
from critflow.optimisation.optimum import Optimum
from critflow.result import InputError

METHODS = (*DESCENTS, *KNOWN)


@running("optimize")
def optimize(
    network: Network | CriticalManifold,
    objective: str | Quantity,
    method: str = "auto",
    *,
    signs: str = "positive",
    start: ArrayLike | None = None,
    starts: int = 1,
    rng: np.random.Generator | None = None,
    threshold: float = PENALTY_THRESHOLD,
    tolerance: float = 1e-12,
    max_steps: int | None = None,
    observe: Observer | None = None,
    throw: bool = True,
) -> Optimum:
    """The critical configuration that is best by an objective; `Optimum` lists the results.

    objective  a name such as "V_L", "V_tau" (least), "B_0", "G_0" (largest; the last with the penalty that keeps σ
               above about `threshold`), "C_B" (least), or a `Quantity`
    method     "fire", "lbfgs", "newton"; "closed_form" for moduli without a penalty, in three dimensions for the bulk
               modulus, and for "C_B"; "conic" for the length variance, exactly; "auto": the cheapest that reaches the
               tolerance
    signs      "positive": every edge under tension; "any": compression too, and "G_0" without penalty
    start      initial σ, (N_b,); 1 on every edge by default
    tolerance  of the largest dO/dσ in units of O; an end is tested for a saddle below 1e-12, and from symmetric starts
               below 1e-8
    max_steps  limit of the steps from each start, in all parts of the method together
    starts     number of starts; from the second on random, |N(0, 1)|, drawn from `rng`; the best optimum is returned
    observe    called with (step, value, σ, L) at the start and after every step of a descent; when it returns a true
               value the descent ends there, with `Status.step_limit`

    The statistics contain condition and error bound of the configuration for its stress.  With stresses of any sign a
    descent may cross stresses whose prestress matrix is singular, which have no configuration.
    An optimum that is not attained has a status: `Status.edge_collapse` for a tension variance whose infimum has an
    edge of zero length, `Status.slack_edges` for a length variance whose infimum has slack edges, `Status.singular`
    where lengths grow without end.  The objective is then the limit of the value.  Every optimum of a descent may be
    local: where no stress gives equal lengths, different starts end at different length variances.
    A least "V_tau" and a largest "B_0" are not unique where three edges meet at every vertex of the plane: isogonal
    modes keep tensions and moduli, and change σ, coordinates and growth.  `start` decides which one is returned.
    Raises `InputError` for bad arguments, `SolveError` when the status is not `ok` and `throw`.
    Many parameters: all after the method are options of a descent, by keyword only.

    >>> import critflow as cf
    >>> stiffest = cf.optimize(cf.voronoi_network(n_vertices=20, seed=1), 'B_0')
    >>> abs(stiffest.objective - stiffest.bound) < 1e-12
    True
    """
    manifold = CriticalManifold.of(of_kind(Network, CriticalManifold, network=network))
    objective = of_kind(str, Quantity, objective=objective)
    starts = of_kind(int, starts=starts)
    max_steps = of_kind(int, None, max_steps=max_steps)
    of_kind(bool, throw=throw)
    _check_options(method, signs, threshold, tolerance, max_steps, observe)
    positive = only_positive(signs)
    best = objective_of(manifold.network, objective, threshold if positive else None)
    given = _starts(manifold.network.n_edges, start, starts, rng, positive)
    _check_objective(manifold, best, method, positive, given[0])
    optimum = KNOWN[method](manifold, best, positive) if method in KNOWN else None
    if method == "auto":
        free = start is None and max_steps is None and observe is None
        optimum = known_optimum(manifold, best, positive, tolerance if free else None)
    if optimum is None:
        function = (StressObjective if positive else SignedStressObjective)(manifold, best)
        optimum = _best([descend(function, method, one, tolerance, max_steps, observe) for one in given], function.unit)
    return optimum.or_raise("no optimum") if throw else optimum


def _check_options(
    method: str, signs: str, threshold: float, tolerance: float, max_steps: int | None, observe: Observer | None
) -> None:
    of_kind(str, method=method, signs=signs)
    of_kind(float, threshold=threshold, tolerance=tolerance)
    of_kind(Callable, None, observe=observe)
    if method not in METHODS:
        raise InputError(f"no method is called {method!r}: choose one of {', '.join(METHODS)}")
    if not tolerance > 0:
        raise InputError(f"the tolerance must be positive, not {tolerance}")
    if max_steps is not None and max_steps < 0:
        raise InputError(f"max_steps must be a whole number of at least 0, or None, not {max_steps!r}")


def _check_objective(manifold: CriticalManifold, best: Quantity, method: str, positive: bool, start: Array) -> None:
    # The largest bulk modulus of all stresses and all configurations is at σ = k, which is positive.
    if best.one_self_stress and positive and not (isinstance(best, TransitionModulus) and best.is_bulk):
        require_one_self_stress(manifold.network)
    if not own(best):
        require_valid(best, manifold.balance(start))
    if method == "newton":
        require_exact_hessian(manifold, best)


def objective_of(network: Network, objective: str | Quantity, threshold: float | None = PENALTY_THRESHOLD) -> Quantity:
    """What `optimize` minimises or maximises: the quantity, and for the name G_0 the modulus with its penalty.

    threshold  r of the penalty; None without it
    """
    named = quantity(network, objective)
    if isinstance(objective, str) and named.name == "G_0" and threshold is not None:
        return PenalisedModulus(named, threshold)  # type: ignore[arg-type]
    return named


def _starts(m: int, start: ArrayLike | None, n: int, rng: np.random.Generator | None, positive: bool) -> list[Array]:
    """Stresses (m,) of all n starts: the given one or σ = 1, then random ones."""
    of_kind(np.ndarray, None, start=start)
    of_kind(np.random.Generator, None, rng=rng)
    if n < 1 or (n > 1 and rng is None):
        raise InputError("starts must be at least 1, and more than one start needs a random generator rng")
    first = np.ones(m) if start is None else edge_values(start, m, "start", positive)
    return [first, *(np.abs(rng.standard_normal(m)) for _ in range(n - 1) if rng is not None)]


def _best(optima: list[Optimum], unit: float) -> Optimum:
    """The best of several optima; one with status `ok` where there is one.

    unit  of the objective, with the sign of what is minimised
    """
    values = np.array([optimum.objective for optimum in optima])
    good = [n for n, optimum in enumerate(optima) if optimum.ok] or range(len(optima))
    best = min(good, key=lambda n: values[n] / unit)
    return replace(optima[best], start=best, starts=values)
