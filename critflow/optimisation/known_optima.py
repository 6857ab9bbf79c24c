"""Optima that are known without a descent: the largest moduli and the least C_B in closed form, and equal lengths.

The largest modulus has the configuration of `largest_modulus`, the least C_B that of the largest B_0.  The length
variance is zero where all lengths are equal, which `critical_from_lengths` finds exactly, and the iteration of
`length_iteration` to a rough tolerance.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from critflow.critical.manifold import CriticalConfiguration, CriticalManifold
from critflow.critical.modulus_error import transition_modulus_error
from critflow.critical.quantity import Evaluation, Quantity, evaluate, evaluate_at
from critflow.critical.transition import TransitionModulus
from critflow.critical.variances import LengthVariance
from critflow.lengths.from_lengths import critical_from_lengths
from critflow.lengths.length_iteration import iterate_lengths
from critflow.linalg.tolerances import EPS
from critflow.networks.network import Array
from critflow.optimisation.largest_modulus import largest_modulus
from critflow.optimisation.optimum import Optimum
from critflow.result import InputError, Solution, Status

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
