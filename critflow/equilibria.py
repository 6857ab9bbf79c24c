"""Equilibria of springs at a strain, by Newton's method with sparse factors or by FIRE, with errors.

Newton's method solves H u = f with the sparse Hessian H and the unbalanced forces f = −∂E/∂x.  Far from equilibrium H
is replaced by a positive definite matrix: H with a shift for floppy modes, or its convex part (without the geometric
softening of compressed edges) with a shift that grows until a step is accepted (Levenberg, 1944; Marquardt, 1963).
Corrections in extended precision then lead onto the exact equilibrium (`with_bounds`), and the inertia of the Hessian
on both sides of zero decides whether that is a minimum of the energy or a saddle (`stability_of`).

The loop is not one of `critflow.minimisers`, whose methods see vectors: a step needs the sparse factor of a
matrix that it selects itself, and states keep bond vectors with a relative rounding that coordinates lack.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from critflow.arguments import of_kind
from critflow.calls import running
from critflow.double_double import two_sum
from critflow.minimisers import Function, Point, fire, minimise
from critflow.networks import Array
from critflow.numerics import EPS, largest, quasi_random
from critflow.refinement import Displacement, inverse_norm
from critflow.result import InputError, Solution, Stats, Status
from critflow.sparse import Factor
from critflow.springs import SpringState, State

# Newton's method

# Its force never exceeds the first tolerance: corrections by one factor then converge to the exact equilibrium, and
# convergence is quadratic, so the last digits cost one step.  The second is what rounding leaves.  Where the error of
# an answer cannot be bounded, the tolerance is multiplied by the last number and Newton's method continues.
LOOSEST_TOLERANCE, FINEST_TOLERANCE, REFINEMENT = 1e-8, 1e-14, 1e-3
NEWTON_STEPS = 200
# Stiffness that regularises floppy modes.  They feel no force, so the shift changes no answer; the stiffness of soft
# modes at a strain γ, about γ k, is far above it.
FLOPPY_SHIFT = 1e-11
# Shifts of the Hessian for the correction of a state with floppy parts: corrections shrink by shift/(shift + stiffness)
# in each mode, and the last shift is as small as the rounding of the factor permits.
CORRECTION_SHIFTS = (FLOPPY_SHIFT, 1e-2 * FLOPPY_SHIFT, 1e-3 * FLOPPY_SHIFT)
# Damping: first and largest shift in units of k, and the factors by which it grows and decays.  The first shift is
# below the soft modes of all strains of interest; beyond the largest, steps are shorter than rounding.
FIRST_SHIFT, LARGEST_SHIFT, GROWTH, DECAY = 1e-9, 1e6, 10.0, 0.1
# An indefinite Hessian stays indefinite for a while: it is tried again after the force has decreased to this part, or
# after this number of steps.
RETRY_FORCE, RETRY_STEPS = 0.1, 10
# Parts of the step that are tried; a step with an earlier factor is tried in full only.  Longest displacement of a step
# in units of the mean length: no edge passes through zero length.
STEP_LENGTHS, LONGEST_STEP = (1.0, 0.3, 0.1), 0.5
# A step is accepted if the energy decreases by more than its rounding, or the force to this part.
ENERGY_ROUNDING, FORCE_DECREASE = 1e-12, 0.9
# A factor is used again after a decrease of the force to the first part, and as long as it brings the second: the
# factorisation costs ten to a hundred solves.
REUSE_AFTER, REUSE_DECREASE = 1e-2, 0.3
# Below this force a rejected step is due to rounding and not to a matrix that needs damping; the state has converged
# within this number of tolerances.
ROUNDING_FORCE, ROUNDING_MARGIN = 1e-13, 10

# FIRE: steps, and its time step in units of 2/ω with the largest frequency ω, above which the scheme is unstable: it
# may grow tenfold, to three quarters of that.  Longest displacement of a step in units of the mean length.
FIRE_STEPS, TIME_STEP, LONGEST_MOVE = 200_000, 0.075, 0.3

# Minima

ROUNDING_COMPRESSION = 16  # a stress −σ below this number of its roundings may be rounding
HESSIAN_ROUNDING = 1e-14  # eigenvalues of the Hessian that rounding may change in sign, over the largest stiffness
# Number of floppy modes that are examined, and of inverse iterations towards them: their eigenvalues are separated by
# many orders from the others.
MOST_MODES, ITERATIONS = 4, 3

SADDLE = "the equilibrium is a saddle of the energy: perturb it, or take smaller strain steps"
UNDECIDED = "rounding hides whether this equilibrium is a minimum or a saddle of the energy: perturb it"


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
    method = relaxation_method(method)
    of_kind(float, tolerance=tolerance)
    max_steps = of_kind(int, None, max_steps=max_steps)
    of_kind(bool, throw=throw)
    solution, _ = relaxed(state, method, tolerance, max_steps)
    return solution.or_raise("the springs found no equilibrium") if throw else solution


def relaxation_method(name: str) -> str:
    """The method selected by a name, else an `InputError`."""
    of_kind(str, method=name)
    if name not in ("auto", "newton", "fire"):
        raise InputError(f"no relaxation method is called {name!r}: choose 'auto', 'newton' or 'fire'")
    return "newton" if name == "auto" else name


def relaxed(
    state: State,
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
        return by_newton(state, tolerance, max_steps, condition)
    return by_fire(state, tolerance, max_steps), None


def by_newton(
    state: State, tolerance: float, max_steps: int | None, condition: bool = True
) -> tuple[Equilibrium[State], Factor | None]:
    """The equilibrium by Newton's method, corrected onto the exact one, with a factor near it."""
    tolerance, left = min(tolerance, LOOSEST_TOLERANCE), NEWTON_STEPS if max_steps is None else max_steps
    steps, indefinite = 0, False
    while True:
        end, factor = newton(state, tolerance, left)
        state, steps, indefinite = end.value, steps + end.stats.steps, indefinite or end.indefinite
        solution = replace(end, stats=replace(end.stats, steps=steps), indefinite=indefinite)
        if not solution.ok:
            return state.explained(solution), None
        if end.indefinite or (state.softens and compressed_edges(state).any()):
            # The path passed other branches, so the correction needs a factor at the last state.
            factor = minimum_factor(state)
        solution, factor = with_bounds(solution, factor, corrected=True, condition=condition)
        if solution.status is not Status.ill_conditioned or tolerance <= FINEST_TOLERANCE:
            return solution, factor
        # Too far from equilibrium for corrections by one factor: continue with factors at new states.
        tolerance = max(REFINEMENT * tolerance, FINEST_TOLERANCE)
        left = NEWTON_STEPS if max_steps is None else left - end.stats.steps


def newton(
    state: State, tolerance: float, max_steps: int, least_shift: float = 0.0
) -> tuple[Equilibrium[State], Factor | None]:
    """Relax until no force component exceeds `tolerance`, in units of stiffness times length.

    Every matrix has a `least_shift`, in units of k, for states of many floppy parts such as slack cables.  The last
    state may be a saddle; the factor is of the Hessian near it, None where the last factor is of another matrix.
    `Status.stalled` where no shift yields an accepted step.
    """
    least = shift = least_shift * state.stiffness_scale
    floppy_shift, factor, of_hessian, reuse, step, status = 0.0, None, False, False, 0, Status.ok
    # The convex part is used while the force is not below the first and the step before the second.
    convex_above, convex_until = np.inf, 0
    while (force := unbalanced_force(state)) > tolerance * (unit := state.stiffness_scale * state.length_scale):
        k = state.stiffness_scale
        if step == max_steps or shift > LARGEST_SHIFT * k:
            status = Status.step_limit if step == max_steps else Status.stalled
            break
        # 1. The matrix: the Hessian, with a shift where a part may be floppy only, as one of slack edges is; its convex
        # part where it is indefinite
        if not reuse:
            factor = None  # its solver, with the memory of its numbers, then serves the next one
            convex = force >= convex_above and step < convex_until
            if not convex:
                factor = state.factorize(max(shift, floppy_shift))
                convex = not state.taut() and factor.indefinite
                if convex and floppy_shift == 0.0:
                    floppy_shift = FLOPPY_SHIFT * k
                    factor = state.factorize(max(shift, floppy_shift))
                    convex = factor.indefinite
                if convex:
                    convex_above, convex_until, floppy_shift = RETRY_FORCE * force, step + RETRY_STEPS, 0.0
            if convex:
                shift = max(shift, FIRST_SHIFT * k)
                factor = state.factorize_convex(shift)
            of_hessian = not convex and shift == 0.0
        # 2. A step, of which the first part counts that decreases the energy or the force
        assert factor is not None
        u = factor.solve(state.forces.ravel()).reshape(state.forces.shape)
        longest = LONGEST_STEP * float(state.lengths.mean()) / max(float(np.abs(u).max()), 1e-300)
        for length in STEP_LENGTHS[:1] if reuse else STEP_LENGTHS:
            trial = state.moved(min(length, longest) * u)
            after = unbalanced_force(trial)
            lower = not reuse and after < np.inf and trial.energy < state.energy * (1 - ENERGY_ROUNDING)
            if lower or after < (REUSE_DECREASE if reuse else FORCE_DECREASE) * force:
                reuse, state, step = after < REUSE_AFTER * force, trial, step + 1
                shift = max(DECAY * shift if shift > FIRST_SHIFT * k else 0.0, least)
                break
        # 3. No part of it: rounding, a factor of an earlier state, or a matrix that needs more damping
        else:
            if not reuse and force < ROUNDING_FORCE * unit:
                status = Status.ok if force <= ROUNDING_MARGIN * (tolerance * unit) else Status.stalled
                break
            shift = shift if reuse else max(GROWTH * shift, FIRST_SHIFT * k)
            reuse = False
    stats, indefinite = Stats("newton", step, residual=state.max_force), convex_until > 0
    # Where the path passed other branches a factor on it may be of no use.
    return Equilibrium(state, status, stats, indefinite=indefinite), factor if of_hessian and not indefinite else None


def unbalanced_force(state: SpringState) -> float:
    """The largest force; infinite beyond the reach of a law, where its energy or a tension is no number."""
    return state.max_force if np.isfinite(state.energy) and np.isfinite(state.max_force) else np.inf


def by_fire(state: State, tolerance: float, max_steps: int | None) -> Equilibrium[State]:
    """The state at which FIRE ends, with its distance to the exact equilibrium, by Newton's method where it is far."""
    # No squared frequency exceeds twice the sum of the stiffnesses at a vertex.
    time_step, longest = TIME_STEP * 2 / np.sqrt(state.largest_stiffness), LONGEST_MOVE * float(state.lengths.mean())
    point, status, steps = minimise(
        Relaxation(state),
        partial(fire, time_step=time_step, max_move=longest),
        np.zeros(state.forces.size),
        tolerance * state.stiffness_scale * state.length_scale,
        FIRE_STEPS if max_steps is None else max_steps,
    )
    last = state.moved(point.x.reshape(state.forces.shape))
    rough = Equilibrium(last, status, Stats("fire", steps, residual=point.residual))
    if not rough.ok:
        return last.explained(rough)
    bounded, _ = with_bounds(rough, None, corrected=False)
    if bounded.status is not Status.ill_conditioned or tolerance <= FINEST_TOLERANCE:
        return bounded
    exact, _ = by_newton(last, max(REFINEMENT * tolerance, FINEST_TOLERANCE), None)
    if not exact.ok:
        return bounded
    apart = max(
        float(np.abs(last.coordinates - exact.value.coordinates).max()),
        float(np.abs(last.bond_vectors - exact.value.bond_vectors).max()),
    )
    bound = apart + exact.stats.error_bound
    return replace(rough, stats=replace(bounded.stats, error_bound=bound, condition=exact.stats.condition))


class Relaxation(Function):
    """The energy as a function of the displacements u (n_free·d,) from a state, for FIRE."""

    def __init__(self, state: SpringState):
        self._state = state

    def at(self, x: Array) -> Point:
        state = self._state.moved(x.reshape(self._state.forces.shape))
        if not np.isfinite(unbalanced_force(state)):
            return Point(x, np.inf, np.zeros_like(x), np.inf)
        return Point(x, state.energy, -state.forces.ravel(), state.max_force)


# The exact equilibrium, and whether it is a minimum


def with_bounds(
    solution: Equilibrium[State],
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
    # 1. The displacement to the exact equilibrium
    state = solution.value
    correction, factor = correction_of(state, factor)
    error, corrected = correction.displacement, corrected and bool(np.isfinite(correction.remainder))
    if corrected:
        x, free = state.coordinates.copy(), state.network.free_rows
        x[free], error = two_sum(state.coordinates[free], correction.displacement)
        state = state.placed(x, correction.bond_vectors)
        apart = 0.5 * EPS * largest(correction.bond_vectors)
    else:
        apart = largest(state.bond_vectors - correction.bond_vectors)
    # 2. The distance that is left
    bound = max(largest(error), apart) + 2 * correction.remainder
    number = state.largest_stiffness * inverse_norm(factor, correction.last) if condition else np.nan
    stats = replace(solution.stats, residual=state.max_force, error_bound=bound, condition=number)
    if not np.isfinite(bound):
        note = "rounding hides the distance to the exact equilibrium: go further from the transition"
        return replace(solution, value=state, status=Status.ill_conditioned, stats=stats, note=note), factor
    # 3. A minimum or a saddle
    solution = replace(solution, value=state, stats=stats)
    if judged:
        exact = state if corrected else state.placed(state.coordinates, correction.bond_vectors)
        solution = as_minimum(solution, *stability_of(exact)) if exact.softens else solution
    return solution, factor


def correction_of(state: SpringState, factor: Factor | None) -> tuple[Displacement, Factor]:
    """The correction to the exact equilibrium, and the factor used: the first of three that makes corrections shrink.

    factor  of the Hessian near the state, if there is one
    """
    if factor is not None:
        correction = state.exact_displacement(factor)
        if np.isfinite(correction.remainder):
            return correction, factor
        factor.release()
    factor = state.factorize()
    if state.taut() or (factor.sound and not factor.n_negative):
        # Small pivots may still be accurate; whether corrections shrink decides.
        correction = state.exact_displacement(factor)
        if np.isfinite(correction.remainder):
            return correction, factor
    # Some part may be floppy.
    for shift in CORRECTION_SHIFTS:
        factor = state.factorize(shift * state.stiffness_scale)
        correction = state.exact_displacement(factor, regularised=True)
        if np.isfinite(correction.remainder):
            break
    return correction, factor


def as_minimum(solution: Equilibrium[State], status: Status, note: str) -> Equilibrium[State]:
    """An equilibrium with the result of `stability_of`: no error bound where it is not known to be a minimum."""
    if status is Status.ok or not solution.ok:
        return solution
    return replace(solution, status=status, note=note, stats=replace(solution.stats, error_bound=np.inf))


def compressed_edges(state: SpringState) -> Array:
    """|σ| (N_b,) of edges that are compressed by more than rounding, 0 for all others."""
    if state.sigma.min() >= 0:
        return np.zeros_like(state.sigma)
    return np.where(state.sigma < -ROUNDING_COMPRESSION * state.stress_rounding, -state.sigma, 0.0)


def minimum_factor(state: SpringState) -> Factor | None:
    """A factor of H − δ, if that is positive definite: the state is then a minimum."""
    factor = state.factorize(-HESSIAN_ROUNDING * state.largest_stiffness)
    return factor if factor.sound and not factor.n_negative else None


def stability_of(state: SpringState) -> tuple[Status, str]:
    """`ok` for a minimum, `unstable` for a saddle, `undecided` where rounding hides which, with the reason.

    Without compressed edges no eigenvalue of the Hessian H is negative.  With them H is compared with its convex part,
    which leaves out their softening: modes that are floppy in it and feel no compression resist nothing and decide
    nothing.  Eigenvalues within rounding of zero count as zero if they are such modes.
    """
    softening = compressed_edges(state)
    if not softening.any() and (state.edge_stiffness >= 0).all():
        return Status.ok, ""
    # 1. The eigenvalues on both sides of zero
    delta = HESSIAN_ROUNDING * state.largest_stiffness
    below = state.factorize(-delta)
    near_zero = below.n_negative
    if below.sound and not near_zero:
        return Status.ok, ""
    above = state.factorize(delta)
    if above.sound and above.n_negative:
        return Status.unstable, SADDLE
    if near_zero > state.factorize_convex(-delta).n_negative:
        return Status.undecided, UNDECIDED
    # 2. Orthonormal modes of the smallest eigenvalues, by inverse iteration, and their softening
    size, count = state.forces.size, min(near_zero, MOST_MODES)
    modes, factor = quasi_random(size * count).reshape(count, size) - 0.5, state.factorize(delta)
    for _ in range(ITERATIONS):
        solved = np.stack([factor.solve(mode) for mode in modes], axis=1)
        modes = np.ascontiguousarray(np.linalg.qr(solved)[0].T)
    softened = max(float(softening @ np.sum(state.edge_rates(mode) ** 2, axis=1)) for mode in modes)
    return (Status.undecided, UNDECIDED) if softened > state.stress_rounding.max() else (Status.ok, "")
