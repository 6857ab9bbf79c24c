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
from functools import partial

import numpy as np
import scipy
import scipy.sparse as sp
from numpy.typing import ArrayLike

from critflow.arguments import of_kind
from critflow.calls import running
from critflow.checks import edge_values
from critflow.deformation import Deformable
from critflow.descent import DESCENTS, Observer, Optimum, SignedStressObjective, StressObjective, descend
from critflow.lengths import critical_from_lengths, iterate_lengths
from critflow.manifold import NO_LENGTH, CriticalConfiguration, CriticalManifold, require_one_self_stress
from critflow.networks import Array, Network
from critflow.numerics import EPS, dot, power_of_two
from critflow.quantities import (
    PENALTY_THRESHOLD,
    Evaluation,
    LengthVariance,
    PenalisedModulus,
    Quantity,
    TransitionModulus,
    evaluate,
    evaluate_at,
    force_map,
    is_dilation,
    only_positive,
    own,
    require_exact_hessian,
    require_valid,
    transition_modulus,
    transition_modulus_error,
    vanishes,
)
from critflow.quantity_names import quantity
from critflow.result import InputError, Solution, SolveError, Status
from critflow.sparse import spread_columns
from critflow.taut_edges import unknown_configuration

# How much compression the largest modulus of a planar network needs: a linear program over isogonal modes.


def least_compressed_length(network: Network | CriticalManifold, strain: Deformable) -> float:
    """The least total length of compressed edges of a planar configuration with the largest modulus.

    All these configurations have the forces T = kFL* and differ by isogonal modes.  With t = T/|T| and n ⊥ t:
        least Σ p,  p ≥ 0,  p ≥ −t·(g x + b),  n·(g x + b) = 0.
    """
    manifold = CriticalManifold.of(network)
    network = manifold.network
    if network.dimension != 2:
        raise InputError("configurations of one force network are found in two dimensions only")
    L_star = manifold.balance(network.stiffness).bond_vectors
    F, _ = force_map(network, L_star, transition_modulus(network, strain).symmetric)
    T = network.stiffness[:, None] * (L_star @ F.T)
    unit = T / np.linalg.norm(T, axis=1)[:, None]
    normal = unit @ QUARTER_TURN.T
    # The program has an absolute tolerance, 1e-7: lengths are in a unit of their own.
    length = power_of_two(network.spacing)
    n_edges, n_coordinates, b = network.n_edges, 2 * len(network.free), network.boundary_vectors / length
    program = scipy.optimize.linprog(
        np.repeat([0.0, 1.0], [n_coordinates, n_edges]),
        A_ub=sp.hstack([-spread_columns(network, unit), -sp.eye_array(n_edges)]),
        b_ub=dot(unit, b),
        A_eq=sp.hstack([spread_columns(network, normal), sp.csr_array((n_edges, n_edges))]),
        b_eq=-dot(normal, b),
        bounds=[(None, None)] * n_coordinates + [(0, None)] * n_edges,
    )
    if program.status != 0:
        raise SolveError(f"no configuration has the largest modulus for this strain: {program.message}")
    return length * float(program.fun)


# The largest modulus of a network over all stresses in closed form, with the configuration that attains it.
#
# With L* the configuration at σ = k, virtual work gives Σσ L·(A + W)L = Σ T·(A + W)L* for every stress, T = σL and any
# antisymmetric W, so by Cauchy–Schwarz (`GenericModulus`)
#     μ_A ≤ min_W (1/V) Σ k|(A + W)L*|²,
# for any signs of σ.  Equality requires the force network T = k(A + W)L*, whose stress tensor is symmetric for the best
# W.  For a dilation that is σ = k.  For other strains T is not parallel to L*: in two dimensions the lengths in the
# directions of T that close are the solution of one more linear system, and some are negative, which is compression.

BALANCED = 1e-8  # relative force balance, and relative distance from the bound, of a modulus that attains its bound
# Determinant of the map F of forces, over |F|², below which all forces count as parallel: lengths grow as its inverse.
PARALLEL_FORCES = 1e-9

QUARTER_TURN = np.array([[0.0, -1.0], [1.0, 0.0]])


def largest_modulus(network: Network | CriticalManifold, strain: Deformable) -> Optimum:
    """The configuration nearest to L* that attains `upper_bound`, stresses of both signs allowed.

    Nearest in Σk|L − L*|², unless the forces are nearly parallel: all others differ by isogonal modes.
    `Status.edge_collapse` or `Status.singular` and NaN where an edge of it has no length or all forces are parallel, as
    for uniaxial strains of isotropic networks, so that they close around no cell; the objective is then the bound, a
    limit: strains next to it attain theirs.  Where the bound is zero every configuration attains it, and that of σ = k
    is returned.
    Raises `InputError` in three dimensions except for dilations: such forces seldom close there.
    """
    manifold = CriticalManifold.of(network)
    network, modulus, shortest = manifold.network, transition_modulus(manifold.network, strain), 1.0
    A, k = modulus.symmetric, network.stiffness
    if not is_dilation(A) and network.dimension != 2:
        raise InputError("in three dimensions only the largest modulus of a dilation has a known configuration")
    balance = manifold.balance(k * np.sqrt(network.n_edges / (k @ k)))
    F, moment = force_map(network, balance.bond_vectors, A)
    bound, zero = float(np.trace(F @ moment @ F.T)) / network.volume, vanishes(F, moment, A)
    if zero or is_dilation(A):
        # F = A of a dilation is isotropic: the configuration is L* itself.
        solution: Solution[CriticalConfiguration] = manifold.solve(balance.sigma, balance=balance)
    else:
        solution, shortest = _closed(manifold, balance.bond_vectors, F, A, bound)
    here = solution.value
    stats = replace(solution.stats, method="closed_form", steps=0, residual=np.nan)
    value = modulus.evaluate(here)[0]
    optimum = Optimum(here, Status.ok, stats, objective=value, bound=_covering(bound, value, network.n_edges))
    if here.residual < BALANCED and (zero or abs(optimum.gap) < BALANCED) and shortest > NO_LENGTH:
        edges = here.collapsed_edges
        note = f"edges {', '.join(map(str, edges))} have no length there" if len(edges) else ""
        if not np.array_equal(here.sigma, balance.sigma):
            balance = manifold.balance(here.sigma)
        stats = replace(stats, residual=evaluate_at(balance, modulus).residual)
        return replace(optimum, stats=stats, collapsed_edges=edges, note=note)
    # Forces that are all parallel, or an edge that vanishes: the bound is approached, not attained.
    status = Status.edge_collapse if shortest <= NO_LENGTH else Status.singular if solution.ok else solution.status
    return replace(optimum, value=unknown_configuration(network), status=status, objective=bound)


def _covering(bound: float, value: float, n_edges: int) -> float:
    """The bound, or the value that attains it and exceeds it by the rounding of two sums over the edges."""
    return value if 0 < value - bound <= n_edges * EPS * bound else bound


def _closed(
    manifold: CriticalManifold, L_star: Array, F: Array, A: Array, bound: float
) -> tuple[Solution[CriticalConfiguration], float]:
    """The configuration with forces T = kFL*, and its shortest length over the mean."""
    k, parallel = manifold.network.stiffness, abs(float(np.linalg.det(F))) <= PARALLEL_FORCES * float(np.sum(F**2))
    B = F.T @ QUARTER_TURN.T
    for stretched in (False, True):
        if stretched:
            # Others with these forces: of L̃ = BL with B = FᵀJᵀ and n·L = L*·L̃ the constraints are not nearly dependent.
            L = np.linalg.solve(B, _across(manifold, L_star @ B.T, L_star).T).T
        else:
            L = _across(manifold, L_star, L_star @ F.T @ QUARTER_TURN.T)
        square = dot(L, L)
        solution = manifold.solve(k * dot(L_star @ F.T, L) / np.maximum(square, np.finfo(float).tiny))
        if parallel or abs(TransitionModulus(A).evaluate(solution.value)[0] / bound - 1) < BALANCED:
            break
    return solution, float(np.sqrt(square.min()) / np.sqrt(square).mean())


def _across(manifold: CriticalManifold, start: Array, normals: Array) -> Array:
    """L = start + g u (N_b, 2) without components along the normals n, n·L = 0, with the least Σk|g u|².

    Since gᵀ(k n) = 0, the constraints have the self-stress k, and this is a system of stresses and displacements.
    """
    network = manifold.network
    factor = manifold.saddle.factorize(network.stiffness, normals)
    u, _, _ = factor.solve(np.zeros((len(network.free), 2)), -dot(normals, start))
    return np.asarray(start + network.free_incidence @ u)


# Optima that are known without a descent: the largest moduli and the least C_B in closed form, and equal lengths.
#
# The largest modulus has the configuration of `largest_modulus`, the least C_B that of the largest B_0.  The length
# variance is zero where all lengths are equal, which `critical_from_lengths` finds exactly, and the iteration of
# `length_iteration` to a rough tolerance.

# Tolerance of dO/dσ times N_b above which the iteration towards equal lengths alone is faster than with Newton's method
# at its end: the same 15 to 35 steps for 100 to 10,000 vertices.
ROUGH = 1e-5


def known_optimum(
    manifold: CriticalManifold, quantity: Quantity, positive: bool, tolerance: float | None
) -> Optimum | None:
    """The optimum of a quantity where it is known without a descent, and costs less than one; else None.

    tolerance  of dO/dσ for equal lengths; None where a descent is prescribed
    """
    if isinstance(quantity, TransitionModulus):
        # A configuration with no more compression than the signs allow is known.
        known = quantity.is_bulk or (not positive and manifold.network.dimension == 2)
        return best_in_closed_form(manifold, quantity, positive) if known else None
    if positive and (stress := quantity.best_stress(manifold)) is not None:
        return _at_best_stress(manifold, quantity, stress)
    if not isinstance(quantity, LengthVariance) or not positive or tolerance is None:
        return None
    if tolerance * manifold.network.n_edges < ROUGH:
        optimum = equal_lengths(manifold, quantity, positive)
        # Where edges fall slack the least variance is not zero.
        return optimum if optimum.ok else None
    return _nearly_equal_lengths(manifold, quantity, tolerance)


def best_in_closed_form(manifold: CriticalManifold, quantity: Quantity, positive: bool) -> Optimum:
    """The largest modulus, or the best value whose stress is known, by the method "closed_form"."""
    if positive and (stress := quantity.best_stress(manifold)) is not None:
        return _at_best_stress(manifold, quantity, stress)
    if not isinstance(quantity, TransitionModulus):
        raise InputError("a closed form is known for moduli without a penalty only: choose another method")
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


def _at_best_stress(manifold: CriticalManifold, quantity: Quantity, stress: Array) -> Optimum:
    """The optimum at a stress that attains the smallest or largest value of `Quantity.extreme`."""
    solution = manifold.solve(stress)
    if not solution.ok:
        return Optimum(solution.value, solution.status, solution.stats, solution.note, objective=np.nan)
    here = evaluate(manifold, quantity, solution.value.sigma)
    best = quantity.extreme(manifold)[quantity.maximise]
    stats = replace(solution.stats, method="closed_form", steps=0, residual=here.residual)
    error = partial(float, abs(here.value - best) + EPS * manifold.network.n_edges * abs(best))
    return Optimum(solution.value, Status.ok, stats, objective=here.value, error_of=error)


def equal_lengths(manifold: CriticalManifold, quantity: Quantity, positive: bool) -> Optimum:
    """The configuration of equal lengths, whose length variance is zero, by the method "conic"."""
    if not isinstance(quantity, LengthVariance):
        raise InputError("the cone program finds the least length variance only: choose another method")
    solution = critical_from_lengths(manifold, np.ones(manifold.network.n_edges), throw=False)
    here = evaluate(manifold, quantity, solution.value.sigma) if solution.ok else None
    optimum = _of_equal_lengths(solution, "conic", solution.stats.steps, here)
    return replace(optimum, note=solution.note, slack_edges=solution.slack_edges)


def _nearly_equal_lengths(manifold: CriticalManifold, quantity: Quantity, tolerance: float) -> Optimum | None:
    """The configuration of equal lengths to a rough tolerance, by the iteration; None where that ends before."""
    n_edges = manifold.network.n_edges
    for step, (balance, deviation) in enumerate(iterate_lengths(manifold, np.ones(n_edges))):
        if deviation > 2 * tolerance * n_edges:
            continue  # The gradient, which costs as much as a step, is about two deviations an edge.
        here = evaluate_at(balance, quantity)
        if here.residual < tolerance:
            solution = manifold.solve(balance.sigma, balance=balance)
            return _of_equal_lengths(solution, "iteration", step, here) if solution.ok else None
    return None


def _of_equal_lengths(
    solution: Solution[CriticalConfiguration], method: str, steps: int, here: Evaluation | None
) -> Optimum:
    """The optimum at a configuration of equal lengths."""
    variance, residual = (here.value, here.residual) if here else (np.nan, np.nan)
    # An optimum of the stresses is of springs, without rest lengths.
    value = replace(solution.value, rest_lengths=None)
    stats = replace(solution.stats, method=method, steps=steps, residual=residual)
    # The least variance is zero.
    return Optimum(value, solution.status, stats, objective=variance, error_of=partial(float, variance))


KNOWN = {"closed_form": best_in_closed_form, "conic": equal_lengths}
"""Methods without a descent."""

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
