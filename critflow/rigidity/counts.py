"""Counts of self-stresses and zero modes, with the gap of singular values behind them, and certificates.

Maxwell–Calladine: N_0 − N_s = d N − N_b, with N_0 zero modes, N_s self-stresses and N free vertices
(`Maxwell-Calladine`); a periodic network counts all its vertices, so that N_0 includes the d translations.  Pins are
fixed to the ground: with pins no zero mode is trivial, not even a rotation about a single pin.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from critflow.critical.manifold import CriticalConfiguration
from critflow.critical.tolerances import COLLAPSED
from critflow.linalg.saddle import Saddle
from critflow.networks.network import Array, Network, validated_coordinates
from critflow.result import InputError, Solution, Stats, Status
from critflow.rigidity.spectrum import Spectrum
from critflow.rigidity.tolerances import BALANCED, LARGEST_DENSE


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


def rigidity(
    network: Network, coordinates: ArrayLike, tolerance: float | None = None, vectors: bool = True
) -> Solution[Rigidity]:
    """Count the self-stresses and zero modes of a configuration (N_v, d).

    tolerance  singular values of R below it count as zero (R has rows of norm √2), as for configurations known to
               this accuracy only; None: 1e-6, and they must be zero to rounding
    vectors    False: counts only, for networks with very many self-stresses; of large ones the gap is then given by
               limits, no singular value between `tolerance` and ten times that, and those below stay unknown

    `Status.floppy` where there is no self-stress; `Status.singular` where an edge has no length, or where singular
    values lie so close to the tolerance, or by default so far from zero, that the count cannot be trusted; the note
    gives the reason.  Raises `InputError` for self-stresses that would not fit in memory.
    """
    x, L, length = _edges(network, coordinates)
    n_trivial = 0 if network.pins else network.dimension
    if length is None:
        nothing = Rigidity(0, 0, np.zeros((0, network.n_edges)), np.nan, np.nan, n_trivial, None)
        return Solution(nothing, Status.singular, Stats("counts"), _no_length(L))
    spectrum = Spectrum(network, x, L, length, tolerance)
    n_stresses = spectrum.n_motions + network.n_edges - spectrum.n_coordinates
    stresses, gap = np.zeros((0, network.n_edges)), spectrum.gap
    if vectors:
        _check_size(n_stresses, network.n_edges, "self-stresses", "vectors=False counts them")
        tensions, gap = spectrum.null_space(n_stresses, of_stresses=True)
        # Unit tensions become geometric stresses, orthonormal again.
        stresses = np.linalg.qr((tensions / length).T)[0].T
    doubt = spectrum.doubt(*gap)
    stable = None
    if len(stresses) == 1 and not doubt:
        stable, stresses = _stabilises(network, stresses[0], L)
    value = Rigidity(n_stresses, spectrum.n_motions + n_trivial, stresses, *gap, n_trivial, stable)
    status = Status.singular if doubt else Status.floppy if n_stresses == 0 else Status.ok
    return Solution(value, status, Stats("counts", 1, residual=value.largest_zero), doubt)


def zero_modes(network: Network, coordinates: ArrayLike, tolerance: float | None = None) -> Solution[ZeroModes]:
    """All zero modes of a configuration (N_v, d), separate from the translations of a periodic network.

    `Status.singular` as for `rigidity`.  Raises `InputError` for modes that would not fit in memory.
    """
    x, L, length = _edges(network, coordinates)
    d, n_vertices = network.dimension, network.n_vertices
    n_trivial = 0 if network.pins else d
    trivial = np.zeros((n_trivial, n_vertices, d))
    trivial[np.arange(n_trivial), :, np.arange(n_trivial)] = 1 / np.sqrt(n_vertices)
    if length is None:
        nothing = ZeroModes(np.zeros((0, n_vertices, d)), trivial, np.nan, np.nan)
        return Solution(nothing, Status.singular, Stats("zero modes"), _no_length(L))
    spectrum = Spectrum(network, x, L, length, tolerance)
    _check_size(spectrum.n_motions, spectrum.n_coordinates, "zero modes", "rigidity() counts them")
    motions, gap = spectrum.null_space(spectrum.n_motions, of_stresses=False)
    modes = np.zeros((len(motions), n_vertices, d))
    modes[:, network.free] = motions.reshape(len(motions), len(network.free), d)
    if n_trivial:
        # The grounded vertex is arbitrary: without their mean the modes are orthogonal to the translations.
        modes -= modes.mean(axis=1, keepdims=True)
        modes = np.linalg.qr(modes.reshape(len(modes), n_vertices * d).T)[0].T.reshape(modes.shape)
    doubt = spectrum.doubt(*gap)
    status, stats = Status.singular if doubt else Status.ok, Stats("zero modes", 1, residual=gap[0])
    return Solution(ZeroModes(modes, trivial, *gap), status, stats, doubt)


def _edges(network: Network, coordinates: ArrayLike) -> tuple[Array, Array, Array | None]:
    """Coordinates, bond vectors, and lengths or None where an edge has none.  Raises `InputError` for other shapes."""
    x = validated_coordinates(network, coordinates)
    L = network.bond_vectors(x)
    length = np.linalg.norm(L, axis=1)
    return x, L, length if length.min() > COLLAPSED * length.mean() else None


def _no_length(L: Array) -> str:
    return f"edge {int(np.linalg.norm(L, axis=1).argmin())} has no length, so no direction"


def _check_size(count: int, size: int, name: str, instead: str) -> None:
    if count * size > LARGEST_DENSE:
        raise InputError(
            f"{count} {name} of {size} components each require {8e-9 * count * size:.1f} GB, more than the limit of "
            f"{8e-9 * LARGEST_DENSE:.2f} GB: {instead}, or take a part of the network"
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
    """Quantities that show that a configuration is critical, and their accuracy.

    residual         largest unbalanced force relative to the mean tension
    least_tension    smallest tension relative to the mean
    n_self_stresses  expected 1
    gap              the singular values on both sides of the count
    rigid            whether that stress stabilises the zero modes
    """

    residual: float
    least_tension: float
    n_self_stresses: int
    n_zero_modes: int
    gap: tuple[float, float]
    rigid: bool


def certify(critical: CriticalConfiguration) -> Certificate:
    """Check a critical configuration from its coordinates and stresses alone."""
    counted = rigidity(critical.network, critical.coordinates)
    counts, tensions = counted.value, critical.tensions
    # With several self-stresses, σ itself may stabilise all zero modes.
    by_sigma = counts.n_self_stresses > 1 and critical.residual < BALANCED
    rigid = counts.rigid or (by_sigma and Saddle(critical.network).stable(critical.sigma, critical.bond_vectors))
    return Certificate(
        critical.residual,
        float(tensions.min() / np.abs(tensions).mean()),
        counts.n_self_stresses,
        counts.n_zero_modes,
        (counts.largest_zero, counts.smallest_nonzero),
        rigid and counted.status is not Status.singular,
    )
