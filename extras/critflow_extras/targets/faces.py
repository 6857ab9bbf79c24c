"""Amplitudes of isogonal modes as the variables of a design: one force network, other lengths and areas.

Isogonal modes keep the direction and the tension of every edge, and so S = Σσ L⊗L, D = Σσ²|L|²/k and every modulus at
the transition.  With amplitudes a the lengths are ℓ = ℓ_0 + Eᵀa, and the configuration needs no solve:
    L_α = ℓ_α n_α,  σ_α = τ_α/ℓ_α,   dO/dℓ_α = n_α·∂O/∂L_α − (σ_α/ℓ_α) ∂O/∂σ_α,   dO/da = E dO/dℓ.
The change is ½Σ log²(ℓ/ℓ_0), which is also the change of log σ.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.linalg import splu

from critflow.isogonal import face_modes, has_face_modes, isogonal_modes
from critflow.manifold import CriticalConfiguration, CriticalManifold
from critflow.networks import Array
from critflow.numerics import dot
from critflow.quantities import Quantity, StressedBonds, quantity
from critflow.result import InputError
from critflow_extras.targets.constrained import Minimum, Problem, minimise_constrained
from critflow_extras.targets.problem import (
    DesignOptions,
    DesignResult,
    EdgeLimits,
    Target,
    Variables,
    require_all_valid,
)
from critflow_extras.targets.refusals import BOUND_ROUNDING, NOT_STIFFEST

SHORTEST_ISOGONAL = 5e-2  # shortest length of an isogonal design by default, in units of the mean

# Unit of the lengths as limits, over the mean: those within a fifth of it take part in a step.
_LENGTHS = 10.0


@dataclass(frozen=True, eq=False)
class IsogonalState(StressedBonds):
    """The stress and the bond vectors of lengths ℓ (N_b,), at directions and tensions that are kept."""

    lengths: Array


class FaceAmplitudes(Variables):
    """Amplitudes of the isogonal modes of a configuration, in units of its mean length."""

    limited_quantities = ("lengths",)
    longest = 0.3
    tolerance = 1e-2  # component of the gradient of the change along the targets, relative to 1 plus the largest one

    def __init__(self, critical: CriticalConfiguration, limits: Sequence[EdgeLimits] = ()):
        if not (critical.sigma != 0).all():
            raise InputError("some edges have no stress: use the configuration of the taut part")
        self.critical, self.network, self.manifold = critical, critical.network, CriticalManifold(critical.network)
        self.unit = float(critical.lengths.mean())
        # Sparse modes of faces where the network has them, else modes by singular values.
        self.modes = face_modes(critical) if has_face_modes(self.network) else isogonal_modes(critical)
        if self.modes.n_independent == 0:
            raise InputError("no isogonal mode exists here: every change of lengths turns some edge")
        # Equal amplitudes of all faces change nothing, so that one face is left out.
        self.n_modes = self.modes.n_independent
        self.origin = np.zeros(self.n_modes)
        self.lengths_of = self.unit * sp.csr_array(sp.csr_array(self.modes.elongations)[: self.n_modes].T)
        self.directions = critical.bond_vectors / critical.lengths[:, None]
        self.reach = _LENGTHS * self.unit
        shortest, longest = _limits(critical, limits)
        # Collapsed edges would trap a search: lengths below the limit are outside the domain.
        self.least = (1 - 1e-6) * shortest
        self.low, self.high = shortest / self.reach, longest / self.reach

    @classmethod
    def of(cls, start: Any, options: DesignOptions) -> Self:
        limits = options.limits(cls)
        options.require_unused("signs", "free", "initial")
        if not isinstance(start, CriticalConfiguration):
            raise InputError("change='faces' starts from a critical configuration: give one")
        return cls(start, limits)

    def at(self, z: Array) -> IsogonalState:
        """Lengths ℓ (N_b,) at the directions and tensions of the configuration, as a balance."""
        lengths = self.critical.lengths + self.lengths_of @ z
        L, sigma = lengths[:, None] * self.directions, self.critical.tensions / lengths
        return IsogonalState(self.manifold, sigma, L, lengths)

    def values(self, state: IsogonalState, quantities: Sequence[Quantity]) -> tuple[Array, Array]:
        values, rows = np.empty(len(quantities)), np.empty((len(quantities), self.network.n_edges))
        for n, one in enumerate(quantities):
            values[n], (by_sigma, by_L) = one.evaluate(state)
            rows[n] = dot(self.directions, by_L) - state.sigma / state.lengths * by_sigma
        return values, rows @ self.lengths_of

    def change(self, state: IsogonalState, z: Array) -> tuple[float, Array]:
        # Lengths that are not positive are outside the domain.
        change = np.log(np.where(state.lengths > self.least, state.lengths, np.nan) / self.critical.lengths)
        return 0.5 * float(change @ change), self.lengths_of.T @ (change / state.lengths)

    def limited(self, state: IsogonalState) -> Array:
        return state.lengths / self.reach

    def limited_rows(self, state: IsogonalState, indices: NDArray[np.intp]) -> Array:
        return self.lengths_of[indices].toarray() / self.reach

    def distance(self, z: Array) -> float:
        return float(np.sqrt(np.mean(np.log(self.at(z).lengths / self.critical.lengths) ** 2)))

    def metric(self, z: Array) -> Callable[[Array], Array]:
        """Products of rows (..., n_modes) with the inverse of Σ (∂log ℓ)², so that a step changes no length too far."""
        lengths = self.critical.lengths + self.lengths_of @ z
        relative = sp.diags_array(1 / lengths) @ self.lengths_of
        factor = splu(sp.csc_matrix(relative.T @ relative))
        return lambda rows: np.asarray(factor.solve(rows.T).T)

    def search(self, problem: Problem, tolerance: float, max_steps: int) -> Minimum:
        """The search through half the distance of the targets, which ends nearer, else the direct one."""

        def stage(start: Array, part: float, most: int) -> Minimum:
            staged = copy(problem)
            if part < 1:
                here = problem.at(self.origin).constraints
                staged.low = np.where(here < problem.low, here + part * (problem.low - here), problem.low)
                staged.high = np.where(here > problem.high, here + part * (problem.high - here), problem.high)
            return minimise_constrained(staged, start, tolerance, self.longest, most, self.metric)

        half = stage(self.origin, 0.5, max_steps // 5)
        end = stage(half.point.z, 1.0, max_steps - half.steps)
        if end.reached or end.steps + half.steps >= max_steps:
            return end
        return min(end, stage(self.origin, 1.0, max_steps), key=lambda one: one.violation)

    def refusal(self, targets: Sequence[Target]) -> str:
        """A sentence where a closed form excludes the target of C_B, else an empty string."""
        require_all_valid(self, targets)
        target = next((target for target in targets if target.quantity.name == "C_B" and not target.sense), None)
        if target is None:
            return ""
        bulk_modulus = quantity(self.network, "B_0")
        bulk, bound = bulk_modulus.evaluate(self.critical)[0], bulk_modulus.extreme(self.manifold)[1]
        least = -bulk / 2
        if (self.critical.sigma > 0).all() and target.high < least - BOUND_ROUNDING * bound:
            return f"C_B is at least -B_0/2 = {least:.8g} for every isogonal change: start from a larger B_0"
        apart = NOT_STIFFEST * bound
        if bulk < bound * (1 - BOUND_ROUNDING) or target.low - apart <= -bound / 2 <= target.high + apart:
            return ""
        return f"at the largest B_0, C_B is {-bound / 2:.8g} for every isogonal change: start from a smaller B_0"

    def designed(self, z: Array, quantities: Sequence[Quantity]) -> DesignResult:
        amplitudes = np.zeros(self.modes.elongations.shape[0])
        amplitudes[: self.n_modes] = self.unit * z
        value = self.modes.walk(amplitudes)
        values, rows = self.values(self.at(z), quantities)
        # The configuration of the same stress, solved again, bounds the errors of the one that was walked to.
        solved = self.manifold.solve(value.sigma)
        errors = np.full(len(quantities), np.nan)
        if solved.ok:
            apart = [abs(one.evaluate(solved.value)[0] - v) for one, v in zip(quantities, values, strict=True)]
            errors = np.array(apart) + [one.error(solved.value) for one in quantities]
        return DesignResult(value, solved, values, errors, rows, solved.value.error_bound)


def _limits(critical: CriticalConfiguration, limits: Sequence[EdgeLimits]) -> tuple[Array, Array]:
    """Least and largest length of every edge, which the given configuration has."""
    least = float(critical.lengths.min())
    low = np.full(critical.network.n_edges, min(SHORTEST_ISOGONAL * float(critical.lengths.mean()), 0.5 * least))
    high = np.full(critical.network.n_edges, np.inf)
    for limit in limits:
        low, high = np.where(limit.low > 0, limit.low, low), np.minimum(high, limit.high)
    if not ((low <= critical.lengths) & (critical.lengths <= high)).all():
        edge = int(np.argmin((low <= critical.lengths) & (critical.lengths <= high)))
        raise InputError(
            f"the limits of the lengths must contain those of the given configuration, {critical.lengths[edge]:.6g} at "
            f"edge {edge}: modes.largest() leads to longer edges"
        )
    return low, high
