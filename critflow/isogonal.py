"""Isogonal modes: every edge keeps its direction, lengths change with closure.

Tensions alone therefore determine no configuration (`ForceBalanceL`).  The modes keep the force network T_α = σ_α L_α,
and with it the tension variance and every modulus at the transition: in balance T does the same work Σ T·A L on all
bond vectors L that close on the same cell, so μ_A = (Σ T·A L)²/(VΣ|T|²/k) depends on T alone.  At the largest B_0, T ∝
k L* with L* the configuration at σ = k, they keep the bulk response to any strain: L + s L* is in balance at every
expansion s, so that B(γ) = B_0 (1 + γ)^{−1/2} and C_B = −B_0/2.

A displacement u that keeps the direction of edge α moves both ends equally across it.  Where the three tensions of a
vertex balance, Σ τ_α n_α = 0 for the normals too, so the flow w_α = τ_α n_α·u is conserved at every vertex: isogonal
displacements are the circulations w of the graph.  A circulation around a single face moves each side of it outwards by
w/τ_α and its corners along their third edge.  On a torus the N_f faces span all circulations but the two that wind
around it, which are the translations; the sum of all faces is w = 0, the one relation among them.  So N_f − 1 =
N_v/2 − 1 modes remain, in any cell and at any configuration in balance (`BulkModulusHessian`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy
import scipy.sparse as sp
from numpy.typing import ArrayLike

from critflow.arguments import edge_values, floats, of_kind
from critflow.calls import running
from critflow.manifold import CriticalConfiguration, critical_configuration
from critflow.networks import Array, Network
from critflow.numerics import LARGEST_DENSE, power_of_two
from critflow.result import InputError, Record, Solution, Stats, Status
from critflow.sparse import spread_columns

ZERO_MODE = 1e-8  # singular values below this count as zero
FLAT_TRIANGLE = 1e-12  # twice the area of a degenerate force triangle, over the square of the mean tension


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class IsogonalOptimum(Solution[CriticalConfiguration]):
    """The best configuration of an isogonal family, and the amplitudes a (n_modes,) that lead to it."""

    amplitudes: Array


@dataclass(frozen=True, eq=False, repr=False)
class IsogonalModes(Record):
    """Isogonal modes at a configuration, as rows of dense or sparse matrices; amplitudes a (n_modes,) combine them.

    displacements  (n_modes, N_v·2) of the vertices, x and y of each in turn
    elongations    (n_modes, N_b) of the edges, along their own directions
    n_independent  number of independent modes, without translations
    gap            largest singular value counted as zero, and the next one (modes by singular values)
    """

    critical: CriticalConfiguration
    displacements: Array | sp.csr_array
    elongations: Array | sp.csr_array
    n_independent: int
    gap: tuple[float, float] | None = None

    def limit(self, direction: ArrayLike) -> float:
        """Largest multiple of a direction (n_modes,) with positive lengths; infinite if no edge shrinks."""
        shrinking = -self._elongation(direction) / self.critical.lengths
        return float(1 / shrinking.max()) if shrinking.max() > 0 else np.inf

    def walk(self, amplitudes: ArrayLike) -> CriticalConfiguration:
        """The configuration with lengths |L| + Σ a_m e_m and the same tensions, exact for amplitudes of any size.

        Raises `InputError` where a length would not be positive.
        """
        critical, network = self.critical, self.critical.network
        a = floats(amplitudes, "amplitudes")
        change = self._elongation(a)
        lengths = critical.lengths + change
        if not lengths.min() > 0:
            edge = int((change / critical.lengths).argmin())
            raise InputError(f"edge {edge} would lose its length: scale amplitudes by less than {self.limit(a):.4g}")
        x = critical.coordinates + (a @ self.displacements).reshape(-1, 2)
        x = x if network.pins else x - x[0]
        return critical_configuration(network, critical.tensions / lengths, x)

    def towards(self, direction: ArrayLike, fraction: float = 0.5) -> CriticalConfiguration:
        """The configuration at a fraction (0 ≤ fraction < 1) of `limit` in a direction (n_modes,)."""
        of_kind(float, fraction=fraction)
        if not 0 <= fraction < 1:
            raise InputError(f"the fraction must lie in 0 ≤ fraction < 1, not be {fraction}")
        limit = self.limit(direction)
        if not np.isfinite(limit):
            raise InputError("no edge shrinks in this direction: give one that changes lengths")
        return self.walk(fraction * limit * np.asarray(direction, dtype=float))

    def largest(self, weights: ArrayLike, shortest: float, throw: bool = True) -> IsogonalOptimum:
        """The configuration with the largest Σ w_α|L_α|, w (N_b,), whose edges all are `shortest` or longer.

        Lengths are linear in the amplitudes, so this is a linear program and its solution the best of the family; it
        is bounded, since Σ τ_α|L_α| does not change.
        """
        critical = self.critical
        w = edge_values(weights, critical.network.n_edges, "weights", positive=False)
        of_kind(float, shortest=shortest)
        of_kind(bool, throw=throw)
        if not 0 < shortest < np.inf:
            raise InputError(f"the shortest length must be positive and finite, not {shortest}")
        # The program has an absolute tolerance, 1e-7: lengths, elongations and weights are in units of their own.
        E = sp.csr_array(self.elongations)
        sizes = critical.lengths.mean(), np.abs(E.data).max(initial=0.0) or 1.0, np.abs(w).max(initial=0.0) or 1.0
        length, rate, weight = (power_of_two(float(size)) for size in sizes)
        E = E / rate
        room = (critical.lengths - shortest) / length
        found = scipy.optimize.linprog(-(E @ (w / weight)), A_ub=-E.T, b_ub=room, bounds=(None, None), method="highs")
        if found.status == 2:
            raise InputError(f"no isogonal change makes every edge {shortest:g} or longer: choose a smaller length")
        ok = found.status == 0
        amplitudes = found.x * (length / rate) if ok else np.full(E.shape[0], np.nan)
        value, status = (self.walk(amplitudes), Status.ok) if ok else (critical, Status.stalled)
        stats, note = Stats("linear program", int(found.nit)), "" if ok else found.message
        solution = IsogonalOptimum(value, status, stats, note, amplitudes=amplitudes)
        return solution.or_raise("no best isogonal change was found") if throw else solution

    def _elongation(self, amplitudes: ArrayLike) -> Array:
        a = floats(amplitudes, "amplitudes")
        n_modes = self.elongations.shape[0]
        if a.shape != (n_modes,) or not np.isfinite(a).all():
            raise InputError(f"the family needs {n_modes} finite amplitudes, not an array of shape {a.shape}")
        return np.asarray(a @ self.elongations)


def has_face_modes(network: Network) -> bool:
    """Whether a network is planar and periodic, with known faces and three edges at every vertex."""
    degree = np.bincount(network.edges.ravel(), minlength=network.n_vertices)
    return network.dimension == 2 and not network.pins and network.faces is not None and bool((degree == 3).all())


def face_modes(critical: CriticalConfiguration) -> IsogonalModes:
    """One isogonal mode for every face, sparse and local: sides move outwards by ⟨τ⟩/τ_α, corners along their spokes.

    Amplitudes a_f are lengths.  Only their differences count: side α, between faces l and r, moves by
    (a_l − a_r)⟨τ⟩/τ_α, and equal amplitudes on all faces change nothing.  Leave one face out for a basis.

    A corner with outward tensions T_1, T_2, T_3 and flows w_k out of it is displaced by
        u = [w_1(T_2 − T_3) + w_2(T_3 − T_1) + w_3(T_1 − T_2)]/3(T_1 × T_2).

    Raises `InputError` unless the network is planar, periodic, with known faces, three edges at every vertex, and no
    three tensions at a vertex parallel; `isogonal_modes` has none of these requirements.

    >>> import critflow as cf
    >>> from critflow.isogonal import face_modes
    >>> face_modes(cf.optimize(cf.lattice("honeycomb", 2, 2), 'B_0')).n_independent
    3
    """
    critical = of_kind(CriticalConfiguration, critical=critical)
    network, faces = critical.network, critical.network.faces
    if faces is None or not has_face_modes(network):
        raise InputError("faces, a cell of the plane and three edges a vertex are needed: use isogonal_modes instead")
    outward = np.argsort(network.edges.T.ravel(), kind="stable").reshape(-1, 3)
    edge, sign = outward % network.n_edges, np.where(outward < network.n_edges, 1.0, -1.0)
    pull = critical.sigma[:, None] * critical.bond_vectors
    T = sign[:, :, None] * (pull / np.abs(critical.tensions).mean())[edge]
    area = T[:, 0, 0] * T[:, 1, 1] - T[:, 0, 1] * T[:, 1, 0]
    if not np.abs(area).min() > FLAT_TRIANGLE:
        vertex = int(np.abs(area).argmin())
        raise InputError(f"the tensions at vertex {vertex} lie along one line or vanish: start where none is slack")
    arm = sign[:, :, None] * (np.roll(T, -1, axis=1) - np.roll(T, -2, axis=1)) / (3 * area[:, None, None])

    shape = (network.n_edges, 2 * network.n_vertices)
    rows = np.repeat(edge.ravel(), 2)
    columns = (2 * np.arange(network.n_vertices)[:, None, None] + np.array([[0, 1]] * 3)).ravel()
    corners = sp.csr_array((arm.ravel(), (rows, columns)), shape=shape)
    # A face lies to the left of its walk, and the normal n of an edge points to its left, into the face.
    walks = np.repeat(np.arange(faces.n_faces), faces.sizes)
    flow = sp.csr_array((-faces.signs.astype(float), (walks, faces.edges)), shape=(faces.n_faces, network.n_edges))
    displacements = sp.csr_array(flow @ corners)
    elongations = sp.csr_array(_elongations(critical, displacements))
    elongations.eliminate_zeros()
    return IsogonalModes(critical, displacements, elongations, faces.n_faces - 1)


@running("isogonal_modes")
def isogonal_modes(critical: CriticalConfiguration) -> IsogonalModes:
    """The isogonal modes of any small planar configuration, orthonormal in the displacements of the free vertices.

    Displacements u with no component of g u across any edge, by a dense singular value decomposition; singular values
    below 1e-8 (rows have norm √2) count as zero.  Raises `InputError` beyond about 2,000 vertices.

    >>> import critflow as cf
    >>> network = cf.voronoi_network(n_vertices=20, seed=1)
    >>> cf.isogonal_modes(cf.optimize(network, 'B_0')).n_independent
    9
    """
    critical = of_kind(CriticalConfiguration, critical=critical)
    network = critical.network
    if network.dimension != 2:
        raise InputError("isogonal modes are implemented in two dimensions only")
    size = 2 * len(network.free)
    if size**2 > LARGEST_DENSE:
        raise InputError(f"{size} × {size} is too large at once: face_modes() finds those of three edges a vertex")
    unit = _directions(critical)
    across = spread_columns(network, np.stack([-unit[:, 1], unit[:, 0]], axis=1))
    _, values, right = np.linalg.svd(across.toarray())
    zero = np.concatenate([values, np.zeros(len(right) - len(values))]) < ZERO_MODE
    displacements = np.zeros((int(zero.sum()), network.n_vertices, 2))
    displacements[:, network.free] = right[zero].reshape(-1, len(network.free), 2)
    flat = displacements.reshape(len(displacements), 2 * network.n_vertices)
    counted = values < ZERO_MODE
    gap = (float(values[counted].max(initial=0.0)), float(values[~counted].min(initial=np.inf)))
    return IsogonalModes(critical, flat, _elongations(critical, flat), len(flat), gap)


@running("length_shares")
def length_shares(critical: CriticalConfiguration) -> Array:
    """The matrix β (N_b, N_b), symmetric and similar to −∂ln|L|/∂ln σ: its eigenvalues are the shares of the lengths.

        β = √σ û·(g P⁻¹ gᵀ) û √σ = −(√σ/|L|) B (√σ/|L|),   B = ∂h/∂σ

    In a change of ln σ along an eigenvector, divided by √σ|L|, ln|L| takes the share λ of it, reversed, and the tension
    1 − λ: 0 the scale of the stress, 1 isogonal modes.  In the plane the others are symmetric about ½
    (docs/theory/relations.md has the proof).

    Raises `InputError` unless every σ is positive, and beyond about 4,000 edges.

    >>> import critflow as cf
    >>> from critflow.isogonal import length_shares
    >>> import numpy as np
    >>> shares = np.linalg.eigvalsh(length_shares(cf.optimize(cf.voronoi_network(n_vertices=20, seed=1), 'B_0')))
    >>> int(np.sum(shares > 1 - 1e-9)), bool(np.allclose(shares[1:21], 1 - shares[20:0:-1]))
    (9, True)
    """
    critical = of_kind(CriticalConfiguration, critical=critical)
    network, sigma, unit = critical.network, critical.sigma, _directions(critical)
    if not (sigma > 0).all():
        raise InputError(f"edge {int(sigma.argmin())} is not under tension: take the taut part, backbone(critical)")
    if network.n_edges**2 > LARGEST_DENSE:
        raise InputError(f"{network.n_edges} × {network.n_edges} is too large at once: take a smaller network")
    g = network.free_incidence.toarray()
    resistance = g @ critical.manifold.prestress.factorize(sigma).solve(g.T)
    root = np.sqrt(sigma)[:, None] * unit
    return np.asarray(0.5 * (resistance + resistance.T) * (root @ root.T))


def _directions(critical: CriticalConfiguration) -> Array:
    """Unit vectors along the edges, (N_b, d), else an `InputError`."""
    if len(critical.collapsed_edges):
        raise InputError(f"edge {critical.collapsed_edges[0]} has no length, so no direction: change its stress")
    return critical.bond_vectors / critical.lengths[:, None]


def _elongations(critical: CriticalConfiguration, displacements: Any) -> Any:
    """Elongations (n_modes, N_b) of the edges along their directions, by displacements (n_modes, N_v·2)."""
    unit, g = _directions(critical), critical.network.incidence
    return sum(displacements[:, axis::2] @ sp.csr_array(g.T @ sp.diags_array(unit[:, axis])) for axis in range(2))


def affine_bulk_modulus(critical: CriticalConfiguration) -> float:
    """B_0 of an affine dilation without relaxation, (1/d²V) Σ k|L|² (`BulkModulusAffNonAff`).

    Relaxation only softens, B_0 ≤ B_aff.  Among the configurations of the largest B_0 the two are equal at σ = k alone,
    which has the least Σ k|L|² of all (`BulkModulusAffine`).
    """
    network = critical.network
    return float(network.stiffness @ critical.lengths**2) / (network.dimension**2 * network.volume)
