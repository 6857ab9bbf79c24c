"""Springs past the transition: energy, equilibrium at a strain, by Newton with sparse factors or by FIRE.

Any energy E of the lengths has σ = ∂E/∂h, K = ∂²E/∂h² with h = |L|²/2, and the Hessian R^hᵀ K R^h + P(σ) ⊗ 1
(`GenericHessian`).  Springs of one law each have a diagonal K: σ_α = E'/|L| and K_α = (E'' − σ_α)/|L_α|²
(`ForceDensity`, `ModifiedStiffness`); Hookean ones E = ½ Σ k(|L| − ℓ)² (`HookeanEnergy`).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar, Generic, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from critflow.distance import Distance, distance, inverse_norm
from critflow.extended import Extended, extended, lengths, subtract, two_sum
from critflow.laws import HOOKEAN, SpringLaw, checked_law
from critflow.linalg import Factor, FixedPattern, block_laplacian, edge_blocks
from critflow.minimize import Point, fire
from critflow.network import Array, Network, edge_values
from critflow.result import InputError, Solution, Stats, Status


class ElasticState(ABC):
    """A configuration with an energy that depends on lengths alone: coordinates x (N_v, d), bond vectors L (N_b, d).

    L is kept beside x because it is known to a relative rounding, while differences of coordinates carry the rounding
    of the box size; near the transition the forces live on that difference.
    """

    network: Network
    coordinates: Array
    bond_vectors: Array
    # Whether an edge may pull its ends together until they meet, because nothing holds its own length.
    edges_may_collapse: ClassVar[bool] = False

    @property
    @abstractmethod
    def energy(self) -> float:
        """E; infinite where an edge is longer than it can be."""

    @property
    @abstractmethod
    def sigma(self) -> Array:
        """Geometric stress σ = ∂E/∂h, (N_b,), not normalised."""

    @property
    @abstractmethod
    def edge_stiffness(self) -> Array:
        """Stiffnesses (N_b,) that bound the resistance of the edges to a change of |L|."""

    @property
    @abstractmethod
    def stiffness_scale(self) -> float:
        """Mean stiffness, times the largest factor that an edge has stiffened by: times a length, a unit of force."""

    @property
    @abstractmethod
    def length_scale(self) -> float:
        """Mean length at rest."""

    @property
    @abstractmethod
    def stress_rounding(self) -> Array:
        """What σ, (N_b,), misses because lengths and bond vectors are rounded, a difference of lengths that it is."""

    @abstractmethod
    def exact_stress(self, bond_vectors: Extended) -> Array:
        """σ (N_b,) of other bond vectors (N_b, d), to all its digits."""

    @abstractmethod
    def resistance(self, hdot: Array) -> tuple[Array, float]:
        """K ḣ, (N_b,), and ḣᵀ K ḣ for a change ḣ of h, (N_b,)."""

    @abstractmethod
    def pattern(self) -> FixedPattern:
        """The pattern of the Hessian, of this state and all others of the same graph."""

    @abstractmethod
    def factorize(self, pattern: FixedPattern, shift: float = 0.0) -> Factor:
        """Factorise H + shift·1."""

    @abstractmethod
    def factorize_convex(self, pattern: FixedPattern, shift: float) -> Factor:
        """Factorise H + shift·1 without what makes H indefinite."""

    @cached_property
    def lengths(self) -> Array:
        """|L|, (N_b,)."""
        return np.linalg.norm(self.bond_vectors, axis=1)

    @cached_property
    def forces(self) -> Array:
        """Unbalanced forces −∂E/∂x on the free vertices, (n_free, d) (`Equilibrium`, `ForceBalance`)."""
        return -np.asarray(self.network.divergence @ (self.sigma[:, None] * self.bond_vectors))

    @property
    def max_force(self) -> float:
        """Largest component of the unbalanced forces, in units of k times length."""
        return float(np.abs(self.forces).max(initial=0.0))

    @property
    def largest_stiffness(self) -> float:
        """A bound on the largest eigenvalue of the Hessian where edges are not much compressed."""
        at_vertex = np.bincount(self.network.edges.ravel(), np.repeat(self.edge_stiffness, 2))
        return 2 * float(at_vertex.max())

    def distance(self, factor: Factor, held: bool = False) -> Distance:
        """What leads from here to the exact equilibrium, by a factor of the Hessian at or near this state.

        held  whether the factor holds floppy modes
        """
        return distance(self.network, self.coordinates, self.exact_stress, factor, held)

    def moved(self: State, displacement: Array) -> State:
        """The state after displacing the free vertices by u (n_free, d)."""
        x = self.coordinates.copy()
        x[self.network.free] += displacement
        L = self.bond_vectors + self.network.free_incidence @ displacement
        return replace(self, coordinates=x, bond_vectors=L)  # type: ignore[type-var]

    def deformed(self: State, gradient: Array) -> State:
        """The state after the affine deformation F of boundary and vertices, with the same springs."""
        return replace(  # type: ignore[type-var]
            self,
            network=self.network.deformed(gradient),
            coordinates=self.coordinates @ gradient.T,
            bond_vectors=self.bond_vectors @ gradient.T,
        )


State = TypeVar("State", bound=ElasticState)


@dataclass(frozen=True, eq=False)
class SpringState(ElasticState):
    """Springs in a configuration: rest lengths ℓ (N_b,), coordinates x (N_v, d), bond vectors L (N_b, d), their law."""

    network: Network
    rest_lengths: Array
    coordinates: Array
    bond_vectors: Array
    law: SpringLaw = HOOKEAN

    @cached_property
    def extension(self) -> Array:
        """|L| − ℓ, (N_b,)."""
        return self.lengths - self.rest_lengths

    @property
    def energy(self) -> float:
        """E, the sum over the springs (`EnergyConstraints`), in units of k times length squared."""
        return float(np.sum(self.law.energy(self.extension, self.rest_lengths, self.network.stiffness)))

    @cached_property
    def sigma(self) -> Array:
        """Geometric stress σ = ∂E/∂h = E'/|L|, (N_b,), not normalised."""
        return self.law.tension(self.extension, self.rest_lengths, self.network.stiffness) / self.lengths

    @property
    def edge_stiffness(self) -> Array:
        """E'', (N_b,)."""
        return self.law.stiffness(self.extension, self.rest_lengths, self.network.stiffness)

    @cached_property
    def modified_stiffness(self) -> Array:
        """K = ∂²E/∂h² = (E'' − σ)/|L|², (N_b,)."""
        return (self.edge_stiffness - self.sigma) / self.lengths**2

    @property
    def stiffness_scale(self) -> float:
        k, now = self.network.stiffness, self.edge_stiffness
        # An edge that its law has stiffened brings more rounding.
        return float(k.mean()) * (1.0 if now is k else max(1.0, float(np.max(now / k))))

    @property
    def length_scale(self) -> float:
        return float(self.rest_lengths.mean())

    @property
    def stress_rounding(self) -> Array:
        return _EPS * self.edge_stiffness

    def exact_stress(self, bond_vectors: Extended) -> Array:
        length = lengths(bond_vectors)
        extension = subtract(length, extended(self.rest_lengths)).high
        return self.law.tension(extension, self.rest_lengths, self.network.stiffness) / length.high

    def resistance(self, hdot: Array) -> tuple[Array, float]:
        K = self.modified_stiffness
        return K * hdot, float(K @ hdot**2)

    def pattern(self) -> FixedPattern:
        return block_laplacian(self.network)

    def factorize(self, pattern: FixedPattern, shift: float = 0.0) -> Factor:
        return pattern.factorize(edge_blocks(self.modified_stiffness, self.bond_vectors, self.sigma), shift)

    def factorize_convex(self, pattern: FixedPattern, shift: float) -> Factor:
        # Without what compressed edges take away, E'' n nᵀ + max(σ, 0)(1 − n nᵀ).
        tension = np.maximum(self.sigma, 0.0)
        along = (np.maximum(self.edge_stiffness, 0.0) - tension) / self.lengths**2
        return pattern.factorize(edge_blocks(along, self.bond_vectors, tension), shift)


_EPS = float(np.finfo(float).eps)

# Compression, in units of k, that is rounding.
NO_COMPRESSION = 1e-10

# An edge below this part of the mean length, where there is no equilibrium, is on its way to none.
_COLLAPSING = 1e-3

# Stiffness, in units of k, that keeps floppy modes in place: they feel no force, so it changes nothing else.
FLOPPY_REST = 1e-11


def spring_state(
    network: Network, rest_lengths: ArrayLike, coordinates: ArrayLike, law: SpringLaw = HOOKEAN
) -> SpringState:
    """Springs of positive rest lengths ℓ (N_b,) at coordinates (N_v, d).  Raises `NetworkError` or `InputError`."""
    rest = edge_values(rest_lengths, network.n_edges, "rest_lengths")
    x, L = embedded(network, coordinates)
    return SpringState(network, rest, x, L, checked_law(law, rest, network.stiffness))


def embedded(network: Network, coordinates: ArrayLike) -> tuple[Array, Array]:
    """Coordinates (N_v, d) that give every edge a length, else an `InputError`, and their bond vectors."""
    x = np.array(coordinates, dtype=float)
    if x.shape != (network.n_vertices, network.dimension) or not np.isfinite(x).all():
        raise InputError(
            f"coordinates must be finite and of shape {(network.n_vertices, network.dimension)}, not {x.shape}"
        )
    L = network.bond_vectors(x)
    length = np.linalg.norm(L, axis=1)
    if not length.min() > 0:
        edge = int(length.argmin())
        raise InputError(f"edge {edge} has no length, so its spring has no direction: move its ends apart")
    return x, L


def equilibrium(
    state: State,
    method: str = "newton",
    tolerance: float = 1e-14,
    max_steps: int | None = None,
    pattern: FixedPattern | None = None,
    throw: bool = True,
) -> Solution[State]:
    """Relax springs until no force component exceeds `tolerance`, in units of mean k times mean ℓ.

    Where a law has stiffened edges the unit grows by the largest E''/k, as the rounding of forces does.  Where
    rounding stops Newton's method within ten tolerances that is enough.

    method  "newton": sparse factorisation, shifted where the Hessian is indefinite or singular; "fire": the paper's

    The exact equilibrium is that of the boundary vectors b, rest lengths and stiffnesses as the floats they are, with
    fixed vertices and the grounded one where they stand.  `stats.error_bound` bounds the distance to it of every
    coordinate and every component of a bond vector; Newton's method ends by stepping onto it, to the rounding of the
    coordinates, while FIRE's answer stays as it is.  Where rounding hides the exact one it is infinite, with
    `Status.ill_conditioned`.  `stats.condition` is ‖H‖‖H⁻¹‖.
    """
    factor: Factor | None = None
    pattern = pattern or state.pattern()
    if not np.isfinite(state.energy):
        stats = Stats(method, details={"note": "an edge is longer than its law lets it be: take smaller strain steps"})
        solution = Solution(state, Status.stalled, stats)
    elif method == "newton":
        solution, factor = _newton(state, tolerance, max_steps or 200, pattern)
    elif method == "fire":
        solution = _fire(state, tolerance * state.stiffness_scale * state.length_scale, max_steps or 200_000)
    else:
        raise InputError(f"no relaxation method is called {method!r}: choose 'newton' or 'fire'")
    if solution.ok:
        solution = _bounded(solution, pattern, factor, corrected=method == "newton")
    length = solution.value.lengths
    if not solution.ok and state.edges_may_collapse and length.min() < _COLLAPSING * length.mean():
        note = f"edge {int(length.argmin())} shrinks to zero length, where its pull has no direction"
        stats = replace(solution.stats, details={**solution.stats.details, "note": note})
        solution = Solution(solution.value, Status.edge_collapse, stats)
    return solution.or_raise("the springs found no equilibrium") if throw else solution


def _bounded(
    solution: Solution[State], pattern: FixedPattern, factor: Factor | None, corrected: bool
) -> Solution[State]:
    """An equilibrium with its distance to the exact one, and moved onto it if it is to be corrected.

    factor  of the Hessian near the state, if there is one
    """
    state = solution.value
    way, factor = _way(state, pattern, factor)
    error = way.displacement
    if corrected and np.isfinite(way.missing):
        x, free = state.coordinates.copy(), state.network.free
        x[free], error = two_sum(state.coordinates[free], way.displacement)
        state = replace(state, coordinates=x, bond_vectors=way.bond_vectors)  # type: ignore[type-var]
        apart = 0.5 * _EPS * float(np.abs(way.bond_vectors).max())
    else:
        apart = float(np.abs(state.bond_vectors - way.bond_vectors).max())
    bound = max(float(np.abs(error).max()), apart) + 2 * way.missing
    condition = state.largest_stiffness * inverse_norm(factor, state.forces.size)
    stats = replace(solution.stats, residual=state.max_force, error_bound=bound, condition=condition)
    status = solution.status
    if not np.isfinite(bound):
        status = Status.ill_conditioned
        stats.details["note"] = "rounding hides how far the exact equilibrium is: go further from the transition"
    return Solution(state, status, stats)


def _way(state: ElasticState, pattern: FixedPattern, factor: Factor | None = None) -> tuple[Distance, Factor]:
    """The distance to the exact equilibrium, and the factor that it took.

    factor  of the Hessian near the state, if there is one; where corrections by it do not settle others are tried
    """
    if factor is not None:
        way = state.distance(factor)
        if np.isfinite(way.missing):
            return way, factor
    factor = state.factorize(pattern)
    if factor.sound and not factor.n_negative:
        # Pivots that are small beside the others may still be good: corrections tell.
        way = state.distance(factor)
        if np.isfinite(way.missing):
            return way, factor
    # Perhaps some part is floppy.
    factor = state.factorize(pattern, FLOPPY_REST * state.stiffness_scale)
    return state.distance(factor, held=True), factor


def _newton(
    state: State, tolerance: float, max_steps: int, pattern: FixedPattern
) -> tuple[Solution[State], Factor | None]:
    """Newton's method; where the Hessian is indefinite, on its convex part; a shift grows until a step helps.

    Also the last factor, if it is of the Hessian itself.
    """
    stiffness, mean_length = state.stiffness_scale, state.length_scale
    shift, rest, step, factorisations = 0.0, 0.0, 0, 0
    # After the exact Hessian was found indefinite it is not tried again before the force has fallen, or for ten steps.
    try_below, try_from = np.inf, 0
    energy, force = state.energy, state.max_force
    status, factor, reuse, exact = Status.ok, None, False, False
    while force > tolerance * (stiffness * mean_length):
        smallest_shift = 1e-9 * stiffness
        if step == max_steps or shift > 1e6 * stiffness:
            status = Status.step_limit if step == max_steps else Status.stalled
            break
        convex = not reuse and force >= try_below and step < try_from
        if not (convex or reuse):
            factor = state.factorize(pattern, max(shift, rest))
            factorisations += 1
            if factor.indefinite and rest == 0.0:
                # Perhaps some part is only floppy, as a slack one is.
                rest = FLOPPY_REST * stiffness
                factor = state.factorize(pattern, max(shift, rest))
                factorisations += 1
            if factor.indefinite:
                convex, try_below, try_from, rest = True, 0.1 * force, step + 10, 0.0
        if convex:
            shift = max(shift, smallest_shift)
            factor = state.factorize_convex(pattern, shift)
            factorisations += 1
        if not reuse:
            exact = not convex and shift == 0.0
        assert factor is not None
        displacement = factor.solve(state.forces.ravel()).reshape(state.forces.shape)
        # A step never carries an edge through zero length: it is cut to half the mean length.
        longest = 0.5 * float(state.lengths.mean()) / max(float(np.abs(displacement).max()), 1e-300)
        for length in (1.0,) if reuse else (1.0, 0.3, 0.1):
            trial = state.moved(min(length, longest) * displacement)
            trial_energy = trial.energy
            # Beyond what a law lets an edge reach there are no forces.
            trial_force = trial.max_force if np.isfinite(trial_energy) else np.inf
            better = trial_energy < energy * (1 - 1e-12) or trial_force < 0.9 * force
            accepted = trial_force < 0.3 * force if reuse else better
            if accepted:
                break
        if accepted:
            # After a step that gained this much the factor is good for more, and a solve is far cheaper than a factor.
            reuse = trial_force < 1e-2 * force
            state, energy, force, step = trial, trial_energy, trial_force, step + 1
            shift = 0.1 * shift if shift > smallest_shift else 0.0
            stiffness = state.stiffness_scale
        elif reuse:
            reuse = False
        elif force < 1e-13 * stiffness * mean_length:
            status = Status.ok if force <= 10 * (tolerance * (stiffness * mean_length)) else Status.stalled
            break
        else:
            shift = max(10 * shift, smallest_shift)
    if status is Status.ok and (try_from > 0 or (state.sigma < -NO_COMPRESSION * stiffness).any()):
        # It was indefinite on the way or holds compressed springs, so make sure that this is no saddle; floppy
        # directions are allowed.
        factorisations += 1
        factor = None
        if state.factorize(pattern, 1e-8 * stiffness).n_negative:
            status = Status.unstable
    stats = Stats("newton", step, factorisations, force, {"energy": energy, "indefinite": try_from > 0})
    return Solution(state, status, stats), factor if exact else None


def _fire(state: State, tolerance: float, max_steps: int) -> Solution[State]:
    # No frequency exceeds √(2 Σk) at the stiffest vertex, and the scheme is stable below 2/ω; the time step may grow
    # tenfold, to three quarters of that.
    at_vertex = np.bincount(state.network.edges.ravel(), np.repeat(state.edge_stiffness, 2))
    time_step = 0.075 * 2 / np.sqrt(2 * at_vertex.max())
    max_move = 0.3 * float(state.lengths.mean())
    end = fire(_Relaxation(state), np.zeros(state.forces.size), tolerance, max_steps, time_step, max_move)
    final = state.moved(end.point.x.reshape(state.forces.shape))
    return Solution(
        final, end.status, Stats("fire", end.iterations, end.evaluations, end.point.residual, {"energy": final.energy})
    )


class _Relaxation(Generic[State]):
    """The energy as a function of the displacements from a state."""

    def __init__(self, state: State):
        self._state = state

    def at(self, x: Array) -> Point:
        state = self._state.moved(x.reshape(self._state.forces.shape))
        energy = state.energy
        if not np.isfinite(energy):
            return Point(x, np.inf, np.zeros_like(x), np.inf)
        gradient = -state.forces.ravel()
        return Point(x, energy, gradient, float(np.abs(gradient).max()))

    def stiff_diagonal(self, point: Point) -> Array | float:
        return 0.0

    def verdict(self, point: Point) -> Status | None:
        return None

    def curvature(self, point: Point, direction: Array) -> Array:
        raise NotImplementedError("FIRE needs no curvature")
