"""Configurations to the last digit: refinement with residuals in extended precision, and what is left of the error.

With a factor of P, P⁻¹ gᵀ(σ ∘ L) is what a configuration is wrong by, so solving, correcting and solving again both
refines it and says how far it still is from the exact one.  Coordinates are kept as sums of two doubles meanwhile;
rounding them in the end is then nearly all of their error, and bond vectors are rounded relative to their own lengths.

An error along a vector on which P nearly vanishes may hide from the factor, if that vector's eigenvalue is nothing but
rounding.  For stresses of one sign nothing hides: P⁻¹ ≥ 0 entry by entry, so y > 0 with P y ≥ w > 0 proves
|P⁻¹ r| ≤ y max |r|/w (Ogita, Oishi and Ushiro, 2001).  For stresses of both signs the vector that the factor magnifies
most is solved for as well, and tells by how much the factor is wrong there.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import reduce

import numpy as np

from critflow.linalg.factor import Factor
from critflow.networks.network import Array, Network
from critflow.precision.double_double import Extended, ExtendedGeometry, add, extended, multiply, two_sum

_EPS = float(np.finfo(float).eps)
# Error of extended residuals, relative to the sizes of the terms in them.
_EXTENDED = 4 * _EPS**2
# Refinement stops when errors are below this part of the rounding of the shortest edge, or after so many steps.
_UNSEEN, _MOST_STEPS = 0.05, 40
# Largest error that a refined answer may have, relative to the coordinates; refinement that works is far below.
_LOST = 1e-12
# For stresses of both signs: how wrong the factor may be where it magnifies most, by measurement and by condition,
# and the safety of the error that is estimated then.
_DOUBTFUL, _HOPELESS, _SAFETY = 0.1, 0.02, 10.0


@dataclass(frozen=True, eq=False)
class Refined:
    """Free coordinates x (n_free, d) and bond vectors L (N_b, d) rounded to doubles, and bounds on their errors.

    error      bound on the error of every coordinate
    L_errors   bounds on |δL_α|, (N_b,)
    condition  Skeel's ‖|P⁻¹||P|1‖∞, which the scales of the rows do not change
    steps      corrections made
    certain    whether the bounds are proven or, for stresses of both signs, well founded; else all numbers may be wrong
    """

    x: Array
    L: Array
    error: float
    L_errors: Array
    condition: float
    steps: int
    certain: bool


class Refinement:
    """Refines configurations of one network."""

    def __init__(self, network: Network):
        self._geometry = ExtendedGeometry(network)
        self._g, self._divergence, self._b = network.free_incidence, network.divergence, network.boundary_vectors
        self._ends, self._spread = abs(self._g), abs(self._divergence)
        self._reach = float(np.abs(self._b).max())
        # Roundings in a sum of edge forces around a vertex.
        self._roundings = _EPS * (4 + int(np.diff(self._spread.indptr).max()))

    def __call__(self, sigma: Extended, factor: Factor, x: Array) -> Refined:
        """Refine x (n_free, d) to the configuration of σ (N_b,), with a factor of P(σ) or of a matrix near it."""
        stress = sigma.high[:, None]
        weight = 2 * (self._spread @ np.abs(stress))
        bound = _Bound(self, factor, stress, weight)
        if not (bound.founded and np.isfinite(x).all()):
            nothing = np.full_like(self._b, np.nan)
            return Refined(x, nothing, np.nan, nothing[:, 0], bound.condition, 0, False)
        at, last, step = extended(x), np.inf, 0
        factors = Extended(stress, sigma.low[:, None])
        while True:
            step += 1
            L = self._geometry.bond_vectors(at, self._b)
            force = self._geometry.divergence(multiply(factors, L))
            correction = -factor.solve(force.high)
            change = self._g @ correction
            # So small a correction needs no extended precision to say what it leaves.
            left = force.high + self._divergence @ (stress * change) + force.low
            size = float(np.abs(at.high).max()) + self._reach
            goal = _UNSEEN * _EPS * float(_largest(L.high).min())
            rounding, lost = self._roundings * self.sum_of_sizes(stress, change), _EXTENDED * size
            if bound.proof:
                # P⁻¹ gᵀ(σ ∘ η) is then a mean, over spanning trees, of sums of η along a path to a fixed vertex.
                rounding += _EPS * self._roundings * self.sum_of_sizes(stress, L.high)
                errors = bound(_largest(left) + rounding, goal) + len(weight) * lost
            else:
                errors = bound(_largest(left) + rounding + lost * weight, goal)
            at = add(at, extended(correction))
            error = float(errors.max())
            if error <= goal or not error < 0.5 * last or step == _MOST_STEPS:
                break
            last = error
        rounded = two_sum(L.high, L.low + change)
        rough = np.abs(rounded.low) + _EPS * (np.abs(L.low) + np.abs(change)) + _EXTENDED * size
        rough += self._ends @ errors
        L_errors = np.sqrt(np.einsum("ad,ad->a", rough, rough))
        certain = bool(error < _LOST * size)
        return Refined(
            at.high, rounded.high, float(np.abs(at.low).max()) + error, L_errors, bound.condition, step, certain
        )

    def product(self, stress: Array, vector: Array) -> Array:
        """P v, (n_free, 1), by differences along the edges, which nearly equal entries do not spoil."""
        return self._divergence @ (stress * (self._g @ vector))

    def sum_of_sizes(self, stress: Array, change: Array) -> Array:
        """Σ|σ_α||change_α| around each free vertex, (n_free, 1)."""
        return self._spread @ (np.abs(stress) * _largest(change))

    def rounding(self, stress: Array, vector: Array) -> Array:
        """What rounding may have done to `product`."""
        return self._roundings * self.sum_of_sizes(stress, self._g @ vector)


def _largest(vectors: Array) -> Array:
    """The largest component of each vector, (n, 1), of vectors (n, d)."""
    return reduce(np.maximum, np.abs(vectors).T)[:, None]


class _Bound:
    """Bounds |P⁻¹ r| for forces r, and says whether that is founded and how P magnifies errors."""

    def __init__(self, refinement: Refinement, factor: Factor, stress: Array, weight: Array):
        self._refinement, self._factor, self._stress, self._weight = refinement, factor, stress, weight
        sign = 1.0 if (stress >= 0).all() else -1.0 if (stress <= 0).all() else 0.0
        self.condition, self.founded, self.proof = np.inf, False, bool(sign)
        self._sign = sign
        if not factor.sound:
            return
        if sign:
            self._y, self._Py = self._comparison(weight)
            self.condition = float(np.abs(self._y).max())
            self.founded = bool((self._Py > 0).all())
        else:
            # Hager's ascent to the signs that are magnified most (Higham, 2002, section 15.2), from a start that no
            # symmetry makes orthogonal to the vectors sought.
            start = weight * (2 * np.mod(0.6180339887498949 * np.arange(1, len(weight) + 1), 1.0) - 1)[:, None]
            right, self.condition = start, 0.0
            for _ in range(2):
                y = factor.solve(right)
                if not np.isfinite(y).all():
                    self.condition = np.inf
                    return
                row = factor.solve(np.eye(1, len(y), int(np.abs(y).argmax())).T)
                self.condition = max(self.condition, float((weight * np.abs(row)).sum()))
                right = np.where(row < 0, -weight, weight)
            right = np.hstack([start, right])
            y = factor.solve(right)
            wrong = factor.solve(right - refinement.product(stress, y))
            doubt = float((np.abs(wrong).max(axis=0) / np.abs(y).max(axis=0)).max())
            self.condition = max(self.condition, float(np.abs(y).max()))
            self.founded = doubt < _DOUBTFUL and self.condition * _EPS < _HOPELESS

    def _comparison(self, forces: Array) -> tuple[Array, Array]:
        """y near P⁻¹ times the forces, all positive, and a lower bound of P y; not positive where it proves nothing."""
        y = self._sign * self._factor.solve(forces)
        if not (np.isfinite(y).all() and (y > 0).all()):
            return y, np.zeros_like(forces)
        return y, self._sign * self._refinement.product(self._stress, y) - self._refinement.rounding(self._stress, y)

    def __call__(self, forces: Array, goal: float) -> Array:
        """Bounds (n_free, 1) for forces of at most these sizes (n_free, 1); sharper ones where they exceed the goal."""
        relative = float((forces / self._weight).max())
        if not self.proof:
            return np.full_like(self._weight, _SAFETY * self.condition * relative)
        errors = self._y * float((forces / self._Py).max())
        if errors.max() > goal:
            forces = forces + 1e-6 * relative * self._weight
            y, Py = self._comparison(forces)
            if (Py > 0).all():
                errors = np.minimum(errors, y * float((forces / Py).max()))
        return errors
