"""Configurations in balance under tensions and pressures: tissues and foams of the plane.

With complex bond vectors L = g z + b, z = x + iy, a tension σ_α|L_α| along each edge and a pressure in each face,

    gᵀ(σ ∘ L) + (i/2)|g|ᵀ(q ∘ L) = 0,     q_α = p_left − p_right,

where each end of an edge carries half of the force of the pressures on it.  Balance is linear in z.  Its matrix
P(σ) + iQ(q) is Hermitian, so the configuration costs one sparse solve, and derivatives one more with the same factor.
It is positive definite for small differences of pressure; its inertia says where this ends.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, field
from functools import cached_property
from typing import ClassVar

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike

from critflow.arguments import edge_values
from critflow.double_double import Extended, add, extended, multiply, two_sum
from critflow.faces import Faces
from critflow.manifold import CriticalManifold, ForceBalance
from critflow.networks import Array, Network
from critflow.numerics import EPS, set_read_only
from critflow.refinement import HOPELESS, LOST, MOST_STEPS, SAFETY, UNSEEN, ExtendedGeometry, magnification
from critflow.result import InputError, Record, Stats, Status
from critflow.sparse import Factor, FixedPattern, end_pairs, free_ends

# Force of the pressures on an edge from its left to its right, from (L_x, L_y): q(L_y, −L_x), half at each end.
_TURNED = np.array([0.5, -0.5])


@dataclass(frozen=True, eq=False, repr=False)
class PressurisedConfiguration(Record):
    """A planar network in balance under σ (N_b,) and pressures p (N_f,): coordinates (N_v, 2), bond vectors (N_b, 2).

    σ and p have one scale, Σσ² = N_b.  Outside a patch the pressure is zero; of a periodic network only differences
    count, and p has the mean zero.

    error_bound  estimate of the largest error of a coordinate, against the exact configuration of the given σ and p
    """

    network: Network
    sigma: Array
    pressures: Array
    coordinates: Array
    bond_vectors: Array
    error_bound: float = np.nan
    network_refusal: ClassVar[str] = "it is in balance under pressures, which this call does not contain"

    def __post_init__(self) -> None:
        set_read_only(self, "sigma", "pressures", "coordinates", "bond_vectors")

    @cached_property
    def lengths(self) -> Array:
        """|L_α|, (N_b,)."""
        return np.linalg.norm(self.bond_vectors, axis=1)

    @property
    def bond_errors(self) -> Array:
        """Estimates of the errors |δL_α|, (N_b,)."""
        return np.full(len(self.sigma), np.sqrt(8) * self.error_bound)

    @property
    def tensions(self) -> Array:
        """τ_α = σ_α |L_α|, (N_b,), up to the scale of σ and p."""
        return self.sigma * self.lengths

    @cached_property
    def residual(self) -> float:
        """Largest unbalanced force of tensions and pressures, over the mean tension."""
        force = unbalanced_forces(self.network, self.sigma, self.pressures, self.bond_vectors)
        return float(np.abs(force).max(initial=0.0) / np.abs(self.tensions).mean())


def pressure_jumps(network: Network) -> sp.csr_array:
    """J (N_b, N_f) with q = J p, the pressure on the left of each edge less that on its right.

    Raises `InputError` for networks that are not planar or have no known faces.
    """
    if network.dimension != 2:
        raise InputError("pressures need the faces of a planar network, and this one lies in space: leave them out")
    if network.faces is None:
        raise InputError(
            "pressures need the faces of a planar network: network_from(edges=, positions=, pins=) finds them where no "
            "edges cross"
        )
    if (network.edges[:, 0] == network.edges[:, 1]).any():
        raise InputError("an edge joins a vertex to its own image, which pressures exclude: repeat the cell")
    faces: Faces = network.faces
    owner = np.repeat(np.arange(faces.n_faces), faces.sizes)
    return sp.csr_array((faces.signs.astype(float), (faces.edges, owner)), shape=(network.n_edges, faces.n_faces))


def unbalanced_forces(network: Network, sigma: Array, pressures: Array, bond_vectors: Array) -> Array:
    """−gᵀ(σ ∘ L) − (i/2)|g|ᵀ(q ∘ L) on the free vertices, (n_free, 2)."""
    pushed = (pressure_jumps(network) @ pressures)[:, None] * bond_vectors[:, ::-1] * _TURNED
    pulled = network.divergence @ (sigma[:, None] * bond_vectors)
    return np.asarray(abs(network.divergence) @ pushed - pulled)


class PressureManifold:
    """The map (σ, p) → configuration of one planar network, and its pull-back."""

    def __init__(self, network: Network, backend: str = "auto"):
        self.network, self.jumps = network, pressure_jumps(network)
        self.pattern = _pattern(network, backend)
        self._geometry = ExtendedGeometry(network)
        # Sums with |g|ᵀ: what each edge adds to both of its ends.
        self._sums = copy(self._geometry)
        self._sums.around = [(edges, np.abs(signs)) for edges, signs in self._geometry.around]
        self._spread = abs(network.divergence)

    def solve(
        self, sigma: ArrayLike, pressures: ArrayLike, throw: bool = False
    ) -> ForceBalance[PressurisedConfiguration]:
        """The configuration under σ (N_b,) of any sign and p (N_f,), refined, with an estimate of its error.

        Coordinates are NaN where P + iQ is singular or so nearly singular that no digit is certain.
        `negative_pivots` counts the negative eigenvalues of P + iQ.
        Raises `InputError` for values that are not finite or of another shape, and where σ is zero everywhere.
        """
        network = self.network
        stress = edge_values(sigma, network.n_edges, "sigma", positive=False)
        p = edge_values(pressures, self.jumps.shape[1], "pressures", place="face", positive=False)
        if not stress.any():
            raise InputError("sigma is zero on every edge: give each edge a force density, positive for tension")
        # The balance is that of the values returned, after their scaling.
        scale = np.sqrt(network.n_edges / np.sum(stress**2))
        stress, p = scale * stress, scale * (p if network.cell is None else p - p.mean())
        factor, x = self._placed(stress, self.jumps @ p)
        x, L, error, condition, steps = self._refined(stress, p, factor, x)
        placed = network.all_coordinates(x)
        certain = factor.sound and condition * EPS < HOPELESS and bool(error < LOST * float(np.abs(L).max()))
        if not certain:
            placed, L, error = np.full_like(placed, np.nan), np.full_like(L, np.nan), np.nan
        value = PressurisedConfiguration(network, stress, p, placed, L, error)
        stats = Stats("force density", steps, residual=value.residual, condition=condition, error_bound=error)
        solution = ForceBalance(
            value=value,
            status=Status.ok if certain else Status.ill_conditioned,
            stats=stats,
            negative_pivots=factor.n_negative // 2,
        )
        return solution.or_raise("no configuration for this stress and these pressures") if throw else solution

    def balance(self, sigma: Array, pressures: Array) -> PressureBalance:
        """The configuration with the factor for its derivatives, without refinement."""
        factor, x = self._placed(sigma, self.jumps @ pressures)
        L = self.network.free_incidence @ x + self.network.boundary_vectors
        return PressureBalance(self, sigma, pressures, x, L, factor)

    def _placed(self, sigma: Array, q: Array) -> tuple[Factor, Array]:
        factor = self.pattern.factorize_signed(np.concatenate([sigma, q]))
        b = self.network.boundary_vectors
        load = self._spread @ (q[:, None] * b[:, ::-1] * _TURNED) - self.network.divergence @ (sigma[:, None] * b)
        return factor, factor.solve(load.ravel()).reshape(load.shape)

    def _refined(self, sigma: Array, p: Array, factor: Factor, x: Array) -> tuple[Array, Array, float, float, int]:
        """Coordinates (n_free, 2) and bond vectors in double precision, their error, the condition, the steps.

        Error bound (estimate): the force that is left in extended precision, times the condition of P + iQ.
        """
        b, degree = self.network.boundary_vectors, self._spread
        at, last, step = extended(x), np.inf, 0
        # q = J p: differences of at most two pressures.
        jumps = two_sum(self.jumps.maximum(0) @ p, self.jumps.minimum(0) @ p)
        weight = np.repeat(degree @ (2 * np.abs(sigma) + np.abs(jumps.high)), 2)[:, None]
        condition = magnification(factor.solve, weight)[0]
        while True:
            step += 1
            L = self._geometry.bond_vectors(at, b)
            force = self._force(sigma, jumps, L)
            left = float((np.abs(force.high.ravel()) / weight[:, 0]).max())
            error = SAFETY * condition * (left + EPS**2 * float(np.abs(L.high).max()))
            if error <= UNSEEN * EPS * float(np.abs(b).max()) or not error < 0.5 * last or step == MOST_STEPS:
                break
            last = error
            at = add(at, extended(factor.solve(force.high.ravel()).reshape(x.shape)))
        return at.high, L.high, error + float(np.abs(at.low).max()), condition, step

    def _force(self, sigma: Array, q: Extended, L: Extended) -> Extended:
        """The unbalanced forces (n_free, 2) in extended precision."""
        pulled = multiply(extended(-np.repeat(sigma[:, None], 2, axis=1)), L)
        turned = Extended(L.high[:, ::-1] * _TURNED, L.low[:, ::-1] * _TURNED)
        pushed = multiply(Extended(q.high[:, None], q.low[:, None]), turned)
        return add(self._geometry.divergence(pulled), self._sums.divergence(pushed))


def pressurised_configuration(
    manifold: CriticalManifold, sigma: ArrayLike, pressures: ArrayLike, throw: bool = True
) -> PressurisedConfiguration:
    """The configuration under σ (N_b,) and pressures (N_f,) of the network of a manifold, as `PressureManifold.solve`.

    Raises `SolveError` where no digit of it is certain, if `throw`.
    """
    return PressureManifold(manifold.network, manifold.backend).solve(sigma, pressures, throw).value


@dataclass(frozen=True, eq=False)
class PressureBalance:
    """A stress, pressures, their configuration, and the factor of P + iQ."""

    manifold: PressureManifold
    sigma: Array
    pressures: Array
    coordinates: Array  # of the free vertices, (n_free, 2)
    bond_vectors: Array  # L(σ, p), (N_b, 2)
    factor: Factor = field(repr=False)

    @property
    def network(self) -> Network:
        return self.manifold.network

    def pull_back(self, dO_dsigma: Array, dO_dL: Array) -> tuple[Array, Array]:
        """Total derivatives dO/dσ (N_b,) and dO/dp (N_f,) of a function of σ and L, by one solve.

        With y = (P + iQ)⁻¹ gᵀ ∂O/∂L:  dO/dσ = ∂O/∂σ − L·(g y),  dO/dq = −Re[½ i L (|g| y)*],  dO/dp = Jᵀ dO/dq.
        """
        network = self.manifold.network
        right = network.divergence @ dO_dL
        y = self.factor.solve(right.ravel()).reshape(right.shape)
        by_stress = dO_dsigma - np.einsum("ad,ad->a", self.bond_vectors, network.free_incidence @ y)
        pushed = self.bond_vectors[:, ::-1] * _TURNED
        by_jump = np.einsum("ad,ad->a", pushed, abs(network.free_incidence) @ y)
        return by_stress, self.manifold.jumps.T @ by_jump


def _pattern(network: Network, backend: str) -> FixedPattern:
    """[[P, −Q], [Q, P]] over the free coordinates, (2 n_free)², from (σ, q) (2 N_b,)."""
    entries = [(2 * i + a, 2 * j + a, edge, sign) for i, j, edge, sign in end_pairs(network) for a in (0, 1)]
    tail, head = free_ends(network).T
    edge = np.flatnonzero((tail >= 0) & (head >= 0))
    t, h, source = tail[edge], head[edge], network.n_edges + edge
    # The contributions of the edges around a vertex to its own block cancel, since q sums to zero there.
    for i, j, sign in ((2 * t, 2 * h + 1, -0.5), (2 * h, 2 * t + 1, 0.5)):
        entries += [(i, j, source, sign), (j, i, source, sign)]
    return FixedPattern(2 * len(network.free), 2 * network.n_edges, entries, backend)
