"""Whether a self-stress is the only one of a configuration, and whether it stabilises the zero modes.

A self-stress balances at every vertex.  Where z edges meet whose directions have rank r, balanced stresses have z − r
degrees of freedom: one where three edges of the plane, or four in space, meet in general directions.  There every
self-stress is a multiple of the known one, by a factor shared by vertices with a common stressed edge, so a connected
network of such vertices has no other.  The cost is a few sums over the edges, without a matrix.  Where this fails,
self-stresses are counted by the singular values of the rigidity matrix R next to zero (`Spectrum`).

A stress stabilises if P(σ) is positive on the null space of R.  For σ > 0 it is positive everywhere, and nothing is
computed.  Otherwise the inertia of one saddle matrix proves it at any size; where it does not, as its regularisation
hides singular values of R that are small but not zero, the zero modes themselves decide.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.linalg import ArpackNoConvergence, LinearOperator, eigsh

from critflow.checks import components
from critflow.manifold import COLLAPSED, CriticalConfiguration
from critflow.networks import Array, Network, validated_coordinates
from critflow.numerics import EPS, LARGEST_DENSE
from critflow.result import InputError
from critflow.saddles import STABLE_MARGIN, Saddle
from critflow.sparse import FixedPattern, block_laplacian, edge_blocks, spread_columns

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
LARGEST_FORM = 2000  # most zero modes whose stiffness under one stress is found by all eigenvalues: some seconds
UNKNOWN_ERROR = 1e-8  # relative error assumed for bond vectors without error bounds
# Two directions differ if they do by this number times their errors, plus the rounding of products.
DIRECTION_MARGIN, DIRECTION_ROUNDING = 10.0, 1e-14


def require_one_stress_by_rank(critical: CriticalConfiguration, instead: str) -> None:
    """Raise `InputError` for several self-stresses of a configuration, or where rounding hides their number.

    instead  advice for the message
    """
    several = count_self_stresses(critical)
    if several is None:
        raise InputError(f"this requires one self-stress and rounding hides their number: {instead}")
    if several > 1:
        raise InputError(f"this requires one self-stress and the configuration has {several} or more: {instead}")


def count_self_stresses(critical: CriticalConfiguration) -> int | None:
    """Number of self-stresses, or a lower bound above one that counting coordinates gives; None: rounding hides it."""
    network = critical.network
    certain = network.least_self_stresses
    if certain > 1:
        return certain
    if only_self_stress(critical):
        return 1
    x = validated_coordinates(network, critical.coordinates)
    if edge_without_length(np.linalg.norm(network.bond_vectors(x), axis=1)):
        return None
    spectrum = Spectrum(network, x)
    return None if spectrum.doubt(*spectrum.gap) else spectrum.n_self_stresses


def only_self_stress(critical: CriticalConfiguration) -> bool:
    """Whether the directions of the edges alone prove that σ is the only self-stress; False: undecided."""
    network, length = critical.network, critical.lengths
    tail, head = network.edges.T
    free = np.ones(network.n_vertices, bool)
    free[list(network.pins)] = False
    # The stress of an edge between pins, or from a vertex to an image of it, is not restricted by balance.
    if not (critical.sigma.all() and (length > 0).all() and (tail != head).all() and (free[tail] | free[head]).all()):
        return False
    errors = critical.bond_errors / length
    errors = np.where(np.isfinite(errors), errors, UNKNOWN_ERROR)
    freedom = _freedom(network, critical.bond_vectors / length[:, None], errors)
    # The edges between free vertices connect all of these.
    n_parts = int(components(network.edges[free[network.edges].all(axis=1)], network.n_vertices).max()) + 1
    return bool((freedom[free] <= 1).all()) and n_parts - int(np.count_nonzero(~free)) == 1


def _freedom(network: Network, units: Array, errors: Array) -> NDArray[np.int64]:
    """z − r at each vertex, (N_v,), from unit vectors (N_b, d) of the edges and relative errors of them (N_b,).

    Error bound (proof): never less than in exact arithmetic, if the errors are bounds.
    """
    n, d = network.n_vertices, network.dimension
    tail, head = network.edges.T
    vertex = network.edges.T.ravel()
    met = np.bincount(vertex, minlength=n)
    if d == 2:
        # Rank 2 where some edge is not parallel to an arbitrary one of the vertex.
        one = np.zeros(n, int)
        one[tail] = one[head] = np.arange(network.n_edges)
        x, y = units.T
        apart = []
        for end in (tail, head):
            other = one[end]
            cross = np.abs(x * y[other] - y * x[other])
            apart.append(cross > DIRECTION_MARGIN * (errors + errors[other]) + DIRECTION_ROUNDING)
        rank = np.minimum(met, 1) + (np.bincount(vertex, np.concatenate(apart), n) > 0)
        return met - rank
    spread, wrong = np.zeros((n, d, d)), np.zeros(n)
    for end in (tail, head):
        np.add.at(spread, end, units[:, :, None] * units[:, None, :])
        np.add.at(wrong, end, errors)
    # Eigenvalues are squares of the singular values of the directions, so half of the digits remain.
    rounding = 2 * DIRECTION_MARGIN * wrong + DIRECTION_ROUNDING * met
    return met - (np.linalg.eigvalsh(spread) > rounding[:, None]).sum(axis=1)


def stabilises(network: Network, coordinates: Array, L: Array, sigma: Array) -> bool | None:
    """Whether P(σ) is positive on all zero modes of coordinates (N_v, d) with bond vectors L; None: undecided.

    sigma  (N_b,), exact as given: a self-stress that was computed has components of rounding, whose signs say nothing
    """
    if (sigma > 0).all() or Saddle(network).stable(sigma, L):
        return True
    if edge_without_length(np.linalg.norm(L, axis=1)):
        return None
    spectrum = Spectrum(network, coordinates)
    if spectrum.n_motions * spectrum.n_coordinates > LARGEST_DENSE or spectrum.n_motions > LARGEST_FORM:
        return None
    modes, gap = spectrum.null_space(spectrum.n_motions, of_stresses=False)
    if spectrum.doubt(*gap):
        return None
    if not len(modes):
        return True
    # Zᵀ P(σ) Z by the changes g Z of the bond vectors, (d·N_b, m).
    by_axis = np.moveaxis(modes.reshape(len(modes), -1, network.dimension), 2, 0)
    stretch = np.concatenate([np.asarray(network.free_incidence @ axis.T) for axis in by_axis])
    form = stretch.T @ (np.tile(sigma, network.dimension)[:, None] * stretch)
    least = float(np.linalg.eigvalsh(form)[0])
    margin = STABLE_MARGIN * float(np.mean(np.abs(sigma)))
    return least > 0 if abs(least) > margin else None


def edge_without_length(lengths: Array) -> str:
    """A sentence where an edge is so short that it has no direction, else an empty string."""
    if lengths.min() > COLLAPSED * lengths.mean():
        return ""
    return f"edge {int(lengths.argmin())} has no length, so no direction: move its ends apart, or remove it"


class Spectrum:
    """Number of singular values of R that count as zero, the gap around them, and the null vectors.

    Small networks by a dense decomposition.  Of large ones the inertia of RᵀR − t² is the number of singular values
    below t, without a dense matrix; the null vectors follow by inverse iteration of a block of that size.

    coordinates  (N_v, d), with the rounding errors that R inherits
    tolerance    values below count as zero; None: `ZERO_MODE`, and they must be zero to rounding

    bond_vectors, lengths       L (N_b, d) and |L| (N_b,)
    n_coordinates               number of free coordinates
    n_motions, n_self_stresses  numbers of zero modes among them, and of self-stresses
    gap                         largest value that counts as zero and the smallest that does not, or limits of them
    pattern                     of RᵀR
    dense                       whether all values are computed

    Raises `InputError` for a tolerance that is not positive, or too small for a large network.
    """

    def __init__(self, network: Network, coordinates: Array, tolerance: float | None = None):
        t = self._tolerance = ZERO_MODE if tolerance is None else tolerance
        if not t > 0:
            raise InputError(f"the tolerance must be positive, not {t}: 1e-6 separates most networks")
        self.network, self.dense = network, network.n_edges <= DENSE_EDGES
        self.bond_vectors = network.bond_vectors(coordinates)
        self.lengths = np.linalg.norm(self.bond_vectors, axis=1)
        self._largest_rounding = np.inf
        if tolerance is None:
            # Norm of the change of all rows, each √2 times a direction.
            reach = float(max(np.abs(coordinates).max(), np.abs(network.boundary_vectors).max()))
            rounding = EPS * float(np.linalg.norm(np.sqrt(2) * (1 + reach / self.lengths)))
            self._largest_rounding = max(ROUNDING_MARGIN * rounding, 0.0 if self.dense else ITERATION_ERROR)
        unit, n_edges = self.bond_vectors / self.lengths[:, None], network.n_edges
        self._R = spread_columns(network, unit)
        self.n_coordinates = self._R.shape[1]
        if self.dense:
            left, values, right = np.linalg.svd(self._R.toarray())
            rank = int(np.count_nonzero(values >= t))
            self._null = (left.T[rank:], right[rank:])
            self.n_motions = self.n_coordinates - rank
            self.gap = float(values[rank]) if rank < len(values) else 0.0, float(values[rank - 1]) if rank else np.nan
        else:
            if t < SQUARED_ROUNDING:
                raise InputError(
                    f"singular values below {SQUARED_ROUNDING:.0e} are below the rounding of RᵀR, which counts "
                    f"networks of more than {DENSE_EDGES} edges: raise the tolerance from {t:.1e}"
                )
            self._values = edge_blocks(np.ones(n_edges), unit, np.zeros(n_edges))
            # Singular values below a limit are negative eigenvalues of RᵀR − limit² (Sylvester).
            limits, fewest = (t, CLEAR_GAP * t), max(self.n_coordinates - n_edges, 0)
            below = [self.pattern.factorize(self._values, -(limit**2)).n_negative for limit in limits]
            self.n_motions = max(below[0], fewest)
            self.gap = (0.0, CLEAR_GAP * t if below[1] == below[0] >= fewest else t)
        self.n_self_stresses = self.n_motions + n_edges - self.n_coordinates

    @cached_property
    def pattern(self) -> FixedPattern:
        return block_laplacian(self.network)

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
        # 1. The vectors, by inverse iteration
        null, largest = self.null_vectors(count, of_stresses)

        # 2. The smallest singular value outside their space, by Lanczos iteration
        def outside(resolve: Callable[[Array], Array], vector: Array) -> Array:
            rest = resolve(vector[:, None])[:, 0]
            return rest - null @ (null.T @ rest)

        n, smallest = len(null), self.gap[1]
        start, most_restarts = np.random.default_rng(1).standard_normal(n), max(_RESTARTS_TIMES_SIZE // n, 20)
        for shift in _MODERATE:
            moderate = LinearOperator((n, n), matvec=partial(outside, self._filter(shift, of_stresses)), dtype=float)
            try:
                weights = eigsh(
                    moderate, k=1, which="LA", v0=start, tol=1e-9, maxiter=most_restarts, return_eigenvectors=False
                )
            except ArpackNoConvergence:
                continue
            smallest = float(np.sqrt(max(shift * (1 / float(weights[0]) - 1), 0.0)))
            break
        return null.T, (largest, smallest)

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

    def _filter(self, shift: float, of_stresses: bool) -> Callable[[Array], Array]:
        """The map shift/(s² + shift) of the singular values s, on tensions or on motions (n, count)."""
        factor, R = self.pattern.factorize(self._values, shift), self._R
        if of_stresses:
            return lambda v: v - np.asarray(R @ factor.solve(np.asarray(R.T @ v)))
        return lambda v: shift * factor.solve(v)
