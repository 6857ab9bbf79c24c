"""Equilibria of springs at a strain, by Newton's method with sparse factors or by FIRE, with errors."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Generic, Protocol, Self, TypeVar

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import LinearOperator

from critflow.arguments import of_kind
from critflow.calls import running
from critflow.double_double import two_sum
from critflow.minimisers import Fire, Function, Point, minimise
from critflow.networks import Array
from critflow.numerics import EPS, largest, quasi_random
from critflow.refinement import Displacement, inverse_norm
from critflow.result import InputError, Record, Solution, SolveError, Stats, Status
from critflow.sparse import Factor, FixedPattern, spread_columns
from critflow.springs import EdgeMatrix, SpringState, State

# Newton's method for the equilibrium of an elastic state, damped where the Hessian is indefinite or singular.
#
# Each step solves H u = f with the sparse Hessian H and the unbalanced forces f = −∂E/∂x.  Far from equilibrium H is
# replaced by a positive definite matrix: H with a shift for floppy modes, or its convex part (without the geometric
# softening of compressed edges) with a shift that grows until a step is accepted (Levenberg, 1944; Marquardt, 1963).
#
# The loop is not one of `critflow.minimisers`, whose methods see vectors: a step needs the sparse factor of a
# matrix that it selects itself, and states keep bond vectors with a relative rounding that coordinates lack.

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


ElasticState = TypeVar("ElasticState", bound=Elastic)


@dataclass(frozen=True, eq=False)
class NewtonEnd(Generic[ElasticState]):
    """Last state of the iteration.

    indefinite  whether the Hessian was indefinite at some step
    factor      of the Hessian near the last state; None where the last factor is of another matrix
    """

    state: ElasticState
    status: Status
    steps: int
    indefinite: bool
    factor: Factor | None


def newton(
    state: ElasticState, tolerance: float, max_steps: int, pattern: FixedPattern, least_shift: float = 0.0
) -> NewtonEnd[ElasticState]:
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


def _line_search(here: ElasticState, displacement: Array, factor_is_old: bool) -> ElasticState | None:
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


# Whether an equilibrium is a minimum of the energy or a saddle, by the inertia of the Hessian on both sides of zero.
#
# Without compressed edges no eigenvalue is negative.  With them the Hessian H is compared with its convex part H_c,
# which leaves out their softening: modes that are floppy in H_c and feel no compression resist nothing and decide
# nothing.

ROUNDING_COMPRESSION = 16  # a stress −σ below this number of its roundings may be rounding
HESSIAN_ROUNDING = 1e-14  # eigenvalues of the Hessian that rounding may change in sign, over the largest stiffness

SADDLE = "the equilibrium is a saddle of the energy: perturb it, or take smaller strain steps"
UNDECIDED = "rounding hides whether this equilibrium is a minimum or a saddle of the energy: perturb it"

# Inverse iterations towards the modes of the smallest eigenvalues, which are separated by many orders from the others.
_ITERATIONS = 3
# Number of floppy modes that are examined.
_MOST_MODES = 4


class Stressed(Elastic, Protocol):
    """What decides about a minimum: also the stress, stiffnesses and rates of edges."""

    @property
    def sigma(self) -> Array: ...
    @property
    def stress_rounding(self) -> Array: ...
    @property
    def edge_stiffness(self) -> Array: ...
    @property
    def largest_stiffness(self) -> float: ...
    def edge_rates(self, motion: Array) -> Array: ...


def compressed_edges(state: Stressed) -> Array:
    """|σ| (N_b,) of edges that are compressed by more than rounding, 0 for all others."""
    if state.sigma.min() >= 0:
        return np.zeros_like(state.sigma)
    return np.where(state.sigma < -ROUNDING_COMPRESSION * state.stress_rounding, -state.sigma, 0.0)


def minimum_factor(state: Stressed, pattern: FixedPattern) -> Factor | None:
    """A factor of H − δ, if that is positive definite: the state is then a minimum."""
    factor = state.factorize(pattern, -HESSIAN_ROUNDING * state.largest_stiffness)
    return factor if factor.sound and not factor.n_negative else None


def stability_of(state: Stressed, pattern: FixedPattern) -> tuple[Status, str]:
    """`ok` for a minimum, `unstable` for a saddle, `undecided` where rounding hides which, with the reason.

    Eigenvalues within rounding of zero count as zero if they are floppy modes, which no compressed edge softens.
    """
    softening = compressed_edges(state)
    if not softening.any() and (state.edge_stiffness >= 0).all():
        return Status.ok, ""
    delta = HESSIAN_ROUNDING * state.largest_stiffness
    below = state.factorize(pattern, -delta)
    near_zero = below.n_negative
    if below.sound and not near_zero:
        return Status.ok, ""
    above = state.factorize(pattern, delta)
    if above.sound and above.n_negative:
        return Status.unstable, SADDLE
    if near_zero > state.factorize_convex(pattern, -delta).n_negative:
        return Status.undecided, UNDECIDED
    modes = _soft_modes(state.factorize(pattern, delta), state.forces.size, min(near_zero, _MOST_MODES))
    softened = max(float(softening @ np.sum(state.edge_rates(mode) ** 2, axis=1)) for mode in modes)
    return (Status.undecided, UNDECIDED) if softened > state.stress_rounding.max() else (Status.ok, "")


def _soft_modes(factor: Factor, size: int, count: int) -> Array:
    """Orthonormal modes (count, size) near the smallest eigenvalues of a positive definite matrix, by iteration."""
    modes = quasi_random(size * count).reshape(count, size) - 0.5
    for _ in range(_ITERATIONS):
        solved = np.stack([factor.solve(mode) for mode in modes], axis=1)
        modes = np.ascontiguousarray(np.linalg.qr(solved)[0].T)
    return modes


# Newton's method never stops at a larger force: corrections by one factor then converge to the exact equilibrium, and
# convergence is quadratic, so the last digits cost one step.
LOOSEST_TOLERANCE = 1e-8
FINEST_TOLERANCE = 1e-14  # force that rounding leaves; no relaxation is repeated with a smaller tolerance

# Shifts of the Hessian for the correction of a state with floppy parts: corrections shrink by shift/(shift + stiffness)
# in each mode, and the last shift is as small as the rounding of the factor permits.
CORRECTION_SHIFTS = (FLOPPY_SHIFT, 1e-2 * FLOPPY_SHIFT, 1e-3 * FLOPPY_SHIFT)
NEWTON_STEPS = 200
_FIRE_STEPS = 200_000

# Where the error of an answer cannot be bounded, its tolerance is multiplied by this and Newton's method continues.
_REFINEMENT = 1e-3

# FIRE, in units of 2/ω with the largest frequency ω, above which the scheme is unstable: the time step may grow
# tenfold, to three quarters of that.  Longest displacement of a step in units of the mean length.
_TIME_STEP, _LONGEST_MOVE = 0.075, 0.3


@dataclass(frozen=True, kw_only=True, repr=False)
class Equilibrium(Solution[State]):
    """A relaxed state with bounds of its errors.

    indefinite  whether the Hessian was indefinite at some step of Newton's method
    """

    indefinite: bool = False


@running("equilibrium")
def equilibrium(
    state: State,
    method: str = "auto",
    tolerance: float = FINEST_TOLERANCE,
    max_steps: int | None = None,
    pattern: FixedPattern | None = None,
    throw: bool = True,
) -> Equilibrium[State]:
    """Relax springs until no force component exceeds `tolerance`, in units of mean k times mean ℓ.

    Where a law has stiffened edges the unit grows by the largest E''/k, as the rounding of forces does.  Where
    rounding stops Newton's method within ten tolerances the state counts as relaxed.

    method  "newton": sparse factorisation, damped where the Hessian is indefinite or singular; "fire": the method of
            the paper; "auto": Newton's method, which is faster at every size and tolerance

    The exact equilibrium is that of the boundary vectors b, rest lengths and stiffnesses as floating-point numbers,
    with fixed vertices and the grounded vertex at their positions.  Newton's method ends with a correction onto it, to
    the rounding of the coordinates, for every tolerance; FIRE's answer is not corrected.

    Error bound (estimate): `stats.error_bound` limits the distance to the exact equilibrium in every coordinate and
    every component of a bond vector.  It assumes that corrections in extended precision continue to shrink by the
    factor observed between them.  Where they do not shrink it is infinite, with `Status.ill_conditioned`.
    `stats.condition` is ‖H‖‖H⁻¹‖.

    Where edges are compressed the inertia of the Hessian decides: `Status.unstable` at a saddle, and
    `Status.undecided` where rounding hides the sign of an eigenvalue, with an infinite bound in both.

    Raises `SolveError` where no equilibrium is found and `throw` is set, `InputError` for an unknown method or a
    tolerance that is not positive.

    >>> import critflow as cf
    >>> network = cf.voronoi_network(n_vertices=20, seed=1)
    >>> critical = cf.optimize(network, 'B_0').value
    >>> state = cf.spring_state(network, 0.95 * critical.lengths, critical.coordinates)
    >>> cf.equilibrium(state).ok
    True
    """
    state = of_kind(SpringState, state=state)
    of_kind(str, method=method)
    of_kind(float, tolerance=tolerance)
    max_steps = of_kind(int, None, max_steps=max_steps)
    pattern = of_kind(FixedPattern, None, pattern=pattern)
    of_kind(bool, throw=throw)
    solution, _ = relaxed(state, pattern or state.pattern(), relaxation_method(method), tolerance, max_steps)
    return solution.or_raise("the springs found no equilibrium") if throw else solution


def relaxation_method(name: str) -> str:
    """The method selected by a name, else an `InputError`."""
    if name not in ("auto", "newton", "fire"):
        raise InputError(f"no relaxation method is called {name!r}: choose 'auto', 'newton' or 'fire'")
    return "newton" if name == "auto" else name


def relaxed(
    state: State,
    pattern: FixedPattern,
    method: str,
    tolerance: float,
    max_steps: int | None = None,
    condition: bool = True,
) -> tuple[Equilibrium[State], Factor | None]:
    """As `equilibrium`, with a factor of the Hessian near the answer where one exists.

    condition  whether `stats.condition` is computed, which costs a solve; else it is NaN
    """
    if not tolerance > 0:
        raise InputError(f"the tolerance must be positive, not {tolerance}: {FINEST_TOLERANCE:g} is rounding")
    if not np.isfinite(unbalanced_force(state)):
        note = "an edge is longer than its law allows: take smaller strain steps"
        return Equilibrium(state, Status.stalled, Stats(method), note), None
    if method == "newton":
        return _by_newton(state, pattern, tolerance, max_steps, condition)
    return _by_fire(state, pattern, tolerance, max_steps), None


def _by_newton(
    state: State, pattern: FixedPattern, tolerance: float, max_steps: int | None, condition: bool = True
) -> tuple[Equilibrium[State], Factor | None]:
    tolerance = min(tolerance, LOOSEST_TOLERANCE)
    end = newton(state, tolerance, NEWTON_STEPS if max_steps is None else max_steps, pattern)
    stats = Stats("newton", end.steps, residual=end.state.max_force)
    solution = Equilibrium(end.state, end.status, stats, indefinite=end.indefinite)
    if not solution.ok:
        return _with_collapse(solution), None
    factor = end.factor
    if end.indefinite or (end.state.softens and compressed_edges(end.state).any()):
        # The path passed other branches, so the correction needs a factor at the last state.
        factor = minimum_factor(end.state, pattern)
    bounded, nearby = with_bounds(solution, pattern, factor, corrected=True, condition=condition)
    if bounded.status is not Status.ill_conditioned or tolerance <= FINEST_TOLERANCE:
        return bounded, nearby
    # Too far from equilibrium for corrections by one factor: continue with factors at new states.
    left = None if max_steps is None else max_steps - end.steps
    finer, factor = _by_newton(end.state, pattern, max(_REFINEMENT * tolerance, FINEST_TOLERANCE), left, condition)
    stats = replace(finer.stats, steps=end.steps + finer.stats.steps)
    return replace(finer, stats=stats, indefinite=end.indefinite or finer.indefinite), factor


def _by_fire(state: State, pattern: FixedPattern, tolerance: float, max_steps: int | None) -> Equilibrium[State]:
    # No squared frequency exceeds twice the sum of the stiffnesses at a vertex.
    end = minimise(
        Relaxation(state),
        Fire(_TIME_STEP * 2 / np.sqrt(state.largest_stiffness), _LONGEST_MOVE * float(state.lengths.mean())),
        np.zeros(state.forces.size),
        tolerance * state.stiffness_scale * state.length_scale,
        _FIRE_STEPS if max_steps is None else max_steps,
    )
    final = state.moved(end.point.x.reshape(state.forces.shape))
    solution = Equilibrium(final, end.status, Stats("fire", end.steps, residual=end.point.residual))
    if not solution.ok:
        return _with_collapse(solution)
    bounded, _ = with_bounds(solution, pattern, None, corrected=False)
    if bounded.status is not Status.ill_conditioned or tolerance <= FINEST_TOLERANCE:
        return bounded
    finer, _ = _by_newton(final, pattern, max(_REFINEMENT * tolerance, FINEST_TOLERANCE), None)
    return _compared(solution, bounded, finer)


def _with_collapse(failed: Equilibrium[State]) -> Equilibrium[State]:
    """A failed relaxation, with `Status.edge_collapse` where the reason is an edge that shrinks to zero length."""
    edge = failed.value.collapsing_edge()
    if edge is None:
        return failed
    note = f"edge {edge} shrinks to zero length, where its tension has no direction"
    return replace(failed, status=Status.edge_collapse, note=note)


def _compared(rough: Equilibrium[State], bounded: Equilibrium[State], exact: Equilibrium[State]) -> Equilibrium[State]:
    """The error of an unconverged state by Newton's method started from it, if that converges."""
    if not exact.ok:
        return bounded
    one, other = rough.value, exact.value
    apart = max(
        float(np.abs(one.coordinates - other.coordinates).max()),
        float(np.abs(one.bond_vectors - other.bond_vectors).max()),
    )
    bound, condition = apart + exact.stats.error_bound, exact.stats.condition
    return replace(rough, stats=replace(bounded.stats, error_bound=bound, condition=condition))


def with_bounds(
    solution: Equilibrium[State],
    pattern: FixedPattern,
    factor: Factor | None,
    corrected: bool,
    judged: bool = True,
    condition: bool = True,
) -> tuple[Equilibrium[State], Factor]:
    """An equilibrium with its distance to the exact one, moved onto it if `corrected`, and the factor used.

    factor  of the Hessian near the state, if there is one
    judged  whether the exact equilibrium must be a minimum, else `Status.unstable`
    condition  whether `stats.condition` is computed, which costs a solve
    """
    state = solution.value
    correction, factor = _correction(state, pattern, factor)
    error, corrected = correction.displacement, corrected and bool(np.isfinite(correction.remainder))
    if corrected:
        x, free = state.coordinates.copy(), state.network.free_rows
        x[free], error = two_sum(state.coordinates[free], correction.displacement)
        state = state.placed(x, correction.bond_vectors)
        apart = 0.5 * EPS * largest(correction.bond_vectors)
    else:
        apart = largest(state.bond_vectors - correction.bond_vectors)
    bound = max(largest(error), apart) + 2 * correction.remainder
    number = state.largest_stiffness * inverse_norm(factor, correction.last) if condition else np.nan
    stats = replace(solution.stats, residual=state.max_force, error_bound=bound, condition=number)
    if np.isfinite(bound):
        solution = replace(solution, value=state, stats=stats)
        if judged:
            exact = state if corrected else state.placed(state.coordinates, correction.bond_vectors)
            solution = as_minimum(solution, *stability_of(exact, pattern)) if exact.softens else solution
        return solution, factor
    note = "rounding hides the distance to the exact equilibrium: go further from the transition"
    return replace(solution, value=state, status=Status.ill_conditioned, stats=stats, note=note), factor


def as_minimum(solution: Equilibrium[State], status: Status, note: str) -> Equilibrium[State]:
    """An equilibrium with the result of `stability_of`: no error bound where it is not known to be a minimum."""
    if status is Status.ok or not solution.ok:
        return solution
    return replace(solution, status=status, note=note, stats=replace(solution.stats, error_bound=np.inf))


def _correction(state: SpringState, pattern: FixedPattern, factor: Factor | None) -> tuple[Displacement, Factor]:
    """The correction to the exact equilibrium, and the factor used: the first of three that makes corrections shrink.

    factor  of the Hessian near the state, if there is one
    """
    if factor is not None:
        correction = state.exact_displacement(factor)
        if np.isfinite(correction.remainder):
            return correction, factor
    factor = state.factorize(pattern)
    if state.taut() or (factor.sound and not factor.n_negative):
        # Small pivots may still be accurate; whether corrections shrink decides.
        correction = state.exact_displacement(factor)
        if np.isfinite(correction.remainder):
            return correction, factor
    # Some part may be floppy.
    for shift in CORRECTION_SHIFTS:
        factor = state.factorize(pattern, shift * state.stiffness_scale)
        correction = state.exact_displacement(factor, regularised=True)
        if np.isfinite(correction.remainder):
            break
    return correction, factor


class Relaxation(Function, Generic[State]):
    """The energy as a function of the displacements u (n_free·d,) from a state, for FIRE."""

    def __init__(self, state: State):
        self._state = state

    def at(self, x: Array) -> Point:
        state = self._state.moved(x.reshape(self._state.forces.shape))
        if not np.isfinite(unbalanced_force(state)):
            return Point(x, np.inf, np.zeros_like(x), np.inf)
        return Point(x, state.energy, -state.forces.ravel(), state.max_force)


# Parts of the elastic Hessian, and the response of bonds to force dipoles.
#
# Any central-force energy E(|L|) with σ = τ/|L| and stiffness k = ∂²E/∂|L|² has, over the free coordinates,
#   in h = |L|²/2   H = R^hᵀ K R^h + P ⊗ 1,  K = (k − σ)/|L|²     (`GenericHessian`, `ModifiedStiffness`)
#   in |L|          H = R̃ᵀ k R̃ + P̃,  P̃ = P ⊗ 1 − Σ R̃ᵀ σ R̃      (`HookeanRigidityMatrix`, `HookeanPrestressMatrix`)
# with R^h = ∂h/∂x and R̃ = ∂|L|/∂x = R^h/|L|.  Both splits have the same zero modes, those of R, and P and P̃ agree on
# them.  (The paper prints τ where R̃ᵀ σ R̃ has σ; dimensional analysis and finite differences of forces require σ.)


@dataclass(frozen=True, eq=False, repr=False)
class HessianSplit(Record):
    """H = response ᵀ · diag(stiffness) · response + prestress, over the free coordinates in the order (vertex, axis).

    response   R^h or R̃, sparse (N_b, d·n_free)
    stiffness  K or k, (N_b,), or sparse (N_b, N_b) where springs couple edges
    prestress  P ⊗ 1 or P̃, sparse (d·n_free)²
    """

    response: sp.csr_array
    stiffness: EdgeMatrix
    prestress: sp.csr_array

    @property
    def gram(self) -> sp.csr_array:
        """Rᵀ K R, the resistance to stretching, sparse (d·n_free)²."""
        k = self.stiffness if sp.issparse(self.stiffness) else sp.diags_array(self.stiffness)
        return sp.csr_array(self.response.T @ k @ self.response)

    @property
    def hessian(self) -> sp.csr_array:
        """H, sparse (d·n_free)²."""
        return sp.csr_array(self.gram + self.prestress)


@running("geometric_split")
def geometric_split(state: SpringState) -> HessianSplit:
    """H = R^hᵀ K R^h + P ⊗ 1 (`GenericHessian`, `RigidityMatrix2`, `PrestressMatrix2`)."""
    state = of_kind(SpringState, state=state)
    network = state.network
    g = network.free_incidence
    P = g.T @ sp.diags_array(state.sigma) @ g
    prestress = sp.csr_array(sp.kron(P, sp.eye_array(network.dimension)))
    return HessianSplit(spread_columns(network, state.bond_vectors), state.modified_stiffness, prestress)


@running("hookean_split")
def hookean_split(state: SpringState) -> HessianSplit:
    """H = R̃ᵀ k R̃ + P̃ with k = K|L|² + σ, the stiffness of any law (`HookeanPrestressMatrix`)."""
    state = of_kind(SpringState, state=state)
    geometric = geometric_split(state)
    R = sp.csr_array(sp.diags_array(1 / state.lengths) @ geometric.response)
    prestress = sp.csr_array(geometric.prestress - R.T @ sp.diags_array(state.sigma) @ R)
    return HessianSplit(R, state.axial_stiffness, prestress)


@running("bond_operator")
def bond_operator(state: SpringState, max_refinements: int = 10) -> LinearOperator:
    """Ξ = R H⁻¹ Rᵀ as an operator (N_b, N_b): changes of length by unit force dipoles on the bonds (`BondOperator`).

    H⁻¹ excludes floppy motions.  Ξ is symmetric; for unstressed springs √k Ξ √k projects on the tensions caused by
    displacements, so its trace is the rank of R, and it annihilates √k⁻¹ times a self-stress.
    Raises `SolveError` where H has negative eigenvalues: the springs then buckle.
    """
    state = of_kind(SpringState, state=state)
    max_refinements = of_kind(int, max_refinements=max_refinements)
    network = state.network
    R = spread_columns(network, state.bond_vectors / state.lengths[:, None])
    pattern, shift = state.pattern(), 0.0
    factor = state.factorize(pattern)
    if factor.indefinite:
        shift = FLOPPY_SHIFT * state.stiffness_scale
        factor = state.factorize(pattern, shift)
    if factor.indefinite:
        note = f"the Hessian has {factor.n_negative} negative eigenvalues, so the springs buckle: relax them first"
        raise SolveError(f"no bond operator: {note}", Solution(None, Status.unstable, Stats("bond operator"), note))

    def apply(dipoles: Array) -> Array:
        force = np.asarray(R.T @ np.ravel(dipoles))
        u = factor.solve(force)
        # Refinement removes the effect of the shift; floppy motions feel no force and are excluded.
        for _ in range(max_refinements if shift else 1):
            residual = force - factor.multiply(u) + shift * u
            correction = factor.solve(residual)
            u = u + correction
            if np.abs(R @ correction).max() <= 1e-15 * np.abs(R @ u).max():
                break
        return np.asarray(R @ u)

    n = network.n_edges
    return LinearOperator((n, n), matvec=apply, rmatvec=apply, dtype=float)
