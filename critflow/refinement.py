"""Configurations and equilibria to the last digit, by residuals in extended precision, with error bounds.

With a factor of P, the error of a configuration is P⁻¹ gᵀ(σ ∘ L): solving, correcting and solving again refines it and
gives the distance from the exact one.  Coordinates are sums of two doubles meanwhile; their final rounding is then
nearly all of their error, and bond vectors are rounded relative to their lengths.

The factor may hide an error along a vector on which P nearly vanishes, if its eigenvalue is rounding.  For stresses of
one sign this is excluded: P⁻¹ ≥ 0 entry by entry, so y > 0 with P y ≥ w > 0 proves |P⁻¹ r| ≤ y max |r|/w (Ogita, Oishi
and Ushiro, 2001).  For stresses of both signs a solve for the vector that the factor magnifies most measures the error
of the factor there.

The displacement from a configuration to the exact equilibrium of its springs is x* − x = H⁻¹ f.  Forces of springs are
differences of nearly equal lengths, and past the transition the stiffness of soft modes is of the order of the strain:
a small force is not a small error.  Forces f from bond vectors in extended precision keep their digits; the correction,
repeated at x + δ with the same factor, shrinks by a constant, which bounds the remainder.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import reduce

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from critflow.double_double import Extended, add, edge_differences, extended, multiply, part, two_product, two_sum
from critflow.networks import Array, Network
from critflow.numerics import EPS, dot, largest, product, quasi_random
from critflow.sparse import REDUCED, Factor, free_ends

BLOCK = 1 << 16  # rows of an array of d columns in one step: its temporaries are then some megabytes


class ExtendedGeometry:
    """Bond vectors L = g x + b and sums of edge forces of one network, to 32 digits.

    around        edges around each vertex, one array of all vertices after the other, with the signs of their forces
    ends, spread  |g| and |g|ᵀ
    reach         the largest component of the boundary vectors
    roundings     of a sum of edge forces around a vertex
    """

    def __init__(self, network: Network):
        self.network, free = network, network.free
        # A fixed vertex is part of the boundary vectors; its index −1 reads the zero after the last free one.
        self._tail, self._head = free_ends(network).T
        # An edge from a vertex to an image of itself exerts no force; its two forces would cancel only to rounding.
        ends = np.where(self._tail == self._head, -1, [self._tail, self._head]).ravel()
        order = np.argsort(ends, kind="stable")
        order = order[ends[order] >= 0]
        degree = np.bincount(ends[order], minlength=len(free))
        first = np.cumsum(degree) - degree
        place = np.arange(len(order)) - np.repeat(first, degree)
        self.around: list[tuple[NDArray[np.int64], Array]] = []
        for number in range(int(degree.max())):
            row = (place == number).nonzero()[0]
            edges, signs = np.zeros(len(free), np.int64), np.zeros((len(free), 1))
            edges[ends[order[row]]] = order[row] % network.n_edges
            signs[ends[order[row]], 0] = np.where(order[row] < network.n_edges, -1.0, 1.0)
            self.around.append((edges, signs))
        self.ends, self.spread = (
            sp.csr_array((np.abs(matrix.data), matrix.indices, matrix.indptr), matrix.shape)
            for matrix in (network.free_incidence, network.divergence)
        )
        self.reach = float(np.abs(network.boundary_vectors).max())
        self.roundings = EPS * (4 + int(np.diff(self.spread.indptr).max()))

    def bond_vectors(self, x: Extended, b: Array) -> Extended:
        """L (N_b, d) from free coordinates x (n_free, d) and boundary vectors b (N_b, d), to 32 digits of those."""
        zero = np.zeros((1, x.high.shape[1]))
        padded = Extended(np.concatenate([x.high, zero]), np.concatenate([x.low, zero]))
        high, low = np.empty(b.shape), np.empty(b.shape)
        for rows in blocks(len(b)):
            high[rows], low[rows] = edge_differences(self._tail[rows], self._head[rows], padded, b[rows])
        return Extended(high, low)

    def tension_forces(self, sigma: Extended, L: Extended) -> Extended:
        """gᵀ(σ ∘ L) over the free vertices, (n_free, d), of σ (N_b, 1) and L (N_b, d), to 32 digits of those."""
        high, low = np.empty_like(L.high), np.empty_like(L.low)
        for rows in blocks(len(high)):
            high[rows], low[rows] = multiply(part(sigma, rows), part(L, rows))
        return self.divergence(Extended(high, low))

    def divergence(self, edge_vectors: Extended) -> Extended:
        """gᵀ v over the free vertices, (n_free, d), of edge vectors v (N_b, d), to 32 digits of those."""
        v, shape = edge_vectors, (len(self.network.free), edge_vectors.high.shape[1])
        high, low = np.empty(shape), np.empty(shape)
        for rows in blocks(shape[0]):
            total = np.zeros_like(high[rows])
            rest = np.zeros_like(total)
            for edges, signs in self.around:
                at, sign = edges[rows], signs[rows]
                total, rounding = two_sum(total, sign * v.high.take(at, 0))
                rest = rest + sign * v.low.take(at, 0) + rounding
            high[rows], low[rows] = two_sum(total, rest)
        return Extended(high, low)


def blocks(n_rows: int) -> Iterator[slice]:
    """Rows of an array in parts, whose temporary arrays are small enough for the cache."""
    return (slice(start, start + BLOCK) for start in range(0, n_rows, BLOCK))


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


class Refinement:
    """The configuration of a stress σ (N_b,), from coordinates near it and a factor of P(σ) or of a matrix near it.

    x          free coordinates (n_free, d), rounded to doubles
    L          bond vectors (N_b, d), rounded to doubles
    error      bound on the error of every coordinate
    L_errors   bounds on |δL_α|, (N_b,)
    condition  Skeel's ‖|P⁻¹||P|1‖∞, which the scales of the rows do not change
    steps      corrections made
    certain    whether the bounds are proven or, for stresses of both signs, well founded; else no number is reliable

    The bounds hold for the configuration of σ and for that of σ rounded to doubles, as it is stored.

    Error bound (proof) for stresses of one sign, rounding included, by a comparison vector.
    Error bound (estimate) for stresses of both signs: SAFETY times Hager's estimate of the condition, which is known
    from below.
    """

    def __init__(self, geometry: ExtendedGeometry, sigma: Extended, factor: Factor, x: Array):
        self._geometry, self._factor = geometry, factor
        self._g, self._divergence = geometry.network.free_incidence, geometry.network.divergence
        self._stress, self._low = sigma.high[:, None], sigma.low[:, None]
        stress = self._stress
        self._weight = weight = 2 * product(geometry.spread, np.abs(stress))
        self._sign = 1.0 if (stress >= 0).all() else -1.0 if (stress <= 0).all() else 0.0
        self.condition, self._proof, founded = np.inf, bool(self._sign), False
        if self._sign:
            # The proof needs no sound factor.
            self._y, self._Py = self._comparison(weight)
            self.condition = float(np.nan_to_num(np.abs(self._y), nan=np.inf).max())
            founded = bool((self._Py > 0).all())
        elif factor.sound:
            condition, start, right = magnification(factor.solve, weight)
            if np.isfinite(condition):
                # The doubt of the factor, by a solve for the signs that P⁻¹ magnifies most.
                right = np.hstack([start, right])
                y = factor.solve(right)
                wrong = factor.solve(right - self._product(y))
                doubt = float((np.abs(wrong).max(axis=0) / np.abs(y).max(axis=0)).max())
                self.condition = max(condition, float(np.abs(y).max()))
                founded = doubt < DOUBTFUL and self.condition * EPS < HOPELESS
        self.x, self.error, self.steps, self.certain = x, np.nan, 0, founded and bool(np.isfinite(x).all())
        if self.certain:
            self._refine(x)
        else:
            self.L = np.full_like(geometry.network.boundary_vectors, np.nan)
            self.L_errors = self.L[:, 0]

    def _refine(self, x: Array) -> None:
        """Refine x (n_free, d) to the configuration of σ."""
        geometry, stress, low, b = self._geometry, self._stress, self._low, self._geometry.network.boundary_vectors
        # 1. Corrections by residuals in extended precision, until the error does not halve
        at, last, step = extended(x.copy()), np.inf, 0
        while True:
            step += 1
            L = geometry.bond_vectors(at, b)
            force = geometry.tension_forces(Extended(stress, low), L)
            size = float(np.abs(at.high).max()) + geometry.reach
            goal = UNSEEN * EPS * float(_largest(L.high).min())
            correction, change, left = self._correction(force.high, goal)
            left += force.low
            errors = self._errors(left, L, change, size)
            for rows in blocks(len(x)):
                at.high[rows], at.low[rows] = add(part(at, rows), extended(correction[rows]))
            error = float(errors.max())
            if error <= goal or not error < 0.5 * last or step == MOST_STEPS:
                break
            last = error
            del L, force, correction, change, left  # 240 MB at 10⁶ vertices in space
        if error > goal:
            errors = self._errors(left, L, change, size, sharply=True)
            error = float(errors.max())
        self.certain, self.steps = bool(error < LOST * size), step
        del force, correction, left  # 100 MB at 10⁶ vertices in space
        bonds, rest = L.high, np.add(L.low, change, out=change)
        del L  # 50 MB
        # 2. The displacement to the configuration of the rounded stress.  Its forces gᵀ((σ − low) ∘ L) = −gᵀ(low ∘ L)
        # are small, so that one solve in doubles has all digits that count.
        shifted = np.zeros(rest.shape)  # takes memory only where there is a rounding
        if low.any():
            shift, change, left = self._correction(product(self._divergence, -low * bonds), goal)
            rounding = np.abs(stress) * _largest(change) + np.abs(low) * _largest(bonds)
            forces = _largest(left) + geometry.roundings * product(geometry.spread, rounding)
            more = self._bound(forces)
            if more.max() > goal:
                more = self._bound(forces, sharply=True)
            shifted, errors = product(self._g, shift), errors + more
            error = float((_largest(shift) + errors).max())
        # 3. The rounded bond vectors, with bounds on their errors
        self.x, self.L, self.error = at.high, bonds, float(np.abs(at.low).max()) + error
        at_ends, self.L_errors = product(geometry.ends, errors), np.empty(len(rest))
        for rows in blocks(len(rest)):
            bonds[rows], lost = two_sum(bonds[rows], rest[rows])
            rough = np.abs(lost) + EPS * np.abs(rest[rows]) + EXTENDED_ROUNDING * size
            rough += np.abs(shifted[rows])
            rough += at_ends[rows]
            self.L_errors[rows] = np.sqrt(dot(rough, rough))

    def _product(self, vector: Array) -> Array:
        """P v, (n_free, 1), by differences along the edges, which nearly equal entries do not spoil."""
        return product(self._divergence, self._stress * product(self._g, vector))

    def _comparison(self, forces: Array) -> tuple[Array, Array]:
        """y near P⁻¹ times the forces, all positive, and a lower bound of P y; not positive where it proves nothing."""
        geometry = self._geometry
        for reduction in (COMPARED, REDUCED):
            y = self._sign * self._factor.solve_roughly(forces, reduction)
            if np.isfinite(y).all() and (y > 0).all():
                terms = np.abs(self._stress * product(self._g, y))
                Py = self._sign * self._product(y) - geometry.roundings * product(geometry.spread, terms)
                if (Py > 0).all():
                    return y, Py
        return y, np.zeros_like(forces)

    def _bound(self, forces: Array, sharply: bool = False) -> Array:
        """Bounds (n_free, 1) for forces of at most these sizes (n_free, 1); sharper ones by one more solve."""
        relative = float((forces / self._weight).max())
        if not self._proof:
            return np.full_like(self._weight, SAFETY * self.condition * relative)
        errors = self._y * float((forces / self._Py).max())
        if sharply:
            forces = forces + 1e-6 * relative * self._weight
            y, Py = self._comparison(forces)
            if (Py > 0).all():
                errors = np.minimum(errors, y * float((forces / Py).max()))
        return errors

    def _correction(self, force: Array, goal: float) -> tuple[Array, Array, Array]:
        """A correction (n_free, d) by a force (n_free, d), its change of the bond vectors, and the force that is left.

        The force after a correction of this size needs no extended precision.  A solver that iterates reduces it to a
        bound well below the goal.
        """
        reduction = REDUCED
        if self._proof and self._factor.iterates:
            error = float(self._bound(_largest(force)).max())
            reduction = (
                float(np.clip(0.1 * goal / error, MOST_REDUCTION, LEAST_REDUCTION)) if error else LEAST_REDUCTION
            )
        correction = -self._factor.solve_roughly(force, reduction)
        change = product(self._g, correction)
        return correction, change, force + product(self._divergence, self._stress * change)

    def _errors(self, left: Array, L: Extended, change: Array, size: float, sharply: bool = False) -> Array:
        """Bounds (n_free, 1) on the errors of coordinates of a size, by the forces that are left, (n_free, d)."""
        geometry = self._geometry
        # P⁻¹ gᵀ(σ ∘ η) of a proof is a mean, over spanning trees, of sums of η along a path to a fixed vertex.
        rounded = _largest(change) + EPS * _largest(L.high) if self._proof else _largest(change)
        rounding = geometry.roundings * product(geometry.spread, np.abs(self._stress) * rounded)
        forces, lost = _largest(left) + rounding, EXTENDED_ROUNDING * size
        if self._proof:
            return self._bound(forces, sharply) + len(self._weight) * lost
        return self._bound(forces + lost * self._weight, sharply)


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


MOST_CORRECTIONS = 10  # corrections of an equilibrium after which it counts as not convergent
ROUNDED_FORCE = 8 * EPS  # largest force, relative to the largest tension, that the roundings of σ leave at a vertex
CONTRACTION = 0.5  # each correction must shrink by this factor


@dataclass(frozen=True, eq=False)
class Displacement:
    """Displacement D = x* − x (n_free, d) to the exact equilibrium, and its bond vectors L* (N_b, d).

    remainder  bound on the error of D, largest component; infinite where the corrections do not shrink
    last       the last of the corrections whose sum is D
    """

    displacement: Array
    bond_vectors: Array
    remainder: float
    last: Array


def exact_displacement(
    network: Network,
    coordinates: Array,
    stress: Callable[[Extended], Array],
    solve: Callable[[Array], Array],
    regularised: bool = False,
) -> Displacement:
    """Sum corrections H⁻¹ f until the remainder is below the rounding of the coordinates (N_v, d).

    stress       σ (N_b,) from extended bond vectors
    solve        displacements H⁻¹ f (n_free, d) of forces f (n_free, d), with H at or near the configuration
    regularised  the solves are with H + shift, which resists floppy modes: corrections must then shrink to the end,
                 since soft modes would give small corrections too

    Error bound (estimate): the remainder continues the last observed contraction, of at least a half, as a geometric
    series, and adds the effect of the rounded σ: a rounding of the largest tension, times the largest displacement per
    force that a correction had.
    """
    rounding = EPS * largest(coordinates)
    enough, noise = UNSEEN * rounding, 0.0 if regularised else rounding
    D = np.zeros((len(network.free), network.dimension))
    L, change = exact_bond_vectors(network, coordinates, D), np.zeros_like(D)
    before, remainder, compliance = np.inf, np.inf, 0.0
    for _ in range(MOST_CORRECTIONS):
        # The change is far below L, so its rounding is far below the last digit of L.low.
        L = L if before == np.inf else two_sum(L.high, L.low + change)
        sigma = stress(L)
        forces = exact_forces(network, sigma, L)
        correction = solve(forces)
        change = product(network.free_incidence, correction)
        size, force = largest(correction), largest(forces)
        if size == 0.0:
            remainder = 0.0
            break
        compliance = max(compliance, size / force)
        if not size / before < CONTRACTION:
            # Corrections of the size of rounding do not shrink; those of soft modes are small by the shift alone.
            rounded = force <= ROUNDED_FORCE * largest(sigma * L.high.T)
            remainder = 2 * size if size <= max(noise, enough) and (rounded or not regularised) else np.inf
            break
        D = D + correction
        # A first correction may shrink faster than those after it, so the remainder is never below half of it.
        remainder = 0.5 * size
        if before < np.inf and remainder <= enough:
            break
        before = size
    else:
        remainder = np.inf
    remainder += EPS * compliance * largest(sigma * L.high.T)
    return Displacement(D, L.high + (L.low + change), remainder, correction)


def inverse_norm(factor: Factor, vector: Array) -> float:
    """A lower bound of ‖H⁻¹‖, by one solve; sharp up to a small factor where the vector is a product with H⁻¹."""
    vector = vector.ravel()
    size = float(np.linalg.norm(vector))
    if not size:
        vector = quasi_random(len(vector)) - 0.5
        size = float(np.linalg.norm(vector))
    return float(np.linalg.norm(factor.solve(vector / size)))


def exact_bond_vectors(network: Network, coordinates: Array, displacement: Array) -> Extended:
    """L = g (x + D) + b, (N_b, d), with displacements D (n_free, d) below the rounding of the coordinates (N_v, d)."""
    x, D = coordinates, np.zeros_like(coordinates)
    D[network.free_rows] = displacement
    if network.pins:
        # Pins are part of b; of a periodic network only differences count.
        x = coordinates.copy()
        x[list(network.pins)] = 0.0
    tail, head = np.ascontiguousarray(network.edges.T)
    return edge_differences(tail, head, Extended(x, D), network.boundary_vectors)


def exact_forces(network: Network, sigma: Array, bond_vectors: Extended) -> Array:
    """−gᵀ(σ ∘ L), (n_free, d), with the rounding of σ and of the result alone.

    The sums are sparse products, whose rounding is 2⁻⁷⁷ of the largest of all terms: enough for the forces of springs.
    """
    # One stress for each component: NumPy is several times slower where it repeats them in every product.
    stress = np.repeat(sigma, bond_vectors.high.shape[1]).reshape(bond_vectors.high.shape)
    pull = two_product(stress, bond_vectors.high)
    leading = leading_half(pull.high)
    # The incidence is of ones, on any grid.
    small = product(network.divergence, (pull.high - leading) + (pull.low + stress * bond_vectors.low))
    return -(product(network.divergence, leading) + small)


def leading_half(values: Array) -> Array:
    """Values rounded to a grid common to all, 2⁻²⁶ of the largest."""
    size = largest(values)
    if not size:
        return values
    grid = 1.5 * 2.0 ** (np.ceil(np.log2(size)) + 27)
    return np.asarray((values + grid) - grid)
