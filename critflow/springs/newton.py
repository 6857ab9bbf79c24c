"""Newton's method for the equilibrium of an elastic state, damped where the Hessian is indefinite or singular.

Each step solves H u = f with the sparse Hessian H and the unbalanced forces f = −∂E/∂x.  Far from equilibrium H is
replaced by a positive definite matrix: H with a shift for floppy modes, or its convex part (without the geometric
softening of compressed edges) with a shift that grows until a step is accepted (Levenberg, 1944; Marquardt, 1963).

The loop is not one of `critflow.minimisers`, whose methods see vectors: a step needs the sparse factor of a
matrix that it selects itself, and states keep bond vectors with a relative rounding that coordinates lack.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Generic, Protocol, Self, TypeVar

import numpy as np

from critflow.linalg.factor import Factor, FixedPattern
from critflow.networks.network import Array
from critflow.result import Status

# Stiffness that regularises floppy modes.  They feel no force, so the shift changes no answer; the stiffness of soft
# modes at a strain γ, about γ k, is far above it.
FLOPPY_SHIFT = 1e-11
ROUNDING_FORCE = 1e-13  # below this force a rejected step is due to rounding and not to a matrix that needs damping

# Damping: first and largest shift in units of k, and the factors by which it grows and decays.  The first shift is
# below the soft modes of all strains of interest; beyond the largest, steps are shorter than rounding.
_FIRST_SHIFT, _LARGEST_SHIFT, _GROWTH, _DECAY = 1e-9, 1e6, 10.0, 0.1

# An indefinite Hessian stays indefinite for a while: it is tried again after the force has decreased to this part, or
# after this number of steps.
_RETRY_FORCE, _RETRY_STEPS = 0.1, 10

# Parts of the step that are tried; a step with an earlier factor is tried in full only.
_STEP_LENGTHS = (1.0, 0.3, 0.1)
# Longest displacement of a step in units of the mean length: no edge passes through zero length.
_LONGEST_STEP = 0.5

# A step is accepted if the energy decreases by more than its rounding, or the force to this part.
_ENERGY_ROUNDING, _FORCE_DECREASE = 1e-12, 0.9
# A factor is used again after a decrease of the force to the first part, and as long as it brings the second: the
# factorisation costs ten to a hundred solves.
_REUSE_AFTER, _REUSE_DECREASE = 1e-2, 0.3

# Where rounding stops the iteration within this number of tolerances, the state has converged.
_ROUNDING_MARGIN = 10


class Elastic(Protocol):
    """What this method asks of a state: energy, forces −∂E/∂x in any shape, their unit, and factors of the Hessian."""

    @property
    def energy(self) -> float: ...
    @property
    def forces(self) -> Array: ...
    @property
    def max_force(self) -> float: ...
    @property
    def lengths(self) -> Array: ...
    @property
    def stiffness_scale(self) -> float: ...
    @property
    def length_scale(self) -> float: ...
    def taut(self) -> bool: ...
    def moved(self, displacement: Array) -> Self: ...
    def factorize(self, pattern: FixedPattern, shift: float = 0.0) -> Factor: ...
    def factorize_convex(self, pattern: FixedPattern, shift: float) -> Factor: ...


State = TypeVar("State", bound=Elastic)


@dataclass(frozen=True, eq=False)
class NewtonEnd(Generic[State]):
    """Last state of the iteration.

    indefinite  whether the Hessian was indefinite at some step
    factor      of the Hessian near the last state; None where the last factor is of another matrix
    """

    state: State
    status: Status
    steps: int
    indefinite: bool
    factor: Factor | None


def newton(
    state: State, tolerance: float, max_steps: int, pattern: FixedPattern, least_shift: float = 0.0
) -> NewtonEnd[State]:
    """Relax until no force component exceeds `tolerance`, in units of stiffness times length.

    Every matrix has a `least_shift`, in units of k, for states of many floppy parts such as slack cables.  The last
    state may be a saddle.  `Status.stalled` where no shift yields an accepted step.
    """
    damping, step, status = _Damping(pattern, least_shift * state.stiffness_scale), 0, Status.ok
    while (force := unbalanced_force(state)) > tolerance * (unit := state.stiffness_scale * state.length_scale):
        if step == max_steps:
            status = Status.step_limit
            break
        if damping.shift > _LARGEST_SHIFT * state.stiffness_scale:
            status = Status.stalled
            break
        trial = _line_search(state, damping.displacement(state, step), damping.reuses_factor)
        if trial is not None:
            damping.accept(state, trial)
            state, step = trial, step + 1
        elif not damping.reuses_factor and force < ROUNDING_FORCE * unit:
            status = Status.ok if force <= _ROUNDING_MARGIN * (tolerance * unit) else Status.stalled
            break
        else:
            damping.reject(state)
    # Where the path passed other branches a factor on it may be of no use.
    factor = damping.factor if damping.of_hessian and not damping.indefinite else None
    return NewtonEnd(state, status, step, damping.indefinite, factor)


def unbalanced_force(state: Elastic) -> float:
    """The largest force; infinite beyond the reach of a law, where its energy or a tension is no number."""
    return state.max_force if np.isfinite(state.energy) and np.isfinite(state.max_force) else np.inf


def _line_search(here: State, displacement: Array, factor_is_old: bool) -> State | None:
    """The first accepted state among parts of a step u (n_free, d), or None."""
    longest = _LONGEST_STEP * float(here.lengths.mean()) / max(float(np.abs(displacement).max()), 1e-300)
    for length in _STEP_LENGTHS[:1] if factor_is_old else _STEP_LENGTHS:
        trial = here.moved(min(length, longest) * displacement)
        force = unbalanced_force(trial)
        if factor_is_old:
            accepted = force < _REUSE_DECREASE * unbalanced_force(here)
        else:
            decreased = force < np.inf and trial.energy < here.energy * (1 - _ENERGY_ROUNDING)
            accepted = decreased or force < _FORCE_DECREASE * unbalanced_force(here)
        if accepted:
            return trial
    return None


class _Damping:
    """Selects the matrix of each step and keeps its factor.

    The Hessian itself, with a shift for floppy modes where it is singular; its convex part where it is indefinite.
    `of_hessian` where the factor is of the Hessian without damping.
    """

    def __init__(self, pattern: FixedPattern, least_shift: float):
        self._pattern, self._least = pattern, least_shift
        self.shift, self._floppy_shift = least_shift, 0.0
        self.factor: Factor | None = None
        # The convex part is used while the force is not below the first and the step before the second.
        self._convex_above, self._convex_until = np.inf, 0
        self.of_hessian = self.reuses_factor = False

    @property
    def indefinite(self) -> bool:
        """Whether the Hessian was indefinite at some step."""
        return self._convex_until > 0

    def displacement(self, here: Elastic, step: int) -> Array:
        """The displacement (n_free, d) of this step, by a new factor unless the last one is used again."""
        if not self.reuses_factor:
            self._factorize(here, step)
        assert self.factor is not None
        return self.factor.solve(here.forces.ravel()).reshape(here.forces.shape)

    def _factorize(self, here: Elastic, step: int) -> None:
        convex = unbalanced_force(here) >= self._convex_above and step < self._convex_until
        if not convex and not self._factorize_hessian(here):
            convex = True
            self._convex_above, self._convex_until = _RETRY_FORCE * unbalanced_force(here), step + _RETRY_STEPS
            self._floppy_shift = 0.0
        if convex:
            self.shift = max(self.shift, _FIRST_SHIFT * here.stiffness_scale)
            self.factor = here.factorize_convex(self._pattern, self.shift)
        self.of_hessian = not convex and self.shift == 0.0

    def _factorize_hessian(self, here: Elastic) -> bool:
        """Factorise the Hessian; False where it is indefinite."""
        self.factor = here.factorize(self._pattern, max(self.shift, self._floppy_shift))
        if here.taut() or not self.factor.indefinite:
            return True
        if self._floppy_shift == 0.0:
            # A part may be floppy only, as one of slack edges is.
            self._floppy_shift = FLOPPY_SHIFT * here.stiffness_scale
            self.factor = here.factorize(self._pattern, max(self.shift, self._floppy_shift))
        return not self.factor.indefinite

    def accept(self, before: Elastic, after: Elastic) -> None:
        """Reduce the damping after an accepted step."""
        self.reuses_factor = unbalanced_force(after) < _REUSE_AFTER * unbalanced_force(before)
        decayed = _DECAY * self.shift if self.shift > _FIRST_SHIFT * before.stiffness_scale else 0.0
        self.shift = max(decayed, self._least)

    def reject(self, here: Elastic) -> None:
        """Increase the damping, or only discard a factor of an earlier state."""
        if self.reuses_factor:
            self.reuses_factor = False
        else:
            self.shift = max(_GROWTH * self.shift, _FIRST_SHIFT * here.stiffness_scale)
