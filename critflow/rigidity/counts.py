"""Counting: rigidity matrix, self-stresses and zero modes, with the gap of singular values that the count rests on.

Maxwell–Calladine: N_0 − N_s = d N − N_b, with N_0 zero modes, N_s self-stresses and N free vertices
(`Maxwell-Calladine`); a periodic network counts its vertices all, so that N_0 includes the d translations.  Pins
belong to the ground: with pins no zero mode is trivial, not even a turn about a single pin.

Small networks are counted by singular values.  Of large ones the inertia of RᵀR − t² tells how many singular values
lie below t, without any dense matrix; the null vectors then follow by inverse iteration of a block of that many.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike
from scipy.sparse.linalg import LinearOperator, eigsh

from critflow.critical.manifold import CriticalConfiguration
from critflow.critical.tolerances import COLLAPSED
from critflow.linalg.matrices import block_laplacian, edge_blocks
from critflow.linalg.saddle import Saddle
from critflow.linalg.tolerances import EPS
from critflow.networks.network import Array, Network
from critflow.result import InputError, Solution, Stats, Status

# Up to this many edges all singular values are found; beyond, those next to zero only.
_DENSE = 400

# No dense array made here has more entries: 160 MB.
LARGEST = 20_000_000

# Squares of singular values below this one are lost in the rounding of RᵀR.
_FINEST = 1e-7

# Squared singular values near this one are resolved best where the smallest that is not zero is looked for.
_MODERATE = 1e-3

# Singular values below this one count as zero where the caller does not say otherwise.
_TOLERANCE = 1e-6

# A count is trusted when no singular value lies within this factor of the tolerance.
_CLEAR = 10.0

# Singular values are zero to rounding below so many times what the rounding of coordinates does to R, or below what
# inverse iteration leaves.
_ROUNDED, _LEFT = 10.0, 1e-12


@dataclass(frozen=True, eq=False)
class Rigidity:
    """Counts of a configuration.

    n_self_stresses, n_zero_modes   N_s and N_0 (translations of a periodic network included)
    self_stresses                   orthonormal geometric stresses σ, (N_s, N_b) (`selfstressdef`)
    largest_zero, smallest_nonzero  singular values on both sides of the tolerance: the gap behind the count
    n_trivial                       zero modes that any configuration has: the translations of a periodic network
    prestress_stable                whether the single self-stress stabilises all zero modes; None for N_s ≠ 1
    """

    n_self_stresses: int
    n_zero_modes: int
    self_stresses: Array
    largest_zero: float
    smallest_nonzero: float
    n_trivial: int
    prestress_stable: bool | None

    @property
    def first_order_rigid(self) -> bool:
        """Whether no motion but the translations keeps all lengths to first order (`FirstOrder`)."""
        return self.n_zero_modes == self.n_trivial

    @property
    def rigid(self) -> bool:
        """Rigid to second order by its single self-stress, or without any zero mode but the translations."""
        return bool(self.prestress_stable) or self.first_order_rigid


@dataclass(frozen=True, eq=False)
class ZeroModes:
    """Displacements that change no length to first order, all orthonormal, zero at pins (`FirstOrder`).

    modes                           (N_0 − n_trivial, N_v, d), orthogonal to the trivial ones
    trivial                         (n_trivial, N_v, d): the translations of a periodic network
    largest_zero, smallest_nonzero  singular values of R on both sides of the tolerance
    """

    modes: Array
    trivial: Array
    largest_zero: float
    smallest_nonzero: float


def rigidity_matrix(network: Network, coordinates: Array) -> sp.csr_array:
    """R = ∂|L|/∂x over the free coordinates, (N_b, d·n_free): incidence times unit vectors (`RigidityMatrix`)."""
    L = network.bond_vectors(coordinates)
    return spread_columns(network, L / np.linalg.norm(L, axis=1)[:, None])


def spread_columns(network: Network, vectors: Array) -> sp.csr_array:
    """The matrix (N_b, d·n_free) with entries g_{αi} v_{αμ} of edge vectors v (N_b, d)."""
    g, d = network.free_incidence, network.dimension
    columns = [sp.diags_array(vectors[:, axis]) @ g for axis in range(d)]
    order = np.arange(d * g.shape[1]).reshape(d, -1).T.ravel()
    return sp.csr_array(sp.hstack(columns).tocsc()[:, order])


def rigidity(
    network: Network, coordinates: ArrayLike, tolerance: float | None = None, vectors: bool = True
) -> Solution[Rigidity]:
    """Count the self-stresses and zero modes of a configuration (N_v, d).

    Singular values of R below `tolerance` (R has rows of norm √2) count as zero: None takes 1e-6 and asks that they be
    zero to rounding, a number those of configurations that are only so near.  `Status.floppy` where there is no
    self-stress; `Status.singular` where an edge has no length, or where singular values lie so close to the tolerance,
    or by default so far from zero, that the count cannot be trusted.

    vectors  False: counts only, for networks with very many self-stresses; of large ones the gap is then known by
             bounds, no singular value between `tolerance` and ten times that, and those below stay unknown

    Raises `InputError` for self-stresses that would not fit in memory.
    """
    x, L, length = _edges(network, coordinates)
    n_trivial = 0 if network.pins else network.dimension
    if length is None:
        nothing = Rigidity(0, 0, np.zeros((0, network.n_edges)), np.nan, np.nan, n_trivial, None)
        return Solution(nothing, Status.singular, Stats("counts", details={"note": _no_length(network, L)}))
    spectrum = _Spectrum(network, x, L, length, tolerance)
    n_stresses = spectrum.n_motions + network.n_edges - spectrum.n_coordinates
    stresses, bounds = np.zeros((0, network.n_edges)), spectrum.bounds
    if vectors:
        _check_size(n_stresses, network.n_edges, "self-stresses", "vectors=False counts them")
        tensions, bounds = spectrum.null_space(n_stresses, of_stresses=True)
        # Unit tensions become geometric stresses, orthonormal again.
        stresses = np.linalg.qr((tensions / length).T)[0].T
    doubt = spectrum.doubt(*bounds)
    stable = None
    if len(stresses) == 1 and not doubt:
        stable, stresses = _stabilises(network, stresses[0], L)
    value = Rigidity(n_stresses, spectrum.n_motions + n_trivial, stresses, *bounds, n_trivial, stable)
    status = Status.singular if doubt else Status.floppy if n_stresses == 0 else Status.ok
    return Solution(value, status, Stats("counts", 1, 1, value.largest_zero, {"note": doubt} if doubt else {}))


def zero_modes(network: Network, coordinates: ArrayLike, tolerance: float | None = None) -> Solution[ZeroModes]:
    """All zero modes of a configuration (N_v, d), with the translations of a periodic network told apart.

    `Status.singular` as for `rigidity`.  Raises `InputError` for modes that would not fit in memory.
    """
    x, L, length = _edges(network, coordinates)
    d, n_vertices = network.dimension, network.n_vertices
    n_trivial = 0 if network.pins else d
    trivial = np.zeros((n_trivial, n_vertices, d))
    trivial[np.arange(n_trivial), :, np.arange(n_trivial)] = 1 / np.sqrt(n_vertices)
    if length is None:
        nothing = ZeroModes(np.zeros((0, n_vertices, d)), trivial, np.nan, np.nan)
        return Solution(nothing, Status.singular, Stats("zero modes", details={"note": _no_length(network, L)}))
    spectrum = _Spectrum(network, x, L, length, tolerance)
    _check_size(spectrum.n_motions, spectrum.n_coordinates, "zero modes", "rigidity() counts them")
    motions, bounds = spectrum.null_space(spectrum.n_motions, of_stresses=False)
    modes = np.zeros((len(motions), n_vertices, d))
    modes[:, network.free] = motions.reshape(len(motions), len(network.free), d)
    if n_trivial:
        # The ground is a choice: without their mean the modes are orthogonal to the translations.
        modes -= modes.mean(axis=1, keepdims=True)
        modes = np.linalg.qr(modes.reshape(len(modes), n_vertices * d).T)[0].T.reshape(modes.shape)
    doubt = spectrum.doubt(*bounds)
    stats = Stats("zero modes", 1, 1, bounds[0], {"note": doubt} if doubt else {})
    return Solution(ZeroModes(modes, trivial, *bounds), Status.singular if doubt else Status.ok, stats)


class _Spectrum:
    """What R does next to zero: how many motions it annihilates, and its null vectors on either side.

    coordinates  (N_v, d), whose rounding R has
    """

    def __init__(self, network: Network, coordinates: Array, L: Array, length: Array, given: float | None):
        tolerance = _TOLERANCE if given is None else given
        if not tolerance > 0:
            raise InputError(f"the tolerance must be positive, not {tolerance}: 1e-6 separates most networks")
        self._zero = np.inf
        if given is None:
            # The norm of what happens to the rows, each √2 times a direction.
            reach = float(max(np.abs(coordinates).max(), np.abs(network.boundary_vectors).max()))
            rounding = EPS * reach * float(np.linalg.norm(np.sqrt(2) / length))
            self._zero = max(_ROUNDED * rounding, _LEFT)
        self.n_coordinates = network.dimension * len(network.free)
        self._tolerance = tolerance
        unit = L / length[:, None]
        self._R = spread_columns(network, unit)
        self._small = network.n_edges <= _DENSE
        if not self._small and tolerance < _FINEST:
            raise InputError(
                f"singular values below {_FINEST:.0e} drown in the rounding of RᵀR, which counts networks of more than "
                f"{_DENSE} edges: raise the tolerance from {tolerance:.1e}"
            )
        if self._small:
            left, values, right = np.linalg.svd(self._R.toarray())
            rank = int(np.count_nonzero(values >= tolerance))
            self._null = (left.T[rank:], right[rank:])
            self.n_motions = self.n_coordinates - rank
            self.bounds = (
                float(values[rank]) if rank < len(values) else 0.0,
                float(values[rank - 1]) if rank else np.nan,
            )
        else:
            self._pattern = block_laplacian(network)
            self._values = edge_blocks(np.ones(network.n_edges), unit, np.zeros(network.n_edges))
            counted, fewest = self._below(tolerance), max(self.n_coordinates - network.n_edges, 0)
            self.n_motions = max(counted, fewest)
            clear = self._below(_CLEAR * tolerance) == counted >= fewest
            self.bounds = (0.0, _CLEAR * tolerance if clear else tolerance)

    def _below(self, threshold: float) -> int:
        """Number of singular values below a threshold: negative eigenvalues of RᵀR − threshold² (Sylvester)."""
        return self._pattern.factorize(self._values, -(threshold**2)).n_negative

    def doubt(self, largest_zero: float, smallest_nonzero: float) -> str:
        """Why a count cannot be trusted, or nothing."""
        tolerance = self._tolerance
        if largest_zero > tolerance / _CLEAR:
            near = largest_zero
        elif smallest_nonzero < _CLEAR * tolerance:
            near = smallest_nonzero
        elif largest_zero > self._zero:
            return (
                f"a singular value of {largest_zero:.1e} is neither zero to rounding nor far from it: give a tolerance "
                "to say whether it counts as zero, or move the configuration"
            )
        else:
            return ""
        return (
            f"a singular value of {near:.1e} lies so close to the tolerance {tolerance:.1e} that the counts are not "
            "certain: choose a tolerance inside a gap, or move the configuration"
        )

    def null_space(self, count: int, of_stresses: bool) -> tuple[Array, tuple[float, float]]:
        """An orthonormal basis of unit tensions (count, N_b) or motions (count, d·n_free), and the gap."""
        if self._small:
            return self._null[0 if of_stresses else 1], self.bounds
        M = self._R.T if of_stresses else self._R
        # Values below the tolerance gain a hundredfold over others in every step.
        damped = self._filter(0.01 * self._tolerance**2, of_stresses)
        vectors = np.random.default_rng(0).standard_normal((M.shape[1], count))
        largest = 0.0
        for _ in range(6 if count else 0):
            vectors = np.linalg.qr(damped(vectors))[0]
            largest = float(np.linalg.svd(M @ vectors, compute_uv=False)[0])
            if largest < 1e-6 * self._tolerance:
                break

        def others(vector: Array) -> Array:
            """The part of a vector outside the null space, filtered at moderate values, which are well resolved."""
            outside = vector - vectors @ (vectors.T @ vector)
            outside = moderate(outside[:, None])[:, 0]
            return outside - vectors @ (vectors.T @ outside)

        # Every factorisation of the pattern makes the last one stale, so this one comes after the loop.
        moderate = self._filter(_MODERATE, of_stresses)
        operator = LinearOperator((len(vectors), len(vectors)), matvec=others, dtype=float)
        start = np.random.default_rng(1).standard_normal(len(vectors))
        weight = float(eigsh(operator, k=1, which="LA", v0=start, tol=1e-9, return_eigenvectors=False)[0])
        return vectors.T, (largest, float(np.sqrt(max(_MODERATE * (1 / weight - 1), 0.0))))

    def _filter(self, shift: float, of_stresses: bool) -> Callable[[Array], Array]:
        """The map shift/(s² + shift) of the singular values s, on tensions or on motions (n, count)."""
        factor = self._pattern.factorize(self._values, shift)

        def on_stresses(v: Array) -> Array:
            return v - np.asarray(self._R @ factor.solve(np.asarray(self._R.T @ v)))

        def on_motions(v: Array) -> Array:
            return shift * factor.solve(v)

        return on_stresses if of_stresses else on_motions


def _edges(network: Network, coordinates: ArrayLike) -> tuple[Array, Array, Array | None]:
    """Coordinates, bond vectors, and lengths or None where an edge has none.  Raises `InputError` for other shapes."""
    x = np.asarray(coordinates, dtype=float)
    if x.shape != (network.n_vertices, network.dimension) or not np.isfinite(x).all():
        shape = (network.n_vertices, network.dimension)
        raise InputError(f"coordinates must be finite and of shape {shape}, not {x.shape}: one row a vertex")
    L = network.bond_vectors(x)
    length = np.linalg.norm(L, axis=1)
    return x, L, length if length.min() > COLLAPSED * length.mean() else None


def _no_length(network: Network, L: Array) -> str:
    return f"edge {int(np.linalg.norm(L, axis=1).argmin())} has no length, so no direction"


def _check_size(count: int, size: int, what: str, instead: str) -> None:
    if count * size > LARGEST:
        raise InputError(
            f"{count} {what} of {size} components each are {8e-9 * count * size:.1f} GB, more than is made here: "
            f"{instead}, or take a part of the network"
        )


def _stabilises(network: Network, sigma: Array, L: Array) -> tuple[bool, Array]:
    """Whether ±σ is positive on all zero modes, and σ of that sign, or of positive sum, (1, N_b)."""
    sigma = sigma * np.sign(sigma.sum() or 1.0)
    saddle = Saddle(network)
    for sign in (1.0, -1.0):
        if saddle.stable(sign * sigma, L):
            return True, sign * sigma[None]
    return False, sigma[None]


@dataclass(frozen=True)
class Certificate:
    """What shows that a configuration is critical, and how good it is.

    residual         largest unbalanced force relative to the mean tension
    least_tension    smallest tension relative to the mean
    n_self_stresses  expected 1; `gap` holds the singular values on both sides of the count
    rigid            whether that stress stabilises the zero modes
    """

    residual: float
    least_tension: float
    n_self_stresses: int
    n_zero_modes: int
    gap: tuple[float, float]
    rigid: bool


# A stress that leaves larger forces than this, relative to the mean tension, balances nothing.
_BALANCED = 1e-8


def certify(critical: CriticalConfiguration) -> Certificate:
    """Check a critical configuration from its coordinates and stresses alone."""
    counted = rigidity(critical.network, critical.coordinates)
    counts, tensions = counted.value, critical.tensions
    # With several self-stresses the one at hand may already do it.
    by_its_own = counts.n_self_stresses > 1 and critical.residual < _BALANCED
    rigid = counts.rigid or (by_its_own and Saddle(critical.network).stable(critical.sigma, critical.bond_vectors))
    return Certificate(
        critical.residual,
        float(tensions.min() / np.abs(tensions).mean()),
        counts.n_self_stresses,
        counts.n_zero_modes,
        (counts.largest_zero, counts.smallest_nonzero),
        rigid and counted.status is not Status.singular,
    )
