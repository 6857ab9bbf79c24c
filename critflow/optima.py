"""Optimisation over all critical configurations: an objective in, the best configuration out.

Stresses of a result are scaled to Σσ² = N_b.  The residual of an optimum is the largest component of dO/dσ, the
gradient projected on the stresses of that scale.  The statistics contain condition and error bound of the configuration
for its stress.  With stresses of any sign a descent may cross stresses whose prestress matrix is singular, which have
no configuration.

A least V_τ and a largest B_0 are not unique where three edges meet at every vertex of the plane: isogonal modes keep
tensions and moduli, and change σ, coordinates and growth.  `start` decides which one is returned.

Optima that are known without a descent: the largest moduli in closed form (`largest_modulus`), the least C_B, which has
the configuration of the largest B_0, and equal lengths, whose length variance is zero.  `critical_from_lengths` finds
equal lengths exactly, and the iteration to lengths to a rough tolerance.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from critflow.arguments import edge_values, of_kind
from critflow.calls import running
from critflow.deformation import Deformable
from critflow.descent import DESCENTS, Descent, Observer, Optimum, SignedDescent, descend
from critflow.lengths import critical_from_lengths, iterate_lengths
from critflow.manifold import NO_LENGTH, CriticalConfiguration, CriticalManifold, require_one_stress_by_count
from critflow.networks import Array, Network
from critflow.numerics import EPS, dot, power_of_two
from critflow.quantities import (
    ISOTROPIC,
    PENALTY_THRESHOLD,
    LengthVariance,
    PenalisedModulus,
    Quantity,
    TransitionModulus,
    evaluate,
    force_map,
    is_dilation,
    own,
    quantity,
    require_exact_hessian,
    require_valid,
    transition_modulus,
    transition_modulus_error,
)
from critflow.result import InputError, Solution, Status
from critflow.taut_edges import unknown_configuration

METHODS = (*DESCENTS, "closed_form", "conic")
# Tolerance of dO/dσ times N_b above which the iteration towards equal lengths alone is faster than with Newton's method
# at its end: the same 15 to 35 steps for 100 to 10,000 vertices.
ROUGH = 1e-5
BALANCED = 1e-8  # relative force balance, and relative distance from the bound, of a modulus that attains its bound
# Determinant of the map F of forces, over |F|², below which all forces count as parallel: lengths grow as its inverse.
PARALLEL_FORCES = 1e-9
QUARTER_TURN = np.array([[0.0, -1.0], [1.0, 0.0]])


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
    method     "fire", "lbfgs", "newton"; "closed_form" for moduli without a penalty (in space B_0 alone) and "C_B";
               "conic" for V_L, exactly; "auto": the cheapest that reaches the tolerance
    signs      "positive": every edge under tension; "any": compression too, and "G_0" without penalty
    start      initial σ, (N_b,); 1 on every edge by default
    tolerance  of the largest dO/dσ in units of O; an end is tested for a saddle below 1e-12, and from symmetric starts
               below 1e-8
    max_steps  limit of the steps from each start, in all parts of the method together
    starts     number of starts; from the second on random, |N(0, 1)|, drawn from `rng`; the best optimum is returned
    observe    called with (step, value, σ, L) at the start and after every step; a true value ends it, `step_limit`

    An optimum that is not attained has a status: `Status.edge_collapse` for an infimum of V_tau, or a modulus in closed
    form, with an edge of zero length, `Status.slack_edges` for an infimum of V_L with slack edges, `Status.singular`
    where lengths grow without end; the objective is then the limit.  An optimum of a descent may be local.  The note of
    one that needs no descent names the options that had no effect.
    Raises `InputError` for bad arguments, `SolveError` if not `ok` and `throw`. Many parameters: each is one choice.

    >>> import critflow as cf
    >>> stiffest = cf.optimize(cf.voronoi_network(n_vertices=20, seed=1), 'B_0')
    >>> abs(stiffest.objective - stiffest.bound) < 1e-12
    True
    """
    manifold = CriticalManifold.of(network)
    objective = of_kind(str, Quantity, objective=objective)
    starts, max_steps = of_kind(int, starts=starts), of_kind(int, None, max_steps=max_steps)
    _check_options(method, signs, threshold, tolerance, max_steps, observe, throw)
    positive = signs == "positive"
    objective = objective_of(manifold.network, objective, threshold if positive else None)
    given = _starts(manifold.network.n_edges, start, starts, rng, positive)
    _check_objective(manifold, objective, method, positive, given[0])
    options = {"start": start is not None, "max_steps": max_steps is not None, "observe": observe is not None}
    best = known_optimum(manifold, objective, method, positive, None if any(options.values()) else tolerance)
    if best is None:
        # The best of the descents from all starts; of those with status `ok`, where there is one.
        kind, sign = Descent if positive else SignedDescent, -1 if objective.maximise else 1
        ends = [descend(kind(manifold, objective, observe), one, method, tolerance, max_steps) for one in given]
        first = min([end for end in ends if end.ok] or ends, key=lambda end: sign * end.objective)
        best = replace(first, start=ends.index(first), starts=np.array([end.objective for end in ends]))
    elif best.ok and (unused := [name for name, chosen in (options | {"starts": starts > 1}).items() if chosen]):
        idle = f"no descent is needed, so that {', '.join(unused)} had no effect: choose method='lbfgs' for one"
        best = replace(best, note="; ".join(filter(None, (best.note, idle))))
    return best.or_raise("no optimum") if throw else best


def _check_options(
    method: str,
    signs: str,
    threshold: float,
    tolerance: float,
    max_steps: int | None,
    observe: Observer | None,
    throw: bool,
) -> None:
    of_kind(bool, throw=throw)
    of_kind(str, method=method, signs=signs)
    of_kind(float, threshold=threshold, tolerance=tolerance)
    of_kind(Callable, None, observe=observe)
    if method not in METHODS:
        raise InputError(f"no method is called {method!r}: choose one of {', '.join(METHODS)}")
    if not tolerance > 0:
        raise InputError(f"the tolerance must be positive, not {tolerance}")
    if not 0 < threshold < np.inf:
        raise InputError(f"the threshold must be positive and finite, not {threshold}: stresses stay above it")
    if max_steps is not None and max_steps < 0:
        raise InputError(f"max_steps must be a whole number of at least 0, or None, not {max_steps!r}")
    if signs not in ("positive", "any"):
        raise InputError(f"signs must be 'positive' or 'any', not {signs!r}")


def _check_objective(manifold: CriticalManifold, quantity: Quantity, method: str, positive: bool, start: Array) -> None:
    # The largest bulk modulus of all stresses and all configurations is at σ = k, which is positive.
    if quantity.one_self_stress and positive and not (isinstance(quantity, TransitionModulus) and quantity.is_bulk):
        require_one_stress_by_count(manifold.network)
    if not own(quantity):
        require_valid(quantity, manifold.balance(start))
    if method == "newton":
        require_exact_hessian(manifold, quantity)


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


def known_optimum(
    manifold: CriticalManifold, quantity: Quantity, method: str, positive: bool, tolerance: float | None
) -> Optimum | None:
    """The optimum by "closed_form" or "conic", and by "auto" where it costs less than a descent; else None.

    tolerance  of dO/dσ for equal lengths; None where a descent is prescribed
    """
    if method == "conic":
        if not isinstance(quantity, LengthVariance):
            raise InputError("the cone program finds the least length variance only: choose another method")
        return equal_lengths(manifold, quantity)
    if method not in ("closed_form", "auto"):
        return None
    if isinstance(quantity, TransitionModulus):
        # A configuration with no more compression than the signs allow is known.
        known = quantity.is_bulk or (not positive and manifold.network.dimension == 2)
        return best_modulus(manifold, quantity, positive) if known or method == "closed_form" else None
    if positive and isinstance(best := quantity.best_known(manifold), Optimum):
        return best
    if method == "closed_form":
        raise InputError("a closed form is known for moduli without a penalty only: choose another method")
    if not isinstance(quantity, LengthVariance) or not positive or tolerance is None:
        return None
    optimum = equal_lengths(manifold, quantity, tolerance if tolerance * manifold.network.n_edges >= ROUGH else None)
    # Where edges fall slack the least variance is not zero.
    return optimum if optimum is not None and optimum.ok else None


def equal_lengths(manifold: CriticalManifold, quantity: Quantity, tolerance: float | None = None) -> Optimum | None:
    """The configuration of equal lengths, V_L = 0: by the cone program, or by the iteration to a rough tolerance.

    None where the iteration ends before.
    """
    n_edges, slack = manifold.network.n_edges, {}
    # Logarithms of length ratios have the same bits in all units of 2ⁿ.
    equal = np.full(n_edges, power_of_two(manifold.network.spacing))
    if tolerance is None:
        solution: Any = critical_from_lengths(manifold, equal, throw=False)
        here = evaluate(manifold.balance(solution.value.sigma), quantity) if solution.ok else None
        method, steps, slack = "conic", solution.stats.steps, {"slack_edges": solution.slack_edges}
    else:
        for step, (balance, deviation) in enumerate(iterate_lengths(manifold, equal)):
            # The gradient, which costs as much as a step, is about two deviations an edge.
            if deviation <= 2 * tolerance * n_edges and (here := evaluate(balance, quantity)).residual < tolerance:
                method, steps = "iteration", step
                break
        else:
            return None
        solution = manifold.solve(balance.sigma, balance=balance)
    variance, residual = (here.value, here.residual) if here else (np.nan, np.nan)
    # An optimum of the stresses is of springs, without rest lengths; the least variance is zero.
    value, error = replace(solution.value, rest_lengths=None), partial(float, variance)
    stats = replace(solution.stats, method=method, steps=steps, residual=residual)
    return Optimum(value, solution.status, stats, solution.note, objective=variance, error_of=error, **slack)


def best_modulus(manifold: CriticalManifold, quantity: TransitionModulus, positive: bool) -> Optimum:
    """The largest modulus with its error; refused where its configuration has more compression than the signs allow."""
    optimum = largest_modulus(manifold, quantity.symmetric)
    compressed = int(np.sum(optimum.value.sigma < 0))
    if compressed and positive:
        raise InputError(
            f"the largest modulus for this strain compresses {compressed} edges: allow it with signs='any', or choose "
            "another method"
        )
    if not optimum.ok:
        return optimum
    if quantity.is_bulk:
        return replace(optimum, error_of=partial(transition_modulus_error, quantity.symmetric, optimum.value))
    # Value and bound are both rounded, and the value is at most the exact bound.
    rounding = EPS * manifold.network.n_edges * optimum.bound
    return replace(optimum, error_of=partial(float, abs(optimum.bound - optimum.objective) + rounding))


def largest_modulus(network: Network | CriticalManifold, strain: Deformable) -> Optimum:
    """The configuration nearest to L* that attains `upper_bound`, stresses of both signs allowed.

    With L* the configuration at σ = k, virtual work gives Σσ L·(A + W)L = Σ T·(A + W)L* for every stress, T = σL and
    any antisymmetric W, so by Cauchy–Schwarz (`GenericModulus`)
        μ_A ≤ min_W (1/V) Σ k|(A + W)L*|²,
    for any signs of σ, with equality for the forces T = k(A + W)L*, whose stress tensor is symmetric for the best W.

    Nearest in Σk|L − L*|², unless the forces are nearly parallel: all others differ by isogonal modes.
    `Status.edge_collapse` or `Status.singular` and NaN where an edge of it has no length or all forces are parallel, as
    for uniaxial strains of isotropic networks, so that they close around no cell; the objective is then the bound, a
    limit: strains next to it attain theirs.  Where the bound is zero every configuration attains it, and that of σ = k
    is returned.
    Raises `InputError` in three dimensions except for dilations: such forces seldom close there.
    """
    manifold = CriticalManifold.of(network)
    network, modulus, shortest = manifold.network, transition_modulus(manifold.network, strain), 1.0
    A, k, n_edges = modulus.symmetric, network.stiffness, network.n_edges
    if not is_dilation(A) and network.dimension != 2:
        raise InputError("in three dimensions only the largest modulus of a dilation has a known configuration")
    balance = manifold.balance(k * np.sqrt(n_edges / (k @ k)))
    F, moment = force_map(network, balance.bond_vectors, A)
    trace = np.trace(F @ moment @ F.T)
    # Whether the strain changes no length to first order, up to rounding.
    bound, zero = float(trace) / network.volume, trace <= ISOTROPIC**2 * np.sum(A**2) * np.trace(moment)
    if zero or is_dilation(A):
        # F = A of a dilation is isotropic: the configuration is L* itself.
        solution: Solution[CriticalConfiguration] = manifold.solve(balance.sigma, balance=balance)
    else:
        solution, shortest = _with_forces(manifold, balance.bond_vectors, F, modulus, bound)
    here = solution.value
    stats, value = replace(solution.stats, method="closed_form", steps=0, residual=np.nan), modulus.evaluate(here)[0]
    # A value that attains the bound may exceed it by the rounding of two sums over the edges.
    covering = value if 0 < value - bound <= n_edges * EPS * bound else bound
    optimum = Optimum(here, Status.ok, stats, objective=value, bound=covering)
    if here.residual < BALANCED and (zero or abs(optimum.gap) < BALANCED) and shortest > NO_LENGTH:
        edges = here.collapsed_edges
        note = f"edges {', '.join(map(str, edges))} have no length there" if len(edges) else ""
        if not np.array_equal(here.sigma, balance.sigma):
            balance = manifold.balance(here.sigma)
        stats = replace(stats, residual=evaluate(balance, modulus).residual)
        return replace(optimum, stats=stats, collapsed_edges=edges, note=note)
    # Forces that are all parallel, or an edge that vanishes: the bound is approached, not attained.
    status = Status.edge_collapse if shortest <= NO_LENGTH else Status.singular if solution.ok else solution.status
    return replace(optimum, value=unknown_configuration(network), status=status, objective=bound)


def _with_forces(
    manifold: CriticalManifold, L_star: Array, F: Array, modulus: TransitionModulus, bound: float
) -> tuple[Solution[CriticalConfiguration], float]:
    """The planar configuration with forces T = kFL*, and its shortest length over the mean.

    T is not parallel to L*: lengths in the directions of T that close are the solution of one more linear system, and
    some are negative, which is compression.
    """
    network, k = manifold.network, manifold.network.stiffness
    parallel = abs(float(np.linalg.det(F))) <= PARALLEL_FORCES * float(np.sum(F**2))
    B = F.T @ QUARTER_TURN.T
    # L = L* + g u, n·L = 0 for n = JFL*; then others with these forces: of L̃ = BL with B = FᵀJᵀ and n·L = L*·L̃ the
    # constraints are not nearly dependent.
    for stretched, start, normals in ((False, L_star, L_star @ F.T @ QUARTER_TURN.T), (True, L_star @ B.T, L_star)):
        # Since gᵀ(k n) = 0, the constraints have the self-stress k, and this is a system of stresses and displacements.
        factor = manifold.saddle.factorize(k, normals)
        u, _, _ = factor.solve(np.zeros((len(network.free), 2)), -dot(normals, start))
        L = np.asarray(start + network.free_incidence @ u)
        if stretched:
            L = np.linalg.solve(B, L.T).T
        square = dot(L, L)
        solution = manifold.solve(k * dot(L_star @ F.T, L) / np.maximum(square, np.finfo(float).tiny))
        if parallel or abs(modulus.evaluate(solution.value)[0] / bound - 1) < BALANCED:
            break
    return solution, float(np.sqrt(square.min()) / np.sqrt(square).mean())
