"""Counting: rigidity matrix, self-stresses and zero modes, with the gap that the count rests on.

Maxwell–Calladine: N_0 − N_s = d N − N_b, with N_0 zero modes, N_s self-stresses and N free vertices; a periodic
network counts its vertices all, so that N_0 includes the d translations.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import eigsh

from critflow.linalg import Saddle
from critflow.manifold import COLLAPSED, CriticalConfiguration
from critflow.network import Array, Network
from critflow.result import Solution, Stats, Status

# Up to this many edges all singular values are found; beyond, the smallest ones only.
_DENSE = 400


@dataclass(frozen=True, eq=False)
class Rigidity:
    """Counts of a configuration.

    n_self_stresses, n_zero_modes   N_s and N_0 (translations of a periodic network included)
    self_stresses                   orthonormal geometric stresses σ, (N_s, N_b)
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
    def rigid(self) -> bool:
        """Rigid to second order by its single self-stress, or without any zero mode but the translations."""
        return bool(self.prestress_stable) or self.n_zero_modes == self.n_trivial


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


def rigidity(network: Network, coordinates: Array, tolerance: float = 1e-6, most: int = 6) -> Solution[Rigidity]:
    """Count the self-stresses and zero modes of a configuration (N_v, d).

    Singular values of R below `tolerance` (R has rows of norm √2) count as zero; of large networks at most `most`
    self-stresses more than the counts demand are found.  `Status.floppy` where there is none, `Status.singular` where
    an edge has no length or all values found are zero, so that the count is a lower bound.
    """
    L = network.bond_vectors(coordinates)
    length = np.linalg.norm(L, axis=1)
    trivial = 0 if network.pins else network.dimension
    if not length.min() > COLLAPSED * length.mean():
        nothing = Rigidity(0, 0, np.zeros((0, network.n_edges)), np.nan, np.nan, trivial, None)
        note = f"edge {int(length.argmin())} has no length, so no direction"
        return Solution(nothing, Status.singular, Stats("counts", details={"note": note}))
    R = rigidity_matrix(network, coordinates)
    if network.n_edges <= _DENSE:
        left, values, _ = np.linalg.svd(R.toarray())
        values = np.concatenate([values, np.zeros(max(0, network.n_edges - len(values)))])[::-1]
        tensions = left.T[::-1]
    else:
        # Just below zero the shifted matrix is positive definite, and the null vectors dominate its inverse.
        certain = max(0, network.n_edges - R.shape[1])
        squares, vectors = eigsh(
            (R @ R.T).tocsc(), k=min(certain + most, network.n_edges - 1), sigma=-1e-8, v0=np.ones(network.n_edges)
        )
        order = np.argsort(squares)
        values, tensions = np.sqrt(np.maximum(squares[order], 0)), vectors.T[order]
    n_stresses = int(np.count_nonzero(values < tolerance))
    # Unit tensions become geometric stresses, orthonormal again.
    stresses = np.linalg.qr((tensions[:n_stresses] / length).T)[0].T
    free_coordinates = network.dimension * len(network.free) + trivial
    stable = None
    if n_stresses == 1:
        sigma = stresses[0] * np.sign(stresses[0].sum() or 1.0)
        stresses = sigma[None]
        stable = Saddle(network).stable(sigma, L)
    value = Rigidity(
        n_stresses,
        free_coordinates - network.n_edges + n_stresses,
        stresses,
        float(values[n_stresses - 1]) if n_stresses else 0.0,
        float(values[n_stresses]) if n_stresses < len(values) else np.nan,
        trivial,
        stable,
    )
    status = Status.floppy if n_stresses == 0 else Status.ok
    if network.n_edges > _DENSE and n_stresses == len(values):
        status = Status.singular
    return Solution(value, status, Stats("counts", 1, 1, value.largest_zero))


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


def certify(critical: CriticalConfiguration) -> Certificate:
    """Check a critical configuration from its coordinates and stresses alone."""
    counts = rigidity(critical.network, critical.coordinates).value
    tensions = critical.tensions
    return Certificate(
        critical.residual,
        float(tensions.min() / np.abs(tensions).mean()),
        counts.n_self_stresses,
        counts.n_zero_modes,
        (counts.largest_zero, counts.smallest_nonzero),
        counts.rigid,
    )
