"""Configurations to the last digit: iterative refinement with residuals in extended precision, and error bounds.

With a factor of P, the error of a configuration is P⁻¹ gᵀ(σ ∘ L): solving, correcting and solving again refines it and
gives the distance from the exact one.  Coordinates are sums of two doubles meanwhile; their final rounding is then
nearly all of their error, and bond vectors are rounded relative to their lengths.

The factor may hide an error along a vector on which P nearly vanishes, if its eigenvalue is rounding.  For stresses of
one sign this is excluded: P⁻¹ ≥ 0 entry by entry, so y > 0 with P y ≥ w > 0 proves |P⁻¹ r| ≤ y max |r|/w (Ogita, Oishi
and Ushiro, 2001).  For stresses of both signs a solve for the vector that the factor magnifies most measures the error
of the factor there.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import reduce

import numpy as np
import scipy.sparse as sp

from critflow.linalg.factor import REDUCED, Factor
from critflow.linalg.tolerances import EPS
from critflow.linalg.vectors import dot, product, quasi_random
from critflow.networks.network import Array, Network
from critflow.precision.double_double import Extended, add, extended, part, two_sum
from critflow.precision.geometry import ExtendedGeometry, blocks

# Error of a residual in double-double arithmetic, relative to the sizes of its terms: 4 roundings of about 2⁻¹⁰⁶.
EXTENDED_ROUNDING = 4 * EPS**2
# Part of a rounding below which an error is invisible: refinement of a configuration stops there, relative to the
# shortest edge, and corrections of an equilibrium, relative to the coordinates.
UNSEEN = 0.05
COMPARED = 1e-3  # reduction of a residual, where the solver iterates, for a y whose P y only has to be positive
# Of a residual by one correction, where the solver iterates: at most what doubles hold, so that 10⁵ vertices need one
# residual in extended precision.
LEAST_REDUCTION, MOST_REDUCTION = 0.01, 1e-15
MOST_STEPS = 40  # most steps of a refinement; each must halve the error, so that 40 span 12 digits
# Largest error of a refined configuration, relative to its coordinates.  Convergent refinement ends far below, near
# the rounding of doubles.
LOST = 1e-12
# Relative error of a factor in the vector that it magnifies most, above which it is not trusted (stresses of both
# signs).
DOUBTFUL = 0.1
# Condition times EPS above which a factor is not trusted (stresses of both signs): fewer than two digits of a solve
# are then certain.
HOPELESS = 0.02
# Safety factor of the error estimate for stresses of both signs: Hager's estimate of a condition is a lower bound,
# usually sharp up to a factor of 3.
SAFETY = 10.0


@dataclass(frozen=True, eq=False)
class Refined:
    """Free coordinates x (n_free, d) and bond vectors L (N_b, d) rounded to doubles, and bounds on their errors.

    error      bound on the error of every coordinate
    L_errors   bounds on |δL_α|, (N_b,)
    condition  Skeel's ‖|P⁻¹||P|1‖∞, which the scales of the rows do not change
    steps      corrections made
    certain    whether the bounds are proven or, for stresses of both signs, well founded; else no number is reliable

    Error bound (proof) for stresses of one sign, rounding included; error bound (estimate) for stresses of both signs,
    where it is SAFETY times a condition number that is known from below.
    """

    x: Array
    L: Array
    error: float
    L_errors: Array
    condition: float
    steps: int
    certain: bool


class Refinement:
    """Refines configurations of one network.

    geometry  its bond vectors and forces to 32 digits
    """

    def __init__(self, network: Network):
        self.geometry = ExtendedGeometry(network)
        self._g, self._divergence, self._b = network.free_incidence, network.divergence, network.boundary_vectors
        self._ends, self._spread = (
            sp.csr_array((np.abs(matrix.data), matrix.indices, matrix.indptr), matrix.shape)
            for matrix in (self._g, self._divergence)
        )
        self._reach = float(np.abs(self._b).max())
        # Roundings in a sum of edge forces around a vertex.
        self._roundings = EPS * (4 + int(np.diff(self._spread.indptr).max()))

    def __call__(self, sigma: Extended, factor: Factor, x: Array) -> Refined:
        """Refine x (n_free, d) to the configuration of σ (N_b,), with a factor of P(σ) or of a matrix near it.

        The bounds hold for the configuration of σ and for that of σ rounded to doubles, as it is stored.
        """
        stress = sigma.high[:, None]
        bound = _Bound(self, factor, stress, 2 * product(self._spread, np.abs(stress)))
        if not (bound.founded and np.isfinite(x).all()):
            nothing = np.full_like(self._b, np.nan)
            return Refined(x, nothing, np.nan, nothing[:, 0], bound.condition, 0, False)
        at, last, step = extended(x.copy()), np.inf, 0
        factors = Extended(stress, sigma.low[:, None])
        while True:
            step += 1
            L = self.geometry.bond_vectors(at, self._b)
            force = self.geometry.tension_forces(factors, L)
            size = float(np.abs(at.high).max()) + self._reach
            goal = UNSEEN * EPS * float(_largest(L.high).min())
            correction, change, left = self._correction(bound, factor, force.high, goal)
            left += force.low
            errors = self._errors(bound, left, L, change, size)
            for rows in blocks(len(x)):
                at.high[rows], at.low[rows] = add(part(at, rows), extended(correction[rows]))
            error = float(errors.max())
            if error <= goal or not error < 0.5 * last or step == MOST_STEPS:
                break
            last = error
            del L, force, correction, change, left  # 240 MB at 10⁶ vertices in space
        if error > goal:
            errors = self._errors(bound, left, L, change, size, sharply=True)
            error = float(errors.max())
        certain = bool(error < LOST * size)
        del force, correction, left  # 100 MB at 10⁶ vertices in space
        bonds, low = L.high, np.add(L.low, change, out=change)
        del L  # 50 MB
        shifted = np.zeros(low.shape)  # takes memory only where there is a rounding
        if factors.low.any():
            shift, more = self._shift_by_rounding(bound, factor, factors.low, bonds, goal)
            shifted, errors = product(self._g, shift), errors + more
            error = float((_largest(shift) + errors).max())
        at_ends = product(self._ends, errors)
        L_errors = np.empty(len(low))
        for rows in blocks(len(low)):
            bonds[rows], rest = two_sum(bonds[rows], low[rows])
            rough = np.abs(rest) + EPS * np.abs(low[rows]) + EXTENDED_ROUNDING * size
            rough += np.abs(shifted[rows])
            rough += at_ends[rows]
            L_errors[rows] = np.sqrt(dot(rough, rough))
        total = float(np.abs(at.low).max()) + error
        return Refined(at.high, bonds, total, L_errors, bound.condition, step, certain)

    def _correction(self, bound: _Bound, factor: Factor, force: Array, goal: float) -> tuple[Array, Array, Array]:
        """A correction (n_free, d) by a force (n_free, d), its change of the bond vectors, and the force that is left.

        The force after a correction of this size needs no extended precision.
        """
        correction = -factor.solve_roughly(force, bound.reduction(force, goal))
        change = product(self._g, correction)
        return correction, change, force + product(self._divergence, bound.stress * change)

    def _shift_by_rounding(
        self, bound: _Bound, factor: Factor, low: Array, L: Array, goal: float
    ) -> tuple[Array, Array]:
        """Displacement (n_free, d) from the configuration of σ to that of σ − low, and bounds (n_free, 1) on its error.

        The forces gᵀ((σ − low) ∘ L) = −gᵀ(low ∘ L) are small, so that one solve in doubles has all digits that count.
        """
        shift, change, left = self._correction(bound, factor, product(self._divergence, -low * L), goal)
        rounding = np.abs(bound.stress) * _largest(change) + np.abs(low) * _largest(L)
        forces = _largest(left) + self._roundings * product(self._spread, rounding)
        errors = bound(forces)
        return shift, bound(forces, sharply=True) if errors.max() > goal else errors

    def _errors(
        self, bound: _Bound, left: Array, L: Extended, change: Array, size: float, sharply: bool = False
    ) -> Array:
        """Bounds (n_free, 1) on the errors of coordinates of a size, by the forces that are left, (n_free, d)."""
        stress, weight = bound.stress, bound.weight
        # P⁻¹ gᵀ(σ ∘ η) of a proof is a mean, over spanning trees, of sums of η along a path to a fixed vertex.
        rounded = _largest(change) + EPS * _largest(L.high) if bound.proof else _largest(change)
        forces = _largest(left) + self._roundings * product(self._spread, np.abs(stress) * rounded)
        lost = EXTENDED_ROUNDING * size
        if bound.proof:
            return bound(forces, sharply) + len(weight) * lost
        return bound(forces + lost * weight, sharply)

    def product(self, stress: Array, vector: Array) -> Array:
        """P v, (n_free, 1), by differences along the edges, which nearly equal entries do not spoil."""
        return product(self._divergence, stress * product(self._g, vector))

    def rounding(self, stress: Array, vector: Array) -> Array:
        """Bound on the rounding of `product`."""
        return self._roundings * product(self._spread, np.abs(stress * product(self._g, vector)))


def _largest(vectors: Array) -> Array:
    """The largest component of each vector, (n, 1), of vectors (n, d)."""
    return reduce(np.maximum, np.abs(vectors).T)[:, None]


def magnification(solve: Callable[[Array], Array], weight: Array) -> tuple[float, Array, Array]:
    """Hager's estimate of ‖A⁻¹ diag(w)‖∞, w (n, 1), its first vector and the signs that A⁻¹ magnifies most.

    A is symmetric and `solve` gives A⁻¹ r for r (n, 1).  The estimate is a lower bound, usually sharp up to a factor
    of 3, and infinite where a solve fails (Higham, 2002, section 15.2).
    """
    # A start without symmetry, which is orthogonal to no vector that a symmetry distinguishes.
    start = weight * (2 * quasi_random(len(weight)) - 1)[:, None]
    right, condition = start, 0.0
    for _ in range(2):
        y = solve(right)
        if not np.isfinite(y).all():
            return np.inf, start, right
        row = solve(np.eye(1, len(y), int(np.abs(y).argmax())).T)
        condition = max(condition, float((weight * np.abs(row)).sum()))
        right = np.where(row < 0, -weight, weight)
    return condition, start, right


class _Bound:
    """Bounds |P⁻¹ r| for forces r, with the condition of P, and whether the bound is founded and whether it is a proof.

    Error bound (proof) for stresses of one sign, by a comparison vector.
    Error bound (estimate) for stresses of both signs, by Hager's estimate of the condition.
    """

    def __init__(self, refinement: Refinement, factor: Factor, stress: Array, weight: Array):
        self._refinement, self._factor, self.stress, self.weight = refinement, factor, stress, weight
        self._sign = 1.0 if (stress >= 0).all() else -1.0 if (stress <= 0).all() else 0.0
        self.condition, self.founded, self.proof = np.inf, False, bool(self._sign)
        if self._sign:
            # The proof needs no sound factor.
            self._y, self._Py = self._comparison(weight)
            self.condition = float(np.nan_to_num(np.abs(self._y), nan=np.inf).max())
            self.founded = bool((self._Py > 0).all())
        elif factor.sound:
            self._estimate()

    def _estimate(self) -> None:
        """The condition, and the doubt of the factor by a solve for the signs that P⁻¹ magnifies most."""
        factor = self._factor
        condition, start, right = magnification(factor.solve, self.weight)
        if not np.isfinite(condition):
            return
        right = np.hstack([start, right])
        y = factor.solve(right)
        wrong = factor.solve(right - self._refinement.product(self.stress, y))
        doubt = float((np.abs(wrong).max(axis=0) / np.abs(y).max(axis=0)).max())
        self.condition = max(condition, float(np.abs(y).max()))
        self.founded = doubt < DOUBTFUL and self.condition * EPS < HOPELESS

    def _comparison(self, forces: Array) -> tuple[Array, Array]:
        """y near P⁻¹ times the forces, all positive, and a lower bound of P y; not positive where it proves nothing."""
        for reduction in (COMPARED, REDUCED):
            y = self._sign * self._factor.solve_roughly(forces, reduction)
            if np.isfinite(y).all() and (y > 0).all():
                Py = self._sign * self._refinement.product(self.stress, y) - self._refinement.rounding(self.stress, y)
                if (Py > 0).all():
                    return y, Py
        return y, np.zeros_like(forces)

    def reduction(self, forces: Array, goal: float) -> float:
        """The reduction of forces (n_free, d), for a solver that iterates, to a bound well below the goal."""
        if not (self.proof and self._factor.iterates):
            return REDUCED
        error = float(self(_largest(forces)).max())
        return float(np.clip(0.1 * goal / error, MOST_REDUCTION, LEAST_REDUCTION)) if error else LEAST_REDUCTION

    def __call__(self, forces: Array, sharply: bool = False) -> Array:
        """Bounds (n_free, 1) for forces of at most these sizes (n_free, 1); sharper ones by one more solve."""
        relative = float((forces / self.weight).max())
        if not self.proof:
            return np.full_like(self.weight, SAFETY * self.condition * relative)
        errors = self._y * float((forces / self._Py).max())
        if sharply:
            forces = forces + 1e-6 * relative * self.weight
            y, Py = self._comparison(forces)
            if (Py > 0).all():
                errors = np.minimum(errors, y * float((forces / Py).max()))
        return errors
