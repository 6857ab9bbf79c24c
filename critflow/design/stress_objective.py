"""A quantity as a function of the unknowns of a descent, with its gradient and Hessian-vector products.

The unknowns are θ = log σ, or σ itself where compression is allowed.
"""

from __future__ import annotations

import numpy as np

from critflow.critical.derivatives import Evaluation, evaluate
from critflow.critical.manifold import CriticalManifold
from critflow.critical.quantity import DIFFERENCE, Quantity
from critflow.networks.network import Array
from critflow.solvers.minimize import Function, Point


class StressObjective(Function):
    """±O(σ) as a function of θ = log σ (N_b,), to be minimised; the sign is − for objectives to be maximised.

    The state of a point is the `Evaluation` of the objective at its stress.
    """

    def __init__(self, manifold: CriticalManifold, goal: Quantity):
        self.manifold, self.goal = manifold, goal
        self.sign = -1.0 if goal.maximise else 1.0

    def unknowns(self, sigma: Array) -> Array:
        """θ of a stress σ (N_b,)."""
        return np.log(sigma)

    def sigma(self, x: Array) -> Array:
        """σ of log-stresses θ, scaled to Σσ² = N_b."""
        sigma = np.exp(x - x.max())
        return sigma * np.sqrt(len(x) / (sigma @ sigma))

    def pushforward(self, x: Array, sigma: Array, direction: Array) -> Array:
        """σ̇ of a direction of θ, up to a multiple of σ, which does not change the configuration."""
        return sigma * direction

    def gradient(self, x: Array, sigma: Array, dO_dsigma: Array) -> Array:
        """dO/dθ from dO/dσ."""
        return sigma * dO_dsigma

    def hessian_term(self, x: Array, sigma: Array, dO_dsigma: Array, direction: Array) -> Array:
        """The product of dO/dσ with the second derivative of σ(θ), times a direction."""
        return sigma * direction * dO_dsigma

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
        residual = float(np.abs(evaluation.gradient).max())
        gradient = self.sign * self.gradient(x, sigma, evaluation.gradient)
        return Point(
            x, self.sign * evaluation.value, gradient, residual if np.isfinite(residual) else np.inf, evaluation
        )

    def stiff_diagonal(self, point: Point) -> Array | float:
        return self.goal.stiff_diagonal(point.state.balance.sigma)

    def hessian_product(self, point: Point, direction: Array) -> Array:
        """The Hessian at a point times a direction (N_b,), by two solves; by differences without a differential."""
        if not self.goal.has_differential:
            return self._by_differences(point, direction)
        evaluation: Evaluation = point.state
        x, sigma, dO_dsigma = point.x, evaluation.balance.sigma, evaluation.gradient
        change = evaluation.hessian_product(self.pushforward(x, sigma, direction))
        return self.sign * (self.hessian_term(x, sigma, dO_dsigma, direction) + self.gradient(x, sigma, change))

    def _by_differences(self, point: Point, direction: Array) -> Array:
        """The Hessian-vector product of an objective without a differential, to about nine digits."""
        step = DIFFERENCE / float(np.abs(direction).max())
        forward, backward = self.at(point.x + step * direction), self.at(point.x - step * direction)
        return (forward.gradient - backward.gradient) / (2 * step)


class SignedStressObjective(StressObjective):
    """±O as a function of σ (N_b,) itself, whose signs may change, and with them the inertia of P(σ)."""

    def unknowns(self, sigma: Array) -> Array:
        return sigma.copy()

    def sigma(self, x: Array) -> Array:
        return x * np.sqrt(len(x) / (x @ x))

    def moderate(self, x: Array, ratio: float) -> Array | None:
        return None

    def pushforward(self, x: Array, sigma: Array, direction: Array) -> Array:
        size = x @ x
        return np.sqrt(len(x) / size) * (direction - (x @ direction / size) * x)

    def gradient(self, x: Array, sigma: Array, dO_dsigma: Array) -> Array:
        # dO/dσ has no component in the direction of σ.
        return np.sqrt(len(x) / (x @ x)) * dO_dsigma

    def hessian_term(self, x: Array, sigma: Array, dO_dsigma: Array, direction: Array) -> Array:
        size = x @ x
        return -np.sqrt(len(x) / size) * (x @ direction / size) * dO_dsigma
