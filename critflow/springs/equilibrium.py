"""Equilibria of springs at a strain, by Newton's method with sparse factors or by FIRE, with errors."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Generic

import numpy as np

from critflow.arguments import of_kind
from critflow.calls import running
from critflow.linalg.factor import Factor, FixedPattern
from critflow.linalg.tolerances import EPS
from critflow.linalg.vectors import largest
from critflow.minimisers import Fire, Function, Point, minimise
from critflow.networks.network import Array
from critflow.precision.double_double import two_sum
from critflow.precision.residual import Displacement, inverse_norm
from critflow.result import InputError, Solution, Stats, Status
from critflow.springs.minimum import compressed_edges, minimum_factor, stability_of
from critflow.springs.newton import FLOPPY_SHIFT, newton, unbalanced_force
from critflow.springs.state import SpringState, State

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
