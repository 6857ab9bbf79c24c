"""Singular values of the rigidity matrix R next to zero, and its null vectors on either side.

Small networks by a dense decomposition.  Of large ones the inertia of RᵀR − t² is the number of singular values below
t, without a dense matrix; the null vectors follow by inverse iteration of a block of that size.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property

import numpy as np
from scipy.sparse.linalg import ArpackNoConvergence, LinearOperator, eigsh

from critflow.critical.edge_lengths import COLLAPSED
from critflow.linalg.factor import FixedPattern
from critflow.linalg.matrices import block_laplacian, edge_blocks, spread_columns
from critflow.linalg.tolerances import EPS
from critflow.networks.network import Array, Network
from critflow.result import InputError

# s below this counts as zero unless the caller gives a tolerance: the smallest other s is 0.1 in standard networks of
# 1,000 vertices and falls as 1/√N_v; rounding leaves 1e-12.
ZERO_MODE = 1e-6
CLEAR_GAP = 10.0  # A count is trusted if no s lies within this factor of the tolerance
# s is zero to rounding below this number times the effect of the rounding of the coordinates on R; the bound adds the
# errors of all edges in quadrature, of which a few may coincide.
ROUNDING_MARGIN = 10.0
ITERATION_ERROR = 1e-12  # s that inverse iteration leaves for an exact zero
SQUARED_ROUNDING = 1e-7  # s below this is within the rounding of RᵀR, whose eigenvalues are s² with an error of 1e-15
DENSE_EDGES = 400  # up to this number of edges all s are computed by a dense decomposition

# Inverse iteration: shift in units of the squared tolerance, so that values below it gain a hundredfold in every step;
# most steps; largest singular value, in units of the tolerance, of a null space that has converged.
_SHIFT, _MOST_ITERATIONS, _CONVERGED = 0.01, 6, 1e-6
# Squared singular values near the first of these are resolved best in the search for the smallest that is not zero;
# the others follow where it does not converge within this number of restarts times edges, as for long chains.
_MODERATE, _RESTARTS_TIMES_SIZE = (1e-3, 1e-6, 1e-9), 3_000_000


class Spectrum:
    """Number of singular values of R that count as zero, the gap around them, and the null vectors.

    coordinates  (N_v, d), with the rounding errors that R inherits
    tolerance    values below count as zero; None: `ZERO_MODE`, and they must be zero to rounding

    bond_vectors, lengths     L (N_b, d) and |L| (N_b,)
    n_coordinates, n_motions  number of free coordinates, and of zero modes among them
    gap                       largest value that counts as zero and the smallest that does not, or limits of them
    pattern                   of RᵀR
    dense                     whether all values are computed

    Raises `InputError` for a tolerance that is not positive, or too small for a large network.
    """

    def __init__(self, network: Network, coordinates: Array, tolerance: float | None = None):
        self._tolerance = ZERO_MODE if tolerance is None else tolerance
        if not self._tolerance > 0:
            raise InputError(f"the tolerance must be positive, not {self._tolerance}: 1e-6 separates most networks")
        self.bond_vectors = network.bond_vectors(coordinates)
        self.lengths = length = np.linalg.norm(self.bond_vectors, axis=1)
        self.dense = network.n_edges <= DENSE_EDGES
        self._largest_rounding = np.inf
        if tolerance is None:
            # Norm of the change of all rows, each √2 times a direction.
            reach = float(max(np.abs(coordinates).max(), np.abs(network.boundary_vectors).max()))
            rounding = EPS * float(np.linalg.norm(np.sqrt(2) * (1 + reach / length)))
            self._largest_rounding = max(ROUNDING_MARGIN * rounding, 0.0 if self.dense else ITERATION_ERROR)
        self.n_coordinates = network.dimension * len(network.free)
        unit = self.bond_vectors / length[:, None]
        self._R = spread_columns(network, unit)
        self._network = network
        if not self.dense:
            self._count(network, unit)
            return
        left, values, right = np.linalg.svd(self._R.toarray())
        rank = int(np.count_nonzero(values >= self._tolerance))
        self._null = (left.T[rank:], right[rank:])
        self.n_motions = self.n_coordinates - rank
        self.gap = float(values[rank]) if rank < len(values) else 0.0, float(values[rank - 1]) if rank else np.nan

    @property
    def n_self_stresses(self) -> int:
        """N_s, by the number of zero modes."""
        return self.n_motions + self._network.n_edges - self.n_coordinates

    @cached_property
    def pattern(self) -> FixedPattern:
        return block_laplacian(self._network)

    def _count(self, network: Network, unit: Array) -> None:
        tolerance = self._tolerance
        if tolerance < SQUARED_ROUNDING:
            raise InputError(
                f"singular values below {SQUARED_ROUNDING:.0e} are below the rounding of RᵀR, which counts networks "
                f"of more than {DENSE_EDGES} edges: raise the tolerance from {tolerance:.1e}"
            )
        self._values = edge_blocks(np.ones(network.n_edges), unit, np.zeros(network.n_edges))
        counted, fewest = self._below(tolerance), max(self.n_coordinates - network.n_edges, 0)
        self.n_motions = max(counted, fewest)
        clear = self._below(CLEAR_GAP * tolerance) == counted >= fewest
        self.gap = (0.0, CLEAR_GAP * tolerance if clear else tolerance)

    def _below(self, threshold: float) -> int:
        """Number of singular values below a threshold: negative eigenvalues of RᵀR − threshold² (Sylvester)."""
        return self.pattern.factorize(self._values, -(threshold**2)).n_negative

    def doubt(self, largest_zero: float, smallest_nonzero: float) -> str:
        """The reason why a count with this gap cannot be trusted, or an empty string."""
        tolerance = self._tolerance
        if largest_zero > tolerance / CLEAR_GAP:
            near = largest_zero
        elif smallest_nonzero < CLEAR_GAP * tolerance:
            near = smallest_nonzero
        elif largest_zero > self._largest_rounding:
            return (
                f"a singular value of {largest_zero:.1e} is neither zero to rounding nor far from it: give a tolerance "
                "that decides whether it counts as zero, or move the configuration"
            )
        else:
            return ""
        return (
            f"a singular value of {near:.1e} lies so close to the tolerance {tolerance:.1e} that the counts are not "
            "certain: choose a tolerance inside a gap, or move the configuration"
        )

    def null_space(self, count: int, of_stresses: bool) -> tuple[Array, tuple[float, float]]:
        """An orthonormal basis of unit tensions (count, N_b) or motions (count, d·n_free), and the gap."""
        if self.dense:
            return self._null[0 if of_stresses else 1], self.gap
        vectors, largest = self.null_vectors(count, of_stresses)
        return vectors.T, (largest, self._smallest_nonzero(vectors, of_stresses))

    def null_vectors(self, count: int, of_stresses: bool) -> tuple[Array, float]:
        """Orthonormal vectors (n, count) of a null space, random ones of a larger one, and the norm of R on them."""
        M = self._R.T if of_stresses else self._R
        amplified = self._filter(_SHIFT * self._tolerance**2, of_stresses)
        vectors = np.random.default_rng(0).standard_normal((M.shape[1], count))
        largest = 0.0
        for _ in range(_MOST_ITERATIONS if count else 0):
            vectors = np.linalg.qr(amplified(vectors))[0]
            largest = float(np.linalg.svd(M @ vectors, compute_uv=False)[0])
            if largest < _CONVERGED * self._tolerance:
                break
        return vectors, largest

    def _smallest_nonzero(self, null: Array, of_stresses: bool) -> float:
        """The smallest singular value outside a null space (n, count), by Lanczos iteration."""
        most_restarts = max(_RESTARTS_TIMES_SIZE // len(null), 20)
        for shift in _MODERATE:
            moderate = self._filter(shift, of_stresses)

            def outside(vector: Array, resolve: Callable[[Array], Array] = moderate) -> Array:
                rest = resolve(vector[:, None])[:, 0]
                return rest - null @ (null.T @ rest)

            operator = LinearOperator((len(null), len(null)), matvec=outside, dtype=float)
            start = np.random.default_rng(1).standard_normal(len(null))
            try:
                weights = eigsh(
                    operator, k=1, which="LA", v0=start, tol=1e-9, maxiter=most_restarts, return_eigenvectors=False
                )
            except ArpackNoConvergence:
                continue
            return float(np.sqrt(max(shift * (1 / float(weights[0]) - 1), 0.0)))
        return self.gap[1]

    def _filter(self, shift: float, of_stresses: bool) -> Callable[[Array], Array]:
        """The map shift/(s² + shift) of the singular values s, on tensions or on motions (n, count)."""
        factor, R = self.pattern.factorize(self._values, shift), self._R
        if of_stresses:
            return lambda v: v - np.asarray(R @ factor.solve(np.asarray(R.T @ v)))
        return lambda v: shift * factor.solve(v)


def edge_without_length(lengths: Array) -> str:
    """A sentence where an edge is so short that it has no direction, else an empty string."""
    if lengths.min() > COLLAPSED * lengths.mean():
        return ""
    return f"edge {int(lengths.argmin())} has no length, so no direction: move its ends apart, or remove it"
