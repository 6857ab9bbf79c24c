"""A quantity as a function of the unknowns of a descent, with its gradient and Hessian-vector products.

The unknowns are θ = log σ, or σ itself where compression is allowed.  The scale of σ changes no quantity, so that
derivatives by the unknowns x are those of σ(x) without its scaling to Σσ² = N_b, with ∂σ/∂x diagonal.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np

from critflow.critical.manifold import CriticalManifold
from critflow.critical.quantity import Evaluation, Quantity, evaluate, has_exact_hessian
from critflow.networks.network import Array
from critflow.optimisation.minimize import Function, Point


class StressObjective(Function):
    """±O(σ)/u as a function of θ = log σ (N_b,), to be minimised; the sign is − for objectives to be maximised.

    u is the unit of O, so that tolerances hold in any units of stiffness and length.  The state of a point is the
    `Evaluation` of the objective at its stress.
    """

    def __init__(self, manifold: CriticalManifold, goal: Quantity):
        self.manifold, self.goal = manifold, goal
        # A value of O over that of a point.
        self.unit = (-1.0 if goal.maximise else 1.0) * goal.unit(manifold.network)

    @cached_property
    def exact(self) -> bool:
        """Whether products with the Hessian are exact."""
        return has_exact_hessian(self.manifold, self.goal)

    def unknowns(self, sigma: Array) -> Array:
        """θ of a stress σ (N_b,)."""
        return np.log(sigma)

    def sigma(self, x: Array) -> Array:
        """σ of log-stresses θ, scaled to Σσ² = N_b."""
        sigma = np.exp(x - x.max())
        return sigma * np.sqrt(len(x) / (sigma @ sigma))

    def rate(self, x: Array, sigma: Array) -> tuple[Array | float, Array | float]:
        """First and second derivatives of each σ by its own unknown."""
        return sigma, sigma

    def moderate(self, x: Array, ratio: float) -> Array | None:
        """x with stresses between 1/ratio and ratio times their median; None where signs may change."""
        middle, width = np.median(x), np.log(ratio)
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
            evaluation = evaluate(self.manifold, self.goal, sigma)
        residual = float(np.abs(evaluation.gradient).max() / abs(self.unit))
        gradient = self.rate(x, sigma)[0] * evaluation.gradient / self.unit
        return Point(
            x, evaluation.value / self.unit, gradient, residual if np.isfinite(residual) else np.inf, evaluation
        )

    def preconditioner(self, point: Point) -> Array | float:
        return self.goal.preconditioner(point.state.balance) / abs(self.unit)

    def hessian_product(self, point: Point, direction: Array) -> Array:
        """The Hessian at a point times a direction (N_b,), by two solves; of some quantities by differences."""
        evaluation: Evaluation = point.state
        product = evaluation.hessian_product if self.exact else evaluation.hessian_difference
        rate, second = self.rate(point.x, evaluation.balance.sigma)
        curved = rate * product(rate * direction)
        return (second * direction * evaluation.gradient + curved) / self.unit


class SignedStressObjective(StressObjective):
    """±O as a function of σ (N_b,) itself, whose signs may change, and with them the inertia of P(σ)."""

    def unknowns(self, sigma: Array) -> Array:
        return sigma.copy()

    def sigma(self, x: Array) -> Array:
        return x * np.sqrt(len(x) / (x @ x))

    def rate(self, x: Array, sigma: Array) -> tuple[Array | float, Array | float]:
        return np.sqrt(len(x) / (x @ x)), 0.0

    def moderate(self, x: Array, ratio: float) -> Array | None:
        return None
