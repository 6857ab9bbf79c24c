"""Counts of self-stresses and zero modes, with the gap of singular values behind them.

Maxwell–Calladine: N_0 − N_s = d N − N_b, with N_0 zero modes, N_s self-stresses and N free vertices
(`Maxwell-Calladine`); a periodic network counts all its vertices, so that N_0 includes the d translations.  Pins are
fixed to the ground: with pins no zero mode is trivial, not even a rotation about a single pin.

Where edges are slack these are the counts of the taut part, its vertices and edges; the slack part is floppy.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from critflow.arguments import of_kind
from critflow.calls import running
from critflow.networks import Array, IntArray, Network, validated_coordinates
from critflow.numerics import LARGEST_DENSE
from critflow.result import InputError, Record, Solution, Stats, Status
from critflow.saddles import REGULARISATION, STABLE_MARGIN, Saddle, positive
from critflow.self_stress import ITERATION_ERROR, Spectrum, edge_without_length
from critflow.taut_part import Mask, taut_networks
from critflow_extras.pruning.digits import rounding_note
from critflow_extras.pruning.pruning import taut_mask

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
    >>> import critflow_extras as ce
    >>> network = cf.lattice("triangular", 3, 3)
    >>> counts = ce.rigidity(network, network.positions).value
    >>> counts.n_self_stresses, counts.first_order_rigid
    (11, True)
    """
    network = of_kind(Network, network=network)
    of_kind(np.ndarray, coordinates=coordinates)
    of_kind(float, None, tolerance=tolerance)
    of_kind(bool, vectors=vectors)
    of_kind(np.ndarray, None, taut=taut)
    kept = np.ones(network.n_edges, bool) if taut is None else taut_mask(network, taut)
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
