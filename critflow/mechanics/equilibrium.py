"""Equilibria of springs and cells at a strain, by Newton's method with sparse factors or by FIRE, with error bounds."""

from __future__ import annotations

from dataclasses import replace
from typing import Generic

import numpy as np

from critflow.linalg.factor import Factor, FixedPattern
from critflow.linalg.tolerances import EPS
from critflow.mechanics.springs import FLOPPY_REST, ElasticState, State
from critflow.networks.network import Array
from critflow.precision.double_double import two_sum
from critflow.precision.residual import Displacement, inverse_norm
from critflow.result import InputError, Solution, Stats, Status
from critflow.solvers.minimize import Fire, Function, Point, minimise

# Compression, in units of k, that is rounding.
NO_COMPRESSION = 1e-10

# An edge below this part of the mean length, where there is no equilibrium, is on its way to none.
_COLLAPSING = 1e-3

# Most steps of the methods.
_NEWTON_STEPS, _FIRE_STEPS = 200, 200_000

# Newton's steps go at least so far: a correction then leads to the exact equilibrium, and one from further away fails.
_NEAR = 1e-8
# Where an answer is too rough for its error to be known, it is refined by such a factor, down to rounding.
_FINER, _FINEST = 1e-3, 1e-14


def equilibrium(
    state: State,
    method: str = "auto",
    tolerance: float = 1e-14,
    max_steps: int | None = None,
    pattern: FixedPattern | None = None,
    throw: bool = True,
) -> Solution[State]:
    """Relax springs until no force component exceeds `tolerance`, in units of mean k times mean ℓ.

    Where a law has stiffened edges the unit grows by the largest E''/k, as the rounding of forces does.  Where
    rounding stops Newton's method within ten tolerances that is enough.

    method  "newton": sparse factorisation, shifted where the Hessian is indefinite or singular; "fire": the paper's;
            "auto": Newton's, which is faster at every size and tolerance

    The exact equilibrium is that of the boundary vectors b, rest lengths and stiffnesses as the floats they are, with
    fixed vertices and the grounded one where they stand.  `stats.error_bound` bounds the distance to it of every
    coordinate and every component of a bond vector; Newton's method ends by stepping onto it, to the rounding of the
    coordinates, however rough the tolerance, while FIRE's answer stays as it is.  Where rounding hides the exact one
    it is infinite, with `Status.ill_conditioned`.  `stats.condition` is ‖H‖‖H⁻¹‖.
    """
    solution, _ = relaxed(state, pattern or state.pattern(), method, tolerance, max_steps)
    return solution.or_raise("the springs found no equilibrium") if throw else solution


def relaxation_method(name: str) -> str:
    """The method that a name stands for, else an `InputError`."""
    if name not in ("auto", "newton", "fire"):
        raise InputError(f"no relaxation method is called {name!r}: choose 'auto', 'newton' or 'fire'")
    return "newton" if name == "auto" else name


def relaxed(
    state: State, pattern: FixedPattern, method: str, tolerance: float, max_steps: int | None = None
) -> tuple[Solution[State], Factor | None]:
    """As `equilibrium`, and a factor of the Hessian near its answer, if there is one."""
    factor: Factor | None = None
    method = relaxation_method(method)
    if not tolerance > 0:
        raise InputError(f"the tolerance must be positive, not {tolerance}: 1e-14 is rounding")
    if not np.isfinite(state.energy):
        stats = Stats(method, details={"note": "an edge is longer than its law lets it be: take smaller strain steps"})
        solution = Solution(state, Status.stalled, stats)
    elif method == "newton":
        tolerance = min(tolerance, _NEAR)
        solution, factor = _newton(state, tolerance, _NEWTON_STEPS if max_steps is None else max_steps, pattern)
    else:
        most = _FIRE_STEPS if max_steps is None else max_steps
        solution = _fire(state, tolerance * state.stiffness_scale * state.length_scale, most)
    if solution.ok:
        bounded, factor = _bounded(solution, pattern, factor, corrected=method == "newton")
        if bounded.ok or tolerance <= _FINEST:
            return bounded, factor
        # So rough an answer that corrections by one factor lead nowhere: Newton's method makes factors anew.
        most = _NEWTON_STEPS if max_steps is None or method == "fire" else max_steps - solution.stats.steps
        finer, factor = relaxed(solution.value, pattern, "newton", max(_FINER * tolerance, _FINEST), most)
        return (_continued(solution, finer), factor) if method == "newton" else (_measured(bounded, finer), None)
    length = solution.value.lengths
    if state.edges_may_collapse and length.min() < _COLLAPSING * length.mean():
        note = f"edge {int(length.argmin())} shrinks to zero length, where its pull has no direction"
        stats = replace(solution.stats, details={**solution.stats.details, "note": note})
        solution = Solution(solution.value, Status.edge_collapse, stats)
    return solution, None


def _continued(rough: Solution[State], finer: Solution[State]) -> Solution[State]:
    """Where Newton's method ended that went on from a rough answer, with what both parts took."""
    first, then = rough.stats, finer.stats
    details = {**then.details, "indefinite": first.details["indefinite"] or then.details["indefinite"]}
    stats = replace(
        then,
        steps=first.steps + then.steps,
        evaluations=first.evaluations + then.evaluations,
        details=details,
    )
    return replace(finer, stats=stats)


def _measured(rough: Solution[State], exact: Solution[State]) -> Solution[State]:
    """A rough answer with its distance to the equilibrium that Newton's method finds from it, if it finds one."""
    if not exact.ok:
        return rough
    one, other = rough.value, exact.value
    apart = max(
        float(np.abs(one.coordinates - other.coordinates).max()),
        float(np.abs(one.bond_vectors - other.bond_vectors).max()),
    )
    details = {name: detail for name, detail in rough.stats.details.items() if name != "note"}
    bound, condition = apart + exact.stats.error_bound, exact.stats.condition
    return Solution(one, Status.ok, replace(rough.stats, error_bound=bound, condition=condition, details=details))


def _bounded(
    solution: Solution[State], pattern: FixedPattern, factor: Factor | None, corrected: bool
) -> tuple[Solution[State], Factor]:
    """An equilibrium with its distance to the exact one, and moved onto it if it is to be corrected; the factor used.

    factor  of the Hessian near the state, if there is one
    """
    state = solution.value
    way, factor = _way(state, pattern, factor)
    error = way.displacement
    if corrected and np.isfinite(way.remainder):
        x, free = state.coordinates.copy(), state.network.free
        x[free], error = two_sum(state.coordinates[free], way.displacement)
        state = replace(state, coordinates=x, bond_vectors=way.bond_vectors)  # type: ignore[type-var]
        apart = 0.5 * EPS * float(np.abs(way.bond_vectors).max())
    else:
        apart = float(np.abs(state.bond_vectors - way.bond_vectors).max())
    bound = max(float(np.abs(error).max()), apart) + 2 * way.remainder
    condition = state.largest_stiffness * inverse_norm(factor, way.last)
    stats = replace(solution.stats, residual=state.max_force, error_bound=bound, condition=condition)
    status = solution.status
    if not np.isfinite(bound):
        status = Status.ill_conditioned
        stats.details["note"] = "rounding hides how far the exact equilibrium is: go further from the transition"
    return Solution(state, status, stats), factor


def _way(state: ElasticState, pattern: FixedPattern, factor: Factor | None = None) -> tuple[Displacement, Factor]:
    """The distance to the exact equilibrium, and the factor that it took.

    factor  of the Hessian near the state, if there is one; where corrections by it do not settle others are tried
    """
    if factor is not None:
        way = state.distance(factor)
        if np.isfinite(way.remainder):
            return way, factor
    factor = state.factorize(pattern)
    if factor.sound and not factor.n_negative:
        # Pivots that are small beside the others may still be good: corrections tell.
        way = state.distance(factor)
        if np.isfinite(way.remainder):
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
    end = minimise(Relaxation(state), Fire(time_step, max_move), np.zeros(state.forces.size), tolerance, max_steps)
    final = state.moved(end.point.x.reshape(state.forces.shape))
    return Solution(
        final, end.status, Stats("fire", end.steps, residual=end.point.residual, details={"energy": final.energy})
    )


class Relaxation(Function, Generic[State]):
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
