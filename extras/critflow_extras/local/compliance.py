"""Compliances of pairs of vertices at the transition: how far forces along one pair move another.

At vanishing stress all edges keep their lengths, and the motions that are left are resisted by P alone.  A unit force
along a pair, a = n (e_head − e_tail) with its direction n, moves the vertices by u:

    P u + Rᵀ λ = a,  R u = 0,     G_ts = a_t·u_s = a_s·u_t.

The matrix is symmetric, so that the derivatives need no further solve:
    dG_ts = da_t·u_s + da_s·u_t − Σ dσ Δu_t·Δu_s − Σ dL·(λ_s Δu_t + λ_t Δu_s),     Δu = g u on edges.

With a small stress tσ in springs of stiffness k the edges yield, R u = t K⁻¹ λ with K⁻¹ = |L|²/k, and to first order
    G_ts → G_ts + t λ'_t·K⁻¹ λ'_s,     λ' = λ + c σ with σ·K⁻¹ λ' = 0,
since λ is defined up to a multiple of the self-stress.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from critflow.linear_response import accumulated_rounding
from critflow.manifold import Balance
from critflow.networks import Array, IntArray, Network
from critflow.numerics import EPS, dot, norms, product
from critflow.quantities import Balanced
from critflow.result import InputError
from critflow.saddles import REFINED, SaddleFactor
from critflow.sparse import Factor
from critflow_extras.local.pairs import Target

# Compliance of a pair, relative to that by P alone with edges that yield, below which edges hold it: rounding is 1e-15.
HELD = 1e-11
# Relative residual of a motion beyond which no error of it is known: refinement ends below 1e-9 where it converges, and
# above 1e-7 where stresses span so many decades that it does not.
UNSOLVED = 1e-8
_REFINEMENTS = 3  # solves by a factor of a Hessian, each with the residual of the one before


@dataclass(frozen=True, eq=False)
class PairMotion:
    """The motion by a unit force along a pair.

    distance      |r|
    direction     n (d,)
    path          edges of the path of r, and their signs
    displacement  u (N_v, d), zero at fixed vertices
    multipliers   λ (N_b,), orthogonal to σ
    rates         Δu (N_b, d)
    rounded       numbers (N_b,) whose roundings enter Δu
    residual      forces and elongations that remain, (n_free, d) and (N_b,)
    unsolved      the same, relative to the terms that cancel in them
    """

    pair: Target
    distance: float
    direction: Array
    path: tuple[IntArray, Array]
    displacement: Array
    multipliers: Array
    rates: Array
    rounded: Array
    residual: tuple[Array, Array]
    unsolved: float

    def apart(self, displacement: Array) -> Array:
        """Relative motion (d,) of the ends of the pair."""
        return self.pair.apart(displacement)

    def turning(self, displacement: Array) -> Array:
        """∂(a·u)/∂r at constant u, (d,): the part of the relative motion across the pair, over |r|."""
        apart = self.apart(displacement)
        return (apart - (apart @ self.direction) * self.direction) / self.distance


@dataclass(frozen=True, eq=False)
class Compliances:
    """Motions of pairs at one σ (N_b,) and L (N_b, d), by one factor.

    yielding   K⁻¹ (N_b,) in R u = K⁻¹λ, zero at the transition
    resisting  stiffnesses (N_b,) by which roundings of displacements are resisted, where edges are not constraints
    tolerance  relative residual at which a solve ends
    """

    network: Network
    sigma: Array
    bond_vectors: Array
    factor: SaddleFactor | HessianFactor
    yielding: Array | float = 0.0
    resisting: Array | float = 0.0
    tolerance: float = REFINED
    motions: dict[Target, PairMotion] = field(default_factory=dict, repr=False)
    own: dict[Target, tuple[Array, Array]] = field(default_factory=dict, repr=False)

    def motion(self, pair: Target) -> PairMotion:
        """The motion by a unit force along a pair, computed once."""
        if pair not in self.motions:
            self.motions[pair] = self._moved(pair)
        return self.motions[pair]

    def _moved(self, pair: Target) -> PairMotion:
        network, L = self.network, self.bond_vectors
        edges, signs, constant = pair.path(network)
        r = constant + signs @ L[edges]
        length = float(np.linalg.norm(r))
        if not length > 0:
            raise InputError(f"the vertices of {pair} are at the same place, so that their pair has no direction")
        force = pair.pull(network, r / length)[network.free]
        u, multipliers, residual, unsolved = self.solved(force)
        rates, moved = product(network.free_incidence, u), np.zeros((network.n_vertices, network.dimension))
        moved[network.free] = u
        rounded = norms(moved)[network.edges].sum(axis=1)
        return PairMotion(
            pair, length, r / length, (edges, signs), moved, multipliers, rates, rounded, residual, unsolved
        )

    def solved(self, force: Array) -> tuple[Array, Array, tuple[Array, Array], float]:
        """u (n_free, d), λ (N_b,), the residual of both equations and its relative size, for forces (n_free, d)."""
        network, L, sigma = self.network, self.bond_vectors, self.sigma
        # A solve ends at a residual relative to tensions and lengths: the force is given in the size of tensions.
        size = 2.0 ** np.round(np.log2(np.mean(np.abs(sigma) * norms(L))))
        u, multipliers, unsolved = self.factor.solve(size * force, np.zeros(network.n_edges), self.tolerance)
        u, multipliers = u / size, multipliers / size
        if not np.any(self.yielding):
            multipliers = multipliers - (sigma @ multipliers) / (sigma @ sigma) * sigma
        rates = product(network.free_incidence, u)
        left = force - product(network.divergence, sigma[:, None] * rates + multipliers[:, None] * L)
        return u, multipliers, (left, self.yielding * multipliers - dot(L, rates)), unsolved

    def compliance(self, target: Target, source: Target) -> float:
        """G_ts."""
        one, other = self.motion(target), self.motion(source)
        return float(one.direction @ one.apart(other.displacement))

    def held(self, pair: Target) -> bool:
        """Whether the edges hold the distance of a pair: its compliance is rounding."""
        motion, free = self.motion(pair), self.network.free
        # λ of the part of the force that edges carry is |λ||L| in size, and moves vertices as P does.
        carried = float(np.abs(motion.multipliers * norms(self.bond_vectors)).max(initial=0.0))
        unit = max(1.0, carried) / float(np.mean(np.abs(self.sigma)))
        return motion.unsolved < UNSOLVED and not (len(free) and self.compliance(pair, pair) > HELD * unit)

    def error(self, target: Target, source: Target) -> float:
        """Error (estimate) of G_ts for exact σ and L: residuals times the other motion, and accumulated roundings.

        Infinite where the solve of a motion has not converged: the other motion is then not known either.
        """
        one, other = self.motion(target), self.motion(source)
        if not max(one.unsolved, other.unsolved) < UNSOLVED:
            return np.inf
        free, length = self.network.free, norms(self.bond_vectors)
        left = 0.0
        for this, that in ((one, other), (other, one)):
            force, slip = that.residual
            left += abs(float(np.sum(this.displacement[free] * force))) + abs(float(this.multipliers @ slip))
        noise = np.abs(self.sigma) * (norms(one.rates) * other.rounded + one.rounded * norms(other.rates))
        noise = noise + np.abs(one.multipliers) * length * other.rounded
        noise = noise + np.abs(other.multipliers) * length * one.rounded
        noise = noise + self.resisting * one.rounded * other.rounded
        return left + float(accumulated_rounding(2 * EPS * noise)) + 2 * EPS * abs(self.compliance(target, source))

    def derivatives(self, target: Target, source: Target) -> tuple[Array, Array]:
        """∂G_ts/∂σ (N_b,) and ∂G_ts/∂L (N_b, d) at constant directions of the pairs."""
        one, other = self.motion(target), self.motion(source)
        by_L = -other.multipliers[:, None] * one.rates - one.multipliers[:, None] * other.rates
        return -dot(one.rates, other.rates), by_L

    def own_derivatives(self, pair: Target) -> tuple[Array, Array]:
        """`derivatives` of G_ss, computed once."""
        if pair not in self.own:
            self.own[pair] = self.derivatives(pair, pair)
        return self.own[pair]

    def by_stiffness(self, target: Target, source: Target) -> Array:
        """∂G_ts/∂k (N_b,): zero, since no edge yields."""
        return np.zeros(self.network.n_edges)

    def growth(self, target: Target, source: Target) -> float:
        """dG_ts/dt for a stress tσ, t → 0."""
        yielding = dot(self.bond_vectors, self.bond_vectors) / self.network.stiffness
        one, other = (self._relaxed(self.motion(pair).multipliers, yielding) for pair in (target, source))
        return float(one @ (yielding * other))

    def _relaxed(self, multipliers: Array, yielding: Array) -> Array:
        """λ' (N_b,), the multipliers of least energy."""
        weighted = yielding * self.sigma
        return multipliers - (weighted @ multipliers) / (weighted @ self.sigma) * self.sigma


@dataclass(frozen=True, eq=False)
class HessianFactor:
    """A factor of the Hessian of a state of any kind, which may have energies besides those of edges."""

    factor: Factor

    def solve(self, forces: Array, elongations: Array, tolerance: float = REFINED) -> tuple[Array, Array, float]:
        """u (n_free, d) of forces (n_free, d), no multipliers (N_b,), and the largest force that remains."""
        right, u = forces.ravel(), np.zeros(forces.size)
        for _ in range(_REFINEMENTS):
            u = u + self.factor.solve(right - self.factor.multiply(u))
        left = right - self.factor.multiply(u)
        return u.reshape(forces.shape), np.zeros_like(elongations), float(np.abs(left).max(initial=0.0))


class HessianCompliances(Compliances):
    """Motions of pairs of a state by its Hessian, which has all of its energies."""

    def solved(self, force: Array) -> tuple[Array, Array, tuple[Array, Array], float]:
        assert isinstance(self.factor, HessianFactor)
        u, none, left = self.factor.solve(force, np.zeros(self.network.n_edges))
        return u, none, (force - self.factor.factor.multiply(u.ravel()).reshape(force.shape), none), left


def compliances(balance: Balanced) -> Compliances:
    """The compliances of a critical balance; those of one `Balance` are shared by all quantities."""
    shared = balance.shared if isinstance(balance, Balance) else {}
    if "compliances of pairs" not in shared:
        sigma, L = balance.sigma, balance.bond_vectors
        if not (sigma > 0).all():
            edge = int(np.argmin(sigma))
            raise InputError(
                f"local responses need positive stresses, and edge {edge} has {sigma[edge]:.3g}: take cables"
            )
        factor = balance.manifold.system(sigma).factorize(sigma, L)
        shared["compliances of pairs"] = Compliances(balance.manifold.network, sigma, L, factor)
    found: Compliances = shared["compliances of pairs"]
    return found
