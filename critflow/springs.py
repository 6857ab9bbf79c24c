"""Springs past the transition: energy, equilibrium at a strain, by Newton with sparse factors or by FIRE.

E = ½ Σ k(|L| − ℓ)², σ_α = k(|L| − ℓ)/|L| and Hessian R^hᵀ K R^h + P(σ) ⊗ 1 with K_α = (k_α − σ_α)/|L_α|²
(`HookeanEnergy`, `GenericHessian`, `ModifiedStiffness`).  Any other central-force energy would change σ and K only.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from critflow.linalg import Factor, FixedPattern, block_laplacian, edge_blocks
from critflow.minimize import Point, fire
from critflow.network import Array, Network, edge_values
from critflow.result import InputError, Solution, Stats, Status


@dataclass(frozen=True, eq=False)
class SpringState:
    """Springs in a configuration: rest lengths ℓ (N_b,), coordinates x (N_v, d) and bond vectors L (N_b, d).

    L is kept beside x because it is known to a relative rounding, while differences of coordinates carry the rounding
    of the box size; near the transition the forces live on that difference.
    """

    network: Network
    rest_lengths: Array
    coordinates: Array
    bond_vectors: Array

    @cached_property
    def lengths(self) -> Array:
        """|L|, (N_b,)."""
        return np.linalg.norm(self.bond_vectors, axis=1)

    @cached_property
    def extension(self) -> Array:
        """|L| − ℓ, (N_b,)."""
        return self.lengths - self.rest_lengths

    @cached_property
    def sigma(self) -> Array:
        """Geometric stress σ = ∂E/∂h = k(|L| − ℓ)/|L|, (N_b,), not normalised."""
        return self.network.stiffness * self.extension / self.lengths

    @property
    def modified_stiffness(self) -> Array:
        """K = ∂²E/∂h² = (k − σ)/|L|², (N_b,)."""
        return (self.network.stiffness - self.sigma) / self.lengths**2

    @property
    def energy(self) -> float:
        return float(0.5 * np.sum(self.network.stiffness * self.extension**2))

    @cached_property
    def forces(self) -> Array:
        """Unbalanced forces −∂E/∂x on the free vertices, (n_free, d)."""
        return -np.asarray(self.network.divergence @ (self.sigma[:, None] * self.bond_vectors))

    @property
    def max_force(self) -> float:
        """Largest component of the unbalanced forces, in units of k times length."""
        return float(np.abs(self.forces).max(initial=0.0))

    def moved(self, displacement: Array) -> SpringState:
        """The state after displacing the free vertices by u (n_free, d)."""
        x = self.coordinates.copy()
        x[self.network.free] += displacement
        L = self.bond_vectors + self.network.free_incidence @ displacement
        return SpringState(self.network, self.rest_lengths, x, L)

    def deformed(self, gradient: Array) -> SpringState:
        """The state after the affine deformation F of boundary and vertices, with the same springs."""
        return SpringState(
            self.network.deformed(gradient),
            self.rest_lengths,
            self.coordinates @ gradient.T,
            self.bond_vectors @ gradient.T,
        )


# Compression, in units of k, that is rounding.
NO_COMPRESSION = 1e-10

# Stiffness, in units of k, that keeps floppy modes in place: they feel no force, so it changes nothing else.
FLOPPY_REST = 1e-11


def spring_state(network: Network, rest_lengths: ArrayLike, coordinates: ArrayLike) -> SpringState:
    """Springs of positive rest lengths ℓ (N_b,) at coordinates (N_v, d).  Raises `NetworkError` or `InputError`."""
    rest = edge_values(rest_lengths, network.n_edges, "rest_lengths")
    x = np.array(coordinates, dtype=float)
    if x.shape != (network.n_vertices, network.dimension) or not np.isfinite(x).all():
        raise InputError(
            f"coordinates must be finite and of shape {(network.n_vertices, network.dimension)}, not {x.shape}"
        )
    state = SpringState(network, rest, x, network.bond_vectors(x))
    if not state.lengths.min() > 0:
        edge = int(state.lengths.argmin())
        raise InputError(f"edge {edge} has no length, so its spring has no direction: move its ends apart")
    return state


def factorize_hessian(pattern: FixedPattern, state: SpringState, shift: float = 0.0) -> Factor:
    """Factorise H + shift·1 of a state."""
    return pattern.factorize(edge_blocks(state.modified_stiffness, state.bond_vectors, state.sigma), shift)


def equilibrium(
    state: SpringState,
    method: str = "newton",
    tolerance: float = 1e-14,
    max_steps: int | None = None,
    pattern: FixedPattern | None = None,
    throw: bool = True,
) -> Solution[SpringState]:
    """Relax springs until no force component exceeds `tolerance` (units of mean k times mean ℓ).

    Where rounding stops Newton's method within ten tolerances that is enough.

    method  "newton": sparse factorisation, shifted where the Hessian is indefinite or singular; "fire": the paper's
    """
    scale = float(np.mean(state.network.stiffness) * np.mean(state.rest_lengths))
    if method == "newton":
        solution = _newton(state, tolerance * scale, max_steps or 200, pattern or block_laplacian(state.network))
    elif method == "fire":
        solution = _fire(state, tolerance * scale, max_steps or 200_000)
    else:
        raise InputError(f"no relaxation method is called {method!r}: choose 'newton' or 'fire'")
    return solution.or_raise("the springs found no equilibrium") if throw else solution


def _newton(state: SpringState, tolerance: float, max_steps: int, pattern: FixedPattern) -> Solution[SpringState]:
    """Newton's method; where the Hessian is indefinite, on its convex part; a shift grows until a step helps."""
    stiffness = float(np.mean(state.network.stiffness))
    smallest_shift = 1e-9 * stiffness
    rounding = 1e-13 * stiffness * float(np.mean(state.rest_lengths))
    shift, rest, step, factorisations = 0.0, 0.0, 0, 0
    # After the exact Hessian was found indefinite it is not tried again before the force has fallen, or for ten steps.
    try_below, try_from = np.inf, 0
    energy, force = state.energy, state.max_force
    status, factor, reuse = Status.ok, None, False
    while force > tolerance:
        if step == max_steps or shift > 1e6 * stiffness:
            status = Status.step_limit if step == max_steps else Status.stalled
            break
        convex = not reuse and force >= try_below and step < try_from
        if not (convex or reuse):
            factor = factorize_hessian(pattern, state, max(shift, rest))
            factorisations += 1
            if factor.indefinite and rest == 0.0:
                # Perhaps some part is only floppy, as a slack one is.
                rest = FLOPPY_REST * stiffness
                factor = factorize_hessian(pattern, state, max(shift, rest))
                factorisations += 1
            if factor.indefinite:
                convex, try_below, try_from, rest = True, 0.1 * force, step + 10, 0.0
        if convex:
            shift = max(shift, smallest_shift)
            factor = pattern.factorize(_convex_blocks(state), shift)
            factorisations += 1
        assert factor is not None
        displacement = factor.solve(state.forces.ravel()).reshape(state.forces.shape)
        # A step never carries an edge through zero length: it is cut to half the mean length.
        longest = 0.5 * float(state.lengths.mean()) / max(float(np.abs(displacement).max()), 1e-300)
        for length in (1.0,) if reuse else (1.0, 0.3, 0.1):
            trial = state.moved(min(length, longest) * displacement)
            trial_energy, trial_force = trial.energy, trial.max_force
            better = trial_energy < energy * (1 - 1e-12) or trial_force < 0.9 * force
            accepted = trial_force < 0.3 * force if reuse else better
            if accepted:
                break
        if accepted:
            # After a step that gained this much the factor is good for more, and a solve is far cheaper than a factor.
            reuse = trial_force < 1e-2 * force
            state, energy, force, step = trial, trial_energy, trial_force, step + 1
            shift = 0.1 * shift if shift > smallest_shift else 0.0
        elif reuse:
            reuse = False
        elif force < rounding:
            status = Status.ok if force <= 10 * tolerance else Status.stalled
            break
        else:
            shift = max(10 * shift, smallest_shift)
    if status is Status.ok and (try_from > 0 or (state.sigma < -NO_COMPRESSION * stiffness).any()):
        # It was indefinite on the way or holds compressed springs, so make sure that this is no saddle; floppy
        # directions are allowed.
        factorisations += 1
        if factorize_hessian(pattern, state, 1e-8 * stiffness).n_negative:
            status = Status.unstable
    return Solution(state, status, Stats("newton", step, factorisations, force, {"energy": energy}))


def _convex_blocks(state: SpringState) -> Array:
    """The Hessian without what compressed edges take away, k n nᵀ + max(σ, 0)(1 − n nᵀ): never indefinite."""
    tension = np.maximum(state.sigma, 0.0)
    return edge_blocks((state.network.stiffness - tension) / state.lengths**2, state.bond_vectors, tension)


def _fire(state: SpringState, tolerance: float, max_steps: int) -> Solution[SpringState]:
    # No frequency exceeds √(2 Σk) at the stiffest vertex, and the scheme is stable below 2/ω; the time step may grow
    # tenfold, to three quarters of that.
    at_vertex = np.bincount(state.network.edges.ravel(), np.repeat(state.network.stiffness, 2))
    time_step = 0.075 * 2 / np.sqrt(2 * at_vertex.max())
    max_move = 0.3 * float(state.lengths.mean())
    end = fire(_Relaxation(state), np.zeros(state.forces.size), tolerance, max_steps, time_step, max_move)
    final = state.moved(end.point.x.reshape(state.forces.shape))
    return Solution(
        final, end.status, Stats("fire", end.iterations, end.evaluations, end.point.residual, {"energy": final.energy})
    )


class _Relaxation:
    """The energy as a function of the displacements from a state."""

    def __init__(self, state: SpringState):
        self._state = state

    def at(self, x: Array) -> Point:
        state = self._state.moved(x.reshape(self._state.forces.shape))
        gradient = -state.forces.ravel()
        return Point(x, state.energy, gradient, float(np.abs(gradient).max()))

    def stiff_diagonal(self, point: Point) -> Array | float:
        return 0.0

    def verdict(self, point: Point) -> Status | None:
        return None

    def curvature(self, point: Point, direction: Array) -> Array:
        raise NotImplementedError("FIRE needs no curvature")
