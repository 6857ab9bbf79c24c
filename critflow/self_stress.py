"""Counts of self-stresses and zero modes, with the gap of singular values behind them, and certificates.

Maxwell–Calladine: N_0 − N_s = d N − N_b, with N_0 zero modes, N_s self-stresses and N free vertices
(`Maxwell-Calladine`); a periodic network counts all its vertices, so that N_0 includes the d translations.  Pins are
fixed to the ground: with pins no zero mode is trivial, not even a rotation about a single pin.

Where edges are slack these are the counts of the taut part, its vertices and edges; the slack part is floppy.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike, NDArray
from scipy.sparse.linalg import ArpackNoConvergence, LinearOperator, eigsh

from critflow.arguments import of_kind
from critflow.calls import running
from critflow.checks import components, edge_values
from critflow.digits import rounding_note
from critflow.manifold import COLLAPSED, CriticalConfiguration
from critflow.networks import Array, IntArray, Network, validated_coordinates
from critflow.numerics import EPS, LARGEST_DENSE, REGULARISATION, STABLE_MARGIN
from critflow.result import InputError, Record, Solution, Stats, Status
from critflow.saddles import Saddle, positive
from critflow.sparse import FixedPattern, block_laplacian, edge_blocks, spread_columns
from critflow.taut_part import Mask, backbone, taut_edges, taut_networks

# Singular values of the rigidity matrix R next to zero, and its null vectors on either side.
#
# Small networks by a dense decomposition.  Of large ones the inertia of RᵀR − t² is the number of singular values below
# t, without a dense matrix; the null vectors follow by inverse iteration of a block of that size.

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


# Whether a given stress stabilises the zero modes of a configuration (prestress stability).
#
# P(σ) must be positive on the null space of the rigidity matrix R.  For σ > 0 it is positive everywhere, and nothing is
# computed.  Otherwise the inertia of one saddle matrix proves it at any size; where it does not, as its regularisation
# hides singular values of R that are small but not zero, the zero modes themselves decide.

LARGEST_FORM = 2000  # most zero modes whose stiffness under one stress is found by all eigenvalues: some seconds


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
    form = forms_on_modes(network.free_incidence, sigma[None], modes.reshape(len(modes), -1, network.dimension))[0]
    least = float(np.linalg.eigvalsh(form)[0])
    margin = STABLE_MARGIN * float(np.mean(np.abs(sigma)))
    return least > 0 if abs(least) > margin else None


def forms_on_modes(incidence: sp.csr_array, stresses: Array, modes: Array) -> Array:
    """Zᵀ P(σ) Z of stresses (n, N_b) on orthonormal motions Z (m, n_vertices, d), (n, m, m).

    incidence  of the edges on the vertices that move, (N_b, n_vertices)
    """
    stretch = np.concatenate([np.asarray(incidence @ component.T) for component in np.moveaxis(modes, 2, 0)])
    return np.stack([stretch.T @ (weights[:, None] * stretch) for weights in np.tile(stresses, modes.shape[2])])


# Uniqueness of the self-stress of a configuration: proved vertex by vertex, and counted where that fails.
#
# A self-stress balances at every vertex.  Where z edges meet whose directions have rank r, balanced stresses have z − r
# degrees of freedom: one where three edges of the plane, or four in space, meet in general directions.  There every
# self-stress is a multiple of the known one, by a factor shared by vertices with a common stressed edge, so a connected
# network of such vertices has no other.  The cost is a few sums over the edges, without a matrix; a count by singular
# values (`spectrum`) costs a factorisation.

UNKNOWN_ERROR = 1e-8  # relative error assumed for bond vectors without error bounds
# Two directions differ if they do by this number times their errors, plus the rounding of products.
DIRECTION_MARGIN, DIRECTION_ROUNDING = 10.0, 1e-14


def require_only_self_stress(critical: CriticalConfiguration, instead: str) -> None:
    """Raise `InputError` for several self-stresses, or where rounding hides their number.

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


# Unbalanced forces below this, relative to the mean tension, are those of a self-stress: configurations from σ leave
# 1e-15, coordinates of eight digits 1e-8.
BALANCED = 1e-8
# Part of the size of a network within which pins lie on one point or line.
_COINCIDENT = 1e-6


@dataclass(frozen=True, eq=False, repr=False)
class Rigidity(Record):
    """Counts of a configuration.

    n_self_stresses, n_zero_modes   N_s and N_0 (translations of a periodic network included)
    self_stresses                   orthonormal geometric stresses σ, (N_s, N_b) (`selfstressdef`)
    largest_zero, smallest_nonzero  singular values on both sides of the tolerance: the gap behind the count
    n_trivial                       zero modes that any configuration has: the translations of a periodic network
    prestress_stable                whether the single self-stress stabilises all zero modes; None for N_s ≠ 1, and
                                    where a tolerance hides it
    n_slack                         slack edges, which enter no other count
    n_unstressed_vertices           vertices that no taut edge meets, which enter no other count
    """

    n_self_stresses: int
    n_zero_modes: int
    self_stresses: Array
    largest_zero: float
    smallest_nonzero: float
    n_trivial: int
    prestress_stable: bool | None
    n_slack: int = 0
    n_unstressed_vertices: int = 0

    @property
    def first_order_rigid(self) -> bool:
        """Whether no motion but the translations keeps all lengths to first order (`FirstOrder`)."""
        return self.n_zero_modes == self.n_trivial

    @property
    def rigid(self) -> bool:
        """Rigid to second order by its single self-stress, or without any zero mode but the translations."""
        return bool(self.prestress_stable) or self.first_order_rigid


@running("rigidity")
def rigidity(
    network: Network,
    coordinates: ArrayLike,
    tolerance: float | None = None,
    vectors: bool = True,
    *,
    taut: ArrayLike | None = None,
) -> Solution[Rigidity]:
    """Count the self-stresses and zero modes of a configuration (N_v, d).

    tolerance  singular values of R below it count as zero (R has rows of norm √2), as for configurations known to
               this accuracy only; None: 1e-6, and they must be zero to rounding
    vectors    False: counts only, for networks with very many self-stresses; of large ones the gap is then given by
               limits, no singular value between `tolerance` and ten times that, and those below stay unknown
    taut       (N_b,) bool, edges that count, such as σ ≠ 0; the others are slack and resist nothing.  None: all

    `Status.floppy` where there is no self-stress; `Status.singular` where an edge has no length, or where singular
    values lie so close to the tolerance, or by default so far from zero, that the count cannot be trusted; the note
    gives the reason.  Where edges are slack the note says how many.
    Raises `InputError` for self-stresses that would not fit in memory, and taut edges that cannot balance.

    >>> import critflow as cf
    >>> network = cf.lattice("triangular", 3, 3)
    >>> counts = cf.rigidity(network, network.positions).value
    >>> counts.n_self_stresses, counts.first_order_rigid
    (11, True)
    """
    network = of_kind(Network, network=network)
    of_kind(np.ndarray, coordinates=coordinates)
    of_kind(float, None, tolerance=tolerance)
    of_kind(bool, vectors=vectors)
    of_kind(np.ndarray, None, taut=taut)
    kept = np.ones(network.n_edges, bool) if taut is None else taut_edges(network, taut)
    if not kept.all():
        return _rigidity_of_taut(network, coordinates, tolerance, vectors, kept)
    x = validated_coordinates(network, coordinates)
    n_trivial = 0 if network.pins else network.dimension
    if note := edge_without_length(np.linalg.norm(network.bond_vectors(x), axis=1)):
        nothing = Rigidity(0, 0, np.zeros((0, network.n_edges)), np.nan, np.nan, n_trivial, None)
        return Solution(nothing, Status.singular, Stats("counts"), note)
    spectrum = Spectrum(network, x, tolerance)
    length = spectrum.lengths
    n_stresses = spectrum.n_self_stresses
    stresses, gap = np.zeros((0, network.n_edges)), spectrum.gap
    if vectors:
        check_size(n_stresses, network.n_edges, "self-stresses", "vectors=False counts them")
        tensions, gap = spectrum.null_space(n_stresses, of_stresses=True)
        # Unit tensions become geometric stresses, orthonormal again.
        stresses = np.linalg.qr((tensions / length).T)[0].T
    doubt = spectrum.doubt(*gap)
    stable = None
    if len(stresses) == 1 and not doubt:
        turned = 0.0 if tolerance is None else tolerance / gap[1]
        stable, stresses = _stabilises(network, stresses[0], spectrum.bond_vectors, turned, gap[0])
    value = Rigidity(n_stresses, spectrum.n_motions + n_trivial, stresses, *gap, n_trivial, stable)
    status = Status.singular if doubt else Status.floppy if n_stresses == 0 else Status.ok
    near = value.largest_zero if value.largest_zero > ITERATION_ERROR else value.smallest_nonzero
    note = "" if status is Status.ok else rounding_note(x, length, near) or doubt
    return Solution(value, status, Stats("counts", 1, residual=value.largest_zero), note)


def n_rotations(network: Network, coordinates: Array) -> int:
    """Rotations that keep all fixed vertices in place; the cell keeps a periodic network from rotating."""
    pins = np.array(list(network.pins.values()))
    if not len(pins) or network.offsets.any():
        return 0
    size = np.ptp(coordinates, axis=0).max()
    across = network.dimension - int(np.linalg.matrix_rank(pins - pins[0], tol=_COINCIDENT * size))
    return across * (across - 1) // 2


def _rigidity_of_taut(
    network: Network, coordinates: ArrayLike, tolerance: float | None, vectors: bool, taut: Mask
) -> Solution[Rigidity]:
    """The counts of all connected parts of the taut edges."""
    x = validated_coordinates(network, coordinates)
    parts = taut_networks(network, taut)
    found = [rigidity(part, x[vertices], tolerance, vectors) for part, _, vertices in parts]
    value = _total(network, [(solution.value, edges) for solution, (_, edges, _) in zip(found, parts, strict=True)])
    doubts = [solution.note for solution in found if solution.status is Status.singular]
    status = Status.singular if doubts else Status.ok if value.n_self_stresses else Status.floppy
    note = (
        f"{value.n_slack} of {network.n_edges} edges are slack and {value.n_unstressed_vertices} of "
        f"{network.n_vertices} vertices unstressed: the counts are those of the taut part"
    )
    if status is Status.floppy:
        note += ", which has no self-stress, so every modulus is zero"
    return Solution(value, status, Stats("counts", 1, residual=value.largest_zero), doubts[0] if doubts else note)


def _total(network: Network, parts: Sequence[tuple[Rigidity, IntArray]]) -> Rigidity:
    """The counts of connected parts together, each with the indices (n,) of its edges."""
    counts, edges = zip(*parts, strict=True)
    stresses, rows = np.zeros((sum(len(count.self_stresses) for count in counts), network.n_edges)), 0
    for count, places in parts:
        stresses[rows : rows + len(count.self_stresses), places] = count.self_stresses
        rows += len(count.self_stresses)
    stable, taut = [count.prestress_stable for count in counts], np.concatenate(edges)
    return Rigidity(
        sum(count.n_self_stresses for count in counts),
        sum(count.n_zero_modes for count in counts),
        stresses,
        max(count.largest_zero for count in counts),
        min(count.smallest_nonzero for count in counts),
        sum(count.n_trivial for count in counts),
        None if None in stable else all(stable),
        n_slack=network.n_edges - len(taut),
        n_unstressed_vertices=network.n_vertices - len(np.unique(network.edges[taut])),
    )


def check_size(count: int, size: int, name: str, instead: str) -> None:
    if count * size > LARGEST_DENSE:
        raise InputError(
            f"{count} {name} of {size} components each require {8e-9 * count * size:.1f} GB, more than the limit of "
            f"{8e-9 * LARGEST_DENSE:.2f} GB: {instead}, or take a part of the network"
        )


def _stabilises(
    network: Network, sigma: Array, L: Array, turned: float, largest_zero: float
) -> tuple[bool | None, Array]:
    """Whether ±σ is positive on all zero modes, and σ of that sign, or of positive sum, (1, N_b).

    turned  part by which a tolerance leaves σ and the modes open (`stiffness_error`); None where that hides the answer
    """
    sigma = sigma * np.sign(sigma.sum() or 1.0)
    saddle = Saddle(network)
    margin = stable_margin(network, sigma, turned, largest_zero)
    for sign in (1.0, -1.0):
        # A stress in tension on every edge has a configuration next to this one, and is positive on all its motions.
        if saddle.stable(sign * sigma, L, margin) or (turned and positive(sign * sigma)):
            return True, sign * sigma[None]
    open_question = turned > 0 and any(saddle.stable(sign * sigma, L, -margin) for sign in (1.0, -1.0))
    return None if open_question else False, sigma[None]


def stiffness_error(network: Network, sigma: Array, turned: float) -> float:
    """Error of z·P(σ)z on unit zero modes z where σ and z are off by a part `turned` of themselves.

    Singular values up to t that count as zero turn both by t over the smallest other one.
    """
    at_vertices = np.bincount(network.edges.ravel(), np.repeat(np.abs(sigma), 2), network.n_vertices)
    return 3 * turned * 2 * float(at_vertices.max())


def stable_margin(network: Network, sigma: Array, turned: float, largest_zero: float) -> float:
    """Part of the mean |σ| by which P must be positive in `Saddle.stable`, where singular values count as zero.

    The regularisation of that matrix gives a mode of singular value s the stiffness s²/δ.
    """
    mean = float(np.mean(np.abs(sigma)))
    added = network.dimension * largest_zero**2 / REGULARISATION
    return max(STABLE_MARGIN, stiffness_error(network, sigma, turned) / mean + added)


@dataclass(frozen=True, repr=False)
class Certificate(Record):
    """Quantities that show that a configuration is critical, and their accuracy.

    Where edges are slack, σ = 0, all but the residual describe the taut part.

    residual           largest unbalanced force relative to the mean tension
    least_tension      smallest tension relative to the mean
    n_self_stresses    expected 1
    gap                the singular values on both sides of the count
    rigid              whether that stress stabilises the zero modes
    stressed_fraction  fraction of the edges that are stressed
    n_slack            slack edges
    n_unstressed_vertices  vertices that only slack edges meet
    """

    residual: float
    least_tension: float
    n_self_stresses: int
    n_zero_modes: int
    gap: tuple[float, float]
    rigid: bool
    stressed_fraction: float = 1.0
    n_slack: int = 0
    n_unstressed_vertices: int = 0


@running("certify")
def certify(critical: CriticalConfiguration) -> Certificate:
    """Check a critical configuration from its coordinates and stresses alone; of slack ones the taut part.

    Raises `InputError` for stresses that are not finite or zero everywhere.

    >>> import critflow as cf
    >>> network = cf.voronoi_network(n_vertices=20, seed=1)
    >>> certificate = cf.certify(cf.optimize(network, 'B_0'))
    >>> certificate.n_self_stresses, certificate.rigid
    (1, True)
    """
    critical = of_kind(CriticalConfiguration, critical=critical)
    bone = backbone(critical)
    tensions = critical.tensions[bone.taut]
    found = [_certified(component, critical.residual) for component in bone.components]
    counts = [count for count, _ in found]
    return Certificate(
        critical.residual,
        float(tensions.min() / np.abs(tensions).mean()),
        sum(count.n_self_stresses for count in counts),
        sum(count.n_zero_modes for count in counts),
        (max(count.largest_zero for count in counts), min(count.smallest_nonzero for count in counts)),
        all(rigid for _, rigid in found),
        bone.stressed_fraction,
        bone.n_slack,
        len(bone.floppy_vertices),
    )


def _certified(critical: CriticalConfiguration, residual: float) -> tuple[Rigidity, bool]:
    """The counts of a configuration without slack edges, and whether it is rigid."""
    counted = rigidity(critical.network, critical.coordinates)
    counts = counted.value
    sigma, balanced = critical.sigma, residual < BALANCED
    if balanced and (sigma > 0).all():
        # P(σ) of a connected network is then positive definite, however small some stresses are.
        return counts, True
    # With several self-stresses, σ itself may stabilise all zero modes.
    by_sigma = counts.n_self_stresses > 1 and balanced
    rigid = counts.rigid or (by_sigma and Saddle(critical.network).stable(sigma, critical.bond_vectors))
    return counts, rigid and counted.status is not Status.singular


# The spaces of zero modes and of self-stresses, by orthonormal bases; `counts` has their dimensions.


@dataclass(frozen=True, eq=False, repr=False)
class ZeroModes(Record):
    """Displacements that change no length to first order, all orthonormal, zero at pins (`FirstOrder`).

    modes                           (N_0 − n_trivial, N_v, d), orthogonal to the translations of a periodic network
    largest_zero, smallest_nonzero  singular values of R on both sides of the tolerance
    """

    modes: Array
    largest_zero: float
    smallest_nonzero: float


@running("zero_modes")
def zero_modes(network: Network, coordinates: ArrayLike, tolerance: float | None = None) -> Solution[ZeroModes]:
    """All zero modes of a configuration (N_v, d), separate from the translations of a periodic network.

    `Status.singular` as for `rigidity`.  Raises `InputError` for modes that would not fit in memory.

    >>> import critflow as cf
    >>> from critflow.self_stress import zero_modes
    >>> network = cf.lattice("honeycomb", 2, 2)
    >>> zero_modes(network, network.positions).value.modes.shape
    (3, 8, 2)
    """
    network = of_kind(Network, network=network)
    of_kind(np.ndarray, coordinates=coordinates)
    of_kind(float, None, tolerance=tolerance)
    x = validated_coordinates(network, coordinates)
    d, n_vertices = network.dimension, network.n_vertices
    if note := edge_without_length(np.linalg.norm(network.bond_vectors(x), axis=1)):
        nothing = ZeroModes(np.zeros((0, n_vertices, d)), np.nan, np.nan)
        return Solution(nothing, Status.singular, Stats("zero modes"), note)
    spectrum = Spectrum(network, x, tolerance)
    check_size(spectrum.n_motions, spectrum.n_coordinates, "zero modes", "rigidity() counts them")
    motions, gap = spectrum.null_space(spectrum.n_motions, of_stresses=False)
    modes = np.zeros((len(motions), n_vertices, d))
    modes[:, network.free] = motions.reshape(len(motions), len(network.free), d)
    if not network.pins:
        # The grounded vertex is arbitrary: without their mean the modes are orthogonal to the translations.
        modes -= modes.mean(axis=1, keepdims=True)
        modes = np.linalg.qr(modes.reshape(len(modes), n_vertices * d).T)[0].T.reshape(modes.shape)
    doubt = spectrum.doubt(*gap)
    status, stats = Status.singular if doubt else Status.ok, Stats("zero modes", 1, residual=gap[0])
    return Solution(ZeroModes(modes, *gap), status, stats, doubt)


@dataclass(frozen=True, eq=False, repr=False)
class StressSpace(Record):
    """The stresses that share a configuration: the kernel of the map σ → configuration.

    Every σ' that balances on the same bond vectors, gᵀ(σ' ∘ L) = 0, has the same configuration, since P(σ') x = −gᵀ(σ'
    ∘ b) has one solution wherever P(σ') is regular.  With N_s = 1, as generic underconstrained networks have it, the
    map is one-to-one up to the scale of σ (`SelfStressParamaterization_bondvecs`).

    basis  orthonormal geometric stresses, (N_s, N_b); the first is that of the configuration itself, scaled to |σ| = 1
    gap    largest singular value of the rigidity matrix that counts as zero, and the next one
    """

    critical: CriticalConfiguration
    basis: Array
    gap: tuple[float, float]

    @property
    def dimension(self) -> int:
        """N_s: independent stresses that give this configuration; one where σ → configuration is one-to-one."""
        return len(self.basis)

    def distance(self, sigma: ArrayLike) -> float:
        """Sine of the angle between a stress (N_b,) and the space: 0 if it gives this configuration."""
        stress = edge_values(sigma, self.basis.shape[1], "sigma", positive=False)
        size = float(np.linalg.norm(stress))
        if size == 0:
            raise InputError("sigma is zero on every edge: give a stress with a non-zero entry")
        return float(np.linalg.norm(stress - (self.basis @ stress) @ self.basis)) / size


@running("self_stresses")
def self_stresses(critical: CriticalConfiguration, tolerance: float | None = None) -> Solution[StressSpace]:
    """The space of all stresses that give the same configuration as a critical one.

    `stats.residual` is the distance of the configuration's σ from the space.  `Status.singular` where an edge has no
    length or the count cannot be trusted, and `Status.floppy` where the coordinates admit no self-stress, so that σ
    cannot balance.

    >>> import critflow as cf
    >>> network = cf.voronoi_network(n_vertices=20, seed=1)
    >>> cf.self_stresses(cf.optimize(network, 'B_0')).ok
    True
    """
    critical = of_kind(CriticalConfiguration, critical=critical)
    of_kind(float, None, tolerance=tolerance)
    counts = rigidity(critical.network, critical.coordinates, tolerance)
    basis = counts.value.self_stresses
    if len(basis):
        # Gram–Schmidt from σ's components rotates the first member onto σ.
        aligned = np.linalg.qr(np.column_stack([basis @ critical.sigma, np.eye(len(basis))]))[0].T @ basis
        basis = aligned * np.sign(aligned[0] @ critical.sigma or 1.0)
    space = StressSpace(critical, basis, (counts.value.largest_zero, counts.value.smallest_nonzero))
    distance = space.distance(critical.sigma) if counts.ok else np.nan
    return Solution(space, counts.status, Stats("counts", 1, residual=distance), counts.note)
