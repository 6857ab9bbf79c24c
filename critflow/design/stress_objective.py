"""What the minimisers see of an objective: its value, slope and curvature as a function of unknowns that give σ.

The unknowns are θ = log σ, or σ itself where compression is allowed.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from critflow.critical.derivatives import evaluate
from critflow.critical.manifold import CriticalManifold
from critflow.critical.objectives import Objective
from critflow.networks.network import Array
from critflow.result import Status
from critflow.solvers.minimize import Minimum, Point

# An edge below this part of the mean length that keeps its tension is on its way to zero length.
_COLLAPSING = 1e-4
# A stress this small, where Σσ² = N_b, is on its way to zero.
FADED = 1e-12
# Where edges collapse or fall slack, the configuration returned is the last on the way with no edge below this part
# of the mean and no stress below its square: shorter ones would lose the digits of their balance in the rounding of
# the coordinates.
SOUND = 1e-2

# A prestress matrix whose smallest pivot is below this part of the largest is nearly singular: lengths are then known
# to about 1e-7.  An ascent that stays there for so many steps is on its way to a limit at the singular matrix itself.
_NEARLY_SINGULAR, _TRAPPED = 1e-9, 20

# Central differences of slopes over this are good to its square, and rounding leaves as many digits.
_DIFFERENCE = 1e-5

Observer = Callable[[int, float, Array, Array], Any]
"""What is told of a descent: step, value of the objective, σ (N_b,) and L (N_b, d)."""


class Landscape:
    """An objective as a function of θ = log σ, to be minimised."""

    def __init__(self, manifold: CriticalManifold, goal: Objective, observe: Observer | None = None):
        self.manifold, self._goal, self._observe = manifold, goal, observe
        self.sign = -1.0 if goal.maximise else 1.0
        self.last_sound = np.zeros(manifold.network.n_edges)
        self._step = 0

    def unknowns(self, sigma: Array) -> Array:
        """θ of a stress; a descent from it is about to begin."""
        self._step = 0
        return np.log(sigma)

    def sigma(self, x: Array) -> Array:
        """σ of log-stresses θ, scaled to Σσ² = N_b."""
        sigma = np.exp(x - x.max())
        return sigma * np.sqrt(len(x) / (sigma @ sigma))

    def along(self, x: Array, sigma: Array, direction: Array) -> Array:
        """A change of σ that a direction of θ brings; what it adds along σ does not matter."""
        return sigma * direction

    def slope(self, x: Array, sigma: Array, gradient: Array) -> Array:
        """dO/dθ from dO/dσ."""
        return sigma * gradient

    def bend(self, x: Array, sigma: Array, gradient: Array, direction: Array) -> Array:
        """What the curvature of σ(θ) adds to the Hessian times a direction."""
        return sigma * direction * gradient

    @property
    def time_step(self) -> float:
        # Curvatures per edge are of order 1/N_b.
        return 0.3 * np.sqrt(self.manifold.network.n_edges)

    def at(self, x: Array) -> Point:
        # Trials far out may overflow; they are told by a value that is not finite.
        with np.errstate(all="ignore"):
            sigma = self.sigma(x)
            evaluation = evaluate(self.manifold, self._goal, sigma)
        value, gradient = evaluation.value, evaluation.gradient
        self._last = (x, sigma, evaluation.balance.bond_vectors, evaluation)
        residual = float(np.abs(gradient).max())
        slope = self.sign * self.slope(x, sigma, gradient)
        return Point(x, self.sign * value, slope, residual if np.isfinite(residual) else np.inf)

    def stiff_diagonal(self, point: Point) -> Array | float:
        return self._goal.stiff_diagonal(self._last[1])

    def verdict(self, point: Point) -> Status | None:
        _, sigma, L, *_ = self._last
        if not np.isfinite(point.value):
            return Status.singular
        end = self._end(point)
        enough = self._observe is not None and self._observe(self._step, self.sign * point.value, sigma, L)
        self._step += 1
        return Status.step_limit if enough and end is None else end

    def _end(self, point: Point) -> Status | None:
        _, sigma, L, *_ = self._last
        length = np.sqrt(np.einsum("ad,ad->a", L, L))
        tension = sigma * length
        if length.min() > SOUND * length.mean() and sigma.min() > SOUND**2:
            self.last_sound = point.x
        if sigma.min() < FADED:
            return Status.slack_edges
        vanishing = (length < _COLLAPSING * length.mean()) & (tension > 0.01 * tension.mean())
        return Status.edge_collapse if vanishing.any() else None

    def told(self) -> dict[str, object]:
        """What the way itself has to say."""
        return {}

    def runs_away(self, end: Minimum) -> bool:
        """Whether the descent ended because lengths grow without end."""
        return False

    def curvature(self, point: Point, direction: Array) -> Array:
        x, sigma, _, evaluation = self._last
        assert x is point.x, "the curvature belongs to the point evaluated last"
        dsigma = self.along(x, sigma, direction)
        try:
            dgradient = evaluation.hessian_product(dsigma)
        except NotImplementedError:
            return self._by_differences(point, direction)
        return self.sign * (self.bend(x, sigma, evaluation.gradient, direction) + self.slope(x, sigma, dgradient))

    def _by_differences(self, point: Point, direction: Array) -> Array:
        """The curvature of objectives without a differential, to about nine digits."""
        last, step = self._last, _DIFFERENCE / float(np.abs(direction).max())
        there, back = self.at(point.x + step * direction), self.at(point.x - step * direction)
        self._last = last
        return (there.gradient - back.gradient) / (2 * step)


class SignedLandscape(Landscape):
    """An objective as a function of σ itself, which may change sign, and with it the inertia of P(σ)."""

    def unknowns(self, sigma: Array) -> Array:
        self._step, self._nearest, self._trapped = 0, np.inf, 0
        self.last_sound = np.full_like(sigma, np.nan)
        self._crossings: list[int] = []
        self._negative: int | None = None
        return sigma.copy()

    def sigma(self, x: Array) -> Array:
        return x * np.sqrt(len(x) / (x @ x))

    def along(self, x: Array, sigma: Array, direction: Array) -> Array:
        size = x @ x
        return np.sqrt(len(x) / size) * (direction - (x @ direction / size) * x)

    def slope(self, x: Array, sigma: Array, gradient: Array) -> Array:
        # The gradient has no component along σ.
        return np.sqrt(len(x) / (x @ x)) * gradient

    def bend(self, x: Array, sigma: Array, gradient: Array, direction: Array) -> Array:
        size = x @ x
        return -np.sqrt(len(x) / size) * (x @ direction / size) * gradient

    def _end(self, point: Point) -> Status | None:
        factor = self._last[3].balance.factor
        pivots = np.abs(factor.pivots)
        self._nearest = min(self._nearest, float(pivots.min() / pivots.max()))
        if self._negative is not None and factor.n_negative != self._negative:
            self._crossings.append(self._step)
        self._negative = factor.n_negative
        self._trapped = self._trapped + 1 if pivots.min() < _NEARLY_SINGULAR * pivots.max() else 0
        if not self._trapped:
            self.last_sound = point.x
        return Status.singular if factor.singular or self._trapped > _TRAPPED else None

    def runs_away(self, end: Minimum) -> bool:
        return end.status in (Status.singular, Status.stalled) and self._trapped > 0

    def told(self) -> dict[str, object]:
        return {"crossings": self._crossings, "nearest_singular": self._nearest, "negative_pivots": self._negative}
