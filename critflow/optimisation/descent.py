"""Descent of a quantity over all stresses of a network, in θ = log σ or, where compression is allowed, in σ itself.

With u the natural unit of O, and the sign − for quantities that are to be largest,

    minimise f(θ) = ±O(σ(θ))/u,   σ = c exp θ,   Σσ² = N_b.

1. Evaluate O at θ: solve P(σ) x = −gᵀ(σ ∘ b) for the bond vectors, and P(σ) y = gᵀ ∂O/∂L for the gradient,
       dO/dσ = ∂O/∂σ − L·(g y),   ∂f/∂θ = ±σ dO/dσ/u   (`TotalDeriv`).
2. Step by L-BFGS, FIRE or Newton's method (`critflow.minimisers`) until max |dO/dσ|/u is below the
   tolerance; "auto" continues with Newton's method where L-BFGS does not reach it.
3. After each step look whether an edge vanishes or falls slack, which ends the descent
   (`critflow.optimisation.descent_end`).
4. A descent that fails is repeated from its end with σ clipped to [median/3, 3 median].
5. A stationary end may be a saddle: leave it in a direction of negative curvature, and go on from 2
   (`critflow.optimisation.saddles`).
6. Return the optimum that belongs to the end (table in `critflow.optimisation.descent_end`).

The scale of σ changes no quantity, so that derivatives by the unknowns are those of σ without its scaling.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from critflow.critical.manifold import CriticalManifold
from critflow.critical.quantity import Evaluation, Quantity, evaluate, has_exact_hessian
from critflow.minimisers import METHODS, Fire, Function, Method, Minimum, Point, minimise
from critflow.networks.network import Array
from critflow.optimisation.descent_end import (
    NOT_ATTAINED,
    DescentMonitor,
    Observer,
    SignedDescentMonitor,
    optimum_at,
)
from critflow.optimisation.optimum import Optimum
from critflow.optimisation.saddles import minimise_past_saddles
from critflow.result import Status

# A failed descent is repeated with σ clipped to [median/MODERATE, MODERATE · median]: stresses that a bad start or a
# long step drove apart hardly change along the gradient.  With 10 or 100 a few starts of small networks return to
# limits that are no infima.
MODERATE = 3.0
# Change of log σ from a start at which an edge has no length, as one between vertices with the same neighbours has at
# equal stresses: no gradient leads away from it.
PERTURBATION = 0.3
REPEATS = 2  # descents repeated from moderate stresses
# With a residual below STATIONARY the end is always tested for a saddle, above STOPPED never, and between them if the
# start is symmetric: a rough tolerance stops a descent early on purpose, mostly far from saddles.
STOPPED, STATIONARY = 1e-8, 1e-12
SYMMETRIC = 1e-9  # distance of two components of a gradient, relative to all, of edges that are images of each other

# Minimisers of each method in turn: "auto" continues with Newton's method where gradients alone do not converge.
DESCENTS = {"fire": ("fire",), "lbfgs": ("lbfgs",), "newton": ("newton",), "auto": ("lbfgs", "newton")}
# Step limits: several times the steps that standard networks of 1,000 vertices need.
MAX_STEPS = {"fire": 200_000, "lbfgs": 3_000, "newton": 200}


class StressObjective(Function):
    """f = ±O(σ)/u as a function of θ = log σ (N_b,).  The state of a point is the `Evaluation` at its stress.

    unit  ±u, a value of O over that of f
    """

    monitor: type[DescentMonitor] = DescentMonitor

    def __init__(self, manifold: CriticalManifold, quantity: Quantity):
        self.manifold, self.quantity = manifold, quantity
        self.unit = (-1.0 if quantity.maximise else 1.0) * quantity.unit(manifold.network)

    @cached_property
    def exact(self) -> bool:
        """Whether products with the Hessian are exact."""
        return has_exact_hessian(self.manifold, self.quantity)

    def unknowns(self, sigma: Array) -> Array:
        """θ of a stress σ (N_b,)."""
        return np.log(sigma)

    def sigma(self, x: Array) -> Array:
        """σ of log-stresses θ, scaled to Σσ² = N_b."""
        sigma = np.exp(x - np.maximum.reduce(x))
        return sigma * math.sqrt(len(x) / (sigma @ sigma))

    def rate(self, x: Array, sigma: Array) -> tuple[Array | float, Array | float]:
        """First and second derivatives of each σ by its own unknown."""
        return sigma, sigma

    def moderate(self, x: Array) -> Array | None:
        """x with stresses clipped around their median; None where signs may change."""
        middle, width = np.median(x), np.log(MODERATE)
        return np.clip(x, middle - width, middle + width)

    @property
    def time_step(self) -> float:
        """A time step of FIRE: curvatures per edge are of order 1/N_b."""
        return 0.3 * np.sqrt(self.manifold.network.n_edges)

    def at(self, x: Array) -> Point:
        """Value and gradient at x (N_b,), by one factorisation."""
        # Trial points far from the optimum may overflow; a value that is not finite marks them.
        with np.errstate(all="ignore"):
            sigma = self.sigma(x)
            evaluation = evaluate(self.manifold, self.quantity, sigma)
        residual = float(np.maximum.reduce(np.abs(evaluation.gradient))) / abs(self.unit)
        gradient = self.rate(x, sigma)[0] * evaluation.gradient / self.unit
        return Point(x, evaluation.value / self.unit, gradient, residual if residual < np.inf else np.inf, evaluation)

    def preconditioner(self, point: Point) -> Array | float:
        return self.quantity.preconditioner(point.state.balance) / abs(self.unit)

    def hessian_product(self, point: Point, direction: Array) -> Array:
        """The Hessian at a point times a direction (N_b,), by two solves; of some quantities by differences."""
        evaluation: Evaluation = point.state
        product = evaluation.hessian_product if self.exact else evaluation.hessian_difference
        rate, second = self.rate(point.x, evaluation.balance.sigma)
        curved = rate * product(rate * direction)
        return (second * direction * evaluation.gradient + curved) / self.unit


class SignedStressObjective(StressObjective):
    """±O/u as a function of σ (N_b,) itself, whose signs may change, and with them the inertia of P(σ)."""

    monitor = SignedDescentMonitor

    def unknowns(self, sigma: Array) -> Array:
        return sigma.copy()

    def sigma(self, x: Array) -> Array:
        return x * np.sqrt(len(x) / (x @ x))

    def rate(self, x: Array, sigma: Array) -> tuple[Array | float, Array | float]:
        return np.sqrt(len(x) / (x @ x)), 0.0

    def moderate(self, x: Array) -> Array | None:
        return None


@dataclass(frozen=True, eq=False)
class Descent:
    """Descents of one objective by one of `DESCENTS`, which share a monitor."""

    objective: StressObjective
    method: str
    tolerance: float
    monitor: DescentMonitor

    def past_failures(self, x: Array, max_steps: int | None) -> Minimum:
        """The descent from x (N_b,), repeated from moderate stresses where it does not end at an optimum (4)."""
        end = self.once(x, max_steps)
        steps = end.steps
        for _ in range(REPEATS):
            left = None if max_steps is None else max_steps - steps
            failed = end.status in (*NOT_ATTAINED, Status.stalled, Status.singular)
            moderate = self.objective.moderate(end.point.x) if failed and left != 0 and not self.monitor.ended else None
            if moderate is not None and not end.steps:
                moderate = moderate + PERTURBATION * np.random.default_rng(0).standard_normal(len(moderate))
            if moderate is None or np.array_equal(moderate, end.point.x):
                break
            again = self.once(moderate, left)
            steps += again.steps
            if not _improves(again, end):
                break
            end = again
        return replace(end, steps=steps)

    def once(self, x: Array, max_steps: int | None) -> Minimum:
        """One descent from x (N_b,) by the minimisers of the method in turn (1 to 3)."""
        steps = 0
        for name in DESCENTS[self.method]:
            minimiser: Method[Any] = Fire(self.objective.time_step) if name == "fire" else METHODS[name]()
            left = MAX_STEPS[name] if max_steps is None else max_steps - steps
            end = minimise(self.objective, minimiser, x, self.tolerance, left, self.monitor, STATIONARY)
            steps += end.steps
            if end.status not in (Status.step_limit, Status.stalled) or self.monitor.ended or steps == max_steps:
                break
            x = end.point.x
        return replace(end, steps=steps)

    def may_be_saddle(self, end: Minimum) -> bool:
        """Whether an end is tested for a saddle (5)."""
        residual, gradient = end.point.residual, self.monitor.first_gradient
        if not STATIONARY < residual <= STOPPED:
            return residual <= STATIONARY
        return bool(np.diff(np.sort(gradient)).min(initial=np.inf) < SYMMETRIC * np.ptp(gradient))


def descend(
    objective: StressObjective,
    method: str,
    start: Array,
    tolerance: float,
    max_steps: int | None = None,
    observe: Observer | None = None,
) -> Optimum:
    """The optimum of an objective from a start σ (N_b,), by one of `DESCENTS`, with a status of `descent_end`."""
    monitor = objective.monitor(objective.manifold, objective.unit, observe)
    descent = Descent(objective, method, tolerance, monitor)
    end, saddles = minimise_past_saddles(
        objective, descent.past_failures, objective.unknowns(start), max_steps, descent.may_be_saddle
    )
    return optimum_at(end, saddles, monitor, method)


def _improves(again: Minimum, end: Minimum) -> bool:
    """Whether a repeated descent replaces the end of the first one."""
    ended = [one.status in (Status.ok, *NOT_ATTAINED) for one in (again, end)]
    if ended[0] != ended[1]:
        return ended[0]
    margin = 0.0
    if end.status in NOT_ATTAINED:
        # Two approaches to one infimum differ by their distances from it.
        margin = float(np.abs(end.point.gradient).sum()) * (-1.0 if again.status in NOT_ATTAINED else 1.0)
    return bool(again.point.value < end.point.value + margin) or not np.isfinite(end.point.value)
