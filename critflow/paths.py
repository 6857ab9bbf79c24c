"""Numerical continuation of equilibria in strain: predictor, corrector, and checks that the branch is not left.

An equilibrium at strain γ has vertices x = F(γ) y with coordinates y that move with the cell.  A path is a curve
z(γ) of the unknowns, z = y or with further ones (`Unknowns`).  One step from γ to γ + δ (`attempt`):

1. Predict z(γ + δ) by a Hermite polynomial through the last points and their velocities (`Predictor`).
2. Correct it by Newton's method, H u = f, or FIRE: the forces f conjugate to all unknowns vanish.
3. Without compressed springs the equilibrium is the global minimum and lies on the branch of taut states
   (`SpringState.unique`).  Otherwise the step is refused where the correction took many iterations, met an indefinite
   Hessian, or ended far from the prediction (`expects`).
4. Compute moduli and the velocity dz/dγ from the factor of the Hessian, H u = −∂²E/∂x∂γ.
5. Where the branch is still in doubt take the step back, by that velocity: beyond a fold it does not end at the last
   point (`steps_back_to_start`).

From one strain to the next (`step`, with the loop in `advance`):

6. An accepted step becomes the last point and the stride doubles.
7. A refused step is halved.  The path ends where a stride is below 2⁻¹⁶ of the distance between the strains, with the
   reason of the longest step that failed: shorter ones may fail by rounding alone.

The velocity at a transition is the limit of that under a stress η σ as η → 0 (`with_departure_velocity`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Literal, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg.lapack import dgesv

from critflow.arguments import held, of_kind, shown
from critflow.calls import counted, running
from critflow.deformation import Deformable, Deformation, deformation_of, strain_components
from critflow.equilibria import (
    FINEST_TOLERANCE,
    FLOPPY_SHIFT,
    LOOSEST_TOLERANCE,
    ROUNDING_COMPRESSION,
    Equilibrium,
    relaxation_method,
    relaxed,
)
from critflow.extensions import extensible, provided
from critflow.linear_response import Elasticity, LinearResponse, accumulated_rounding, linear_response, strains_of
from critflow.manifold import COLLAPSED, CriticalConfiguration
from critflow.networks import Array, Network
from critflow.numerics import EPS, dot, largest, mean, norms
from critflow.result import InputError, Record, Solution, Stats, Status
from critflow.sparse import Factor, FixedPattern
from critflow.springs import HOOKEAN, SpringLaw, SpringState, checked_law
from critflow.taut_part import backbone

# The state at γ = 0 of a strain path, from a critical configuration, a state of springs, or a solution with one.

# Largest force of a state from which a path starts, in units of stiffness times length: the first relaxation removes
# rounding, and a larger force would hide a jump.
BALANCED_START = 1e-6

_ADVICE = "CriticalManifold(network).configuration(sigma) or optimize(network, 'B_0') makes one"
_OF_STRESS = "change its stress, or remove it"

Start = Any
"""What a path starts from: each kind of which `start_of` knows the springs, or a solution with one."""


@dataclass(frozen=True, eq=False)
class Beginning:
    """Springs at γ = 0.

    stress   tension over length of each spring at a transition, σ (N_b,) or T/p (N_f,); None for a state of springs
    part     whether they are a part of the network, whose slack edges were left out
    pattern  of the Hessian, where the manifold of the start has it
    total_strains  strains (n,) of the network as given, of strains (n,) along a path from here; None: the same
    """

    springs: SpringState
    stress: Array | None = None
    part: bool = False
    note: str = ""
    pattern: FixedPattern | None = None
    total_strains: Callable[[Deformation, Array], Array] | None = None


@extensible
def start_of(start: Start, law: SpringLaw | None, taut_only: bool) -> Beginning:
    """The springs from which a path starts, with the stress of a transition; `InputError` for other kinds."""
    known = held(start, (CriticalConfiguration, SpringState))
    if known is not None:
        return start_of(known, law, taut_only)
    kinds, advice = "a CriticalConfiguration or a SpringState or a Solution", getattr(start, "alone", "") or _ADVICE
    raise InputError(f"start must be {kinds}, not {shown(start)}: {advice}")


@start_of.register
def _(start: Solution, law: SpringLaw | None, taut_only: bool) -> Beginning:
    """That of the value; slack edges are no failure."""
    if start.status is not Status.slack_edges:
        start.or_raise("no path starts from this solution")
    return start_of(start.value, law, taut_only)


@start_of.register
def _(start: CriticalConfiguration, law: SpringLaw | None, taut_only: bool) -> Beginning:
    """Springs at rest: all edges, or the taut ones; cables where rest lengths are known."""
    if start.rest_lengths is not None and not taut_only:
        return provided("cables_at_onset", "paths of cables")(start, start.rest_lengths, law)
    require_directions((start.lengths <= COLLAPSED * start.lengths.mean()) & (start.sigma != 0), _OF_STRESS)
    part, note = start, ""
    if not start.sigma.all():
        part, n_slack = backbone(start).configuration, int(np.count_nonzero(start.sigma == 0))
        note = f"{n_slack} of {len(start.sigma)} edges are slack, so the path is that of the taut part alone"
    law = checked_law(HOOKEAN if law is None else law, part.lengths, part.network.stiffness)
    springs = SpringState(part.network, part.lengths, part.coordinates, part.bond_vectors, law)
    if part is not start:
        return Beginning(springs, part.sigma, True, note)
    # A solver that was chosen for the manifold may not serve the Hessian.
    shared = start.maker is not None and start.maker.backend == "auto"
    return Beginning(springs, part.sigma, pattern=start.manifold.hessian if shared else None)


@start_of.register
def of_state(state: SpringState, law: SpringLaw | None, taut_only: bool) -> Beginning:
    """A state of springs, which has its own law and all of its edges."""
    if law is not None and law != state.law:
        raise InputError("the state has a spring law: leave out law=, or make a state with the other law")
    if taut_only:
        raise InputError("a state of springs has no slack part to leave out: taut_only belongs to a configuration")
    require_directions(state.lengths == 0, "move its ends apart")
    return Beginning(state)


def require_directions(short: NDArray[np.bool_], instead: str) -> None:
    """`InputError` where an edge of these (N_b,) has no length."""
    if short.any():
        raise InputError(f"edge {int(short.argmax())} has no length, so its spring has no direction: {instead}")


def balanced(springs: SpringState) -> bool:
    """Whether the forces of springs vanish but for rounding."""
    return springs.max_force <= BALANCED_START * springs.stiffness_scale * springs.length_scale


# The tangent of a strain path: velocities of its unknowns, the modulus along the path, and its extrapolation.
#
# The strain γ has the rate A = F'F⁻¹ of the cell and the second derivative F''F⁻¹; free components q of the cell have
# rates A_m and mixed second derivatives with γ.  For rates a, b with relaxed bond rates L̇ = A L + g u and ḣ = L·L̇,
#     E_ab = Σ ḣ_a K ḣ_b + σ (L̇_a·L̇_b + L·L̈_ab);
# free components follow with q̇ = −E_mn⁻¹ E_nγ, and the modulus along the path is (E_γγ + E_γm q̇_m)/V.
# Antisymmetric parts of A only rotate, so their relaxation u is zero.
#
# From the velocities at its last points the path is extrapolated by Hermite polynomials (`Predictor`).

# Corrections of a relaxation, the part of it at which they stop, and the largest that rounding may leave.
_MOST_CORRECTIONS, _CONVERGED, _CORRECT = 4, 1e-9, 1e-2
# Beyond this number of previous steps ahead a polynomial extrapolates worse than a straight line.
_FARTHEST = 2
# Points of the path from which it is extrapolated.
_MOST_POINTS = 3


@dataclass(frozen=True, eq=False)
class Tangent:
    """Derivatives along a path at one state.

    relaxation    dx/dγ − Ȧx, (n_free, d): velocities relative to the affine motion of the cell
    free_rate     dq/dγ of free components, (m,)
    second        d²E/dγ² of the relaxed energy, and its rounding error
    """

    relaxation: Array
    free_rate: Array
    second: float
    second_error: float


def tangent_of_response(response: LinearResponse, rates: Array, second_rates: Array) -> Tangent:
    """The tangent from the responses to all strains: no sums over edges."""
    tensors, weights = response.value, np.array([strain_components(0.5 * (A + A.T)) for A in rates])
    E = np.array([[tensors.second(A, B) for B in rates] for A in rates])
    E[0] += [float(np.vdot(tensors.stress, A)) for A in second_rates]
    E[1:, 0] = E[0, 1:]
    path = _with_free(E)
    # Errors of q̇ enter squared only.
    size = np.abs(path @ weights)
    error = float(size @ tensors.errors.tensor @ size)
    V = tensors.volume
    return Tangent(response.relaxation(path @ weights), path[1:], float(V * (E[0] @ path)), V * error)


def tangent_of_springs(
    state: SpringState, rates: Array, second_rates: Array, pattern: FixedPattern, factor: Factor | None
) -> Tangent | None:
    """The tangent from the relaxations to each rate, by a factor near the state; None where it is not determined."""
    if factor is None:
        factor = state.factorize(pattern)
        if factor.indefinite:
            factor = state.factorize(pattern, FLOPPY_SHIFT * state.stiffness_scale)
    relaxations = relaxations_to(state, factor, rates)
    if relaxations is None:
        return None
    network, L, sigma = state.network, state.bond_vectors, state.sigma
    speeds = np.array([L @ A.T + network.free_incidence @ u for A, u in zip(rates, relaxations, strict=True)])
    hdots, rows = np.array([dot(L, speed) for speed in speeds]), speeds.reshape(len(speeds), -1)
    E = hdots @ state.resistance(hdots).T + (np.repeat(sigma, L.shape[1]) * rows) @ rows.T
    curved = np.array([sigma * dot(L, L @ A.T) for A in second_rates])
    E[0] += curved.sum(axis=1)
    E[1:, 0] = E[0, 1:]
    path = _with_free(E)
    relaxation, second = np.tensordot(path, relaxations, 1), float(E[0] @ path)
    noise = _edge_rounding(state, np.tensordot(path, speeds, 1), relaxation) + 4 * EPS * np.abs(curved[0])
    return Tangent(relaxation, path[1:], second, accumulated_rounding(noise) + 4 * EPS * abs(second))


def _with_free(E: Array) -> Array:
    """(1, q̇) from the second derivatives E_ab, (1 + m,); free components that no stress resists do not follow."""
    if len(E) == 1:
        return np.ones(1)
    return np.concatenate([[1.0], -np.linalg.lstsq(E[1:, 1:], E[1:, 0], rcond=None)[0]])


def relaxations_to(state: SpringState, factor: Factor, rates: Array) -> Array | None:
    """u (n, n_free, d) with H u = −∂²E/∂x∂a for each rate (n, d, d) of the cell; None where corrections do not shrink.

    factor  of the Hessian at or near the state
    """
    found = np.zeros((len(rates), *state.forces.shape))
    for u, A in zip(found, rates, strict=True):
        # The antisymmetric part rotates all.
        affine, before = 0.5 * (state.bond_vectors @ (A + A.T)), np.inf
        for _ in range(_MOST_CORRECTIONS):
            force = state.force_rates(affine + state.edge_rates(u))
            correction = factor.solve(force.ravel()).reshape(u.shape)
            u += correction
            size = float(np.abs(correction).max(initial=0.0))
            small = float(np.abs(u).max(initial=0.0))
            # Corrections that no longer shrink are rounding, or the factor is of no use.
            if not size < before:
                if not size <= _CORRECT * small:
                    return None
                break
            if size <= _CONVERGED * small:
                break
            before = size
    return found


def _edge_rounding(state: SpringState, speed: Array, u: Array) -> Array:
    """Rounding error of each edge's part of d²E/dγ², (N_b,), as `linear_response` has it."""
    network, sigma, length = state.network, state.sigma, state.lengths
    stress = state.resistance(dot(state.bond_vectors, speed))
    size, vertex_speed = norms(speed), np.zeros(network.n_vertices)
    vertex_speed[network.free_rows] = norms(u)
    rate_rounding = EPS * (size + vertex_speed.take(network.edges.T).sum(axis=0) + length)
    noise = state.stress_rounding * (size**2 + length * size)
    return noise + 2 * (np.abs(stress) * length + np.abs(sigma) * size) * rate_rounding


@dataclass(frozen=True, eq=False)
class Predictor:
    """Extrapolates a path y(γ) from its last two or three points, whichever predicted the last one better.

    points  (γ, y, dy/dγ) of the last points, the newest last; y and dy/dγ (n,), the latter None if it is unknown
    better  index of the better prediction: from two points 0, from all −1
    """

    points: tuple[tuple[float, Array, Array | None], ...]
    better: int = -1

    @classmethod
    def at(cls, strain: float, y: Array, velocity: Array | None = None) -> Predictor:
        """The predictor at the first point of a path."""
        return cls(((strain, y, velocity),))

    def extended(self, strain: float, y: Array, velocity: Array | None, predicted: Array) -> Predictor:
        """The predictor with a further point, of which `changes` were predicted; the last three are kept."""
        better = self.better
        if len(predicted) > 1:
            better = int(np.abs(predicted - (y - self.points[-1][1])).max(axis=1).argmin())
        return Predictor((*self.points[1 - _MOST_POINTS :], (strain, y, velocity)), better)

    def chosen(self, changes: Array) -> Array:
        """The change (n,) to use of those predicted."""
        return np.asarray(changes[self.better if len(changes) > 1 else 0])

    def changes(self, strain: float) -> Array:
        """Extrapolated changes of y from the newest point (1 or 2, n): from two points, and from three."""
        last, y, velocity = self.points[-1]
        if velocity is None:
            return np.zeros((1, len(y)))
        ahead, behind = strain - last, last - self.points[-2:][0][0]
        if abs(ahead) > _FARTHEST * abs(behind):
            return (velocity * ahead)[None]
        values = [part for _, there, rate in self.points for part in (there - y, rate) if part is not None]
        weights = [_weights(self.points[-n:], strain) for n in range(2, len(self.points) + 1)]
        return np.array([[0.0] * (len(values) - len(row)) + row for row in weights]) @ np.array(values)


def _weights(points: tuple[tuple[float, Array, Array | None], ...], strain: float) -> list[float]:
    """The weights in a Hermite polynomial at a strain: of the value and, if known, the velocity of each point."""
    weights = list[float]()
    for here, _, velocity in points:
        value, slope = 1.0, 0.0
        for there, _, rate in points:
            if there != here:
                order = 1 if rate is None else 2
                value *= ((strain - there) / (here - there)) ** order
                slope += order / (here - there)
        weights += [value] if velocity is None else [value * (1 - (strain - here) * slope), value * (strain - here)]
    return weights


# A step may have left its branch if Newton's method took more steps, or ended further from the prediction.  At 200
# vertices and steps of 1e-3 it takes 2 to 5 steps; it ends within 2e-3 in the first step of strain and within 1e-6 in
# later ones.  With a third of 1,000 vertices slack the first step takes 11 to 26 and ends within 2e-2; shorter ones
# take no fewer.
EXPECTED_STEPS, EXPECTED_DISTANCE = 40, 0.05
# Ends further than the first from the prediction are accepted if the step back ends within the second of the start:
# beyond a fold it ends on another branch, a distance of order one away.
DOUBTED_DISTANCE, RETURN_DISTANCE = 1e-3, 1e-6
# Stress over the square of the strain, in units of k, below which a state has none.  Newton's method leaves 1e-16; by
# symmetry a stress may be of second order in the strain, or of third.
UNSTRESSED = 1e-8
# A resisted strain γ causes a stress of order γ k; below WEAK γ k the state may be unstressed: forces balanced to 1e-14
# leave up to 1e-9 where stresses are nearly balanced by themselves.
WEAK = 1e-6
FLOPPY = "springs keep all lengths at strain {:.3g}, so nothing resists: fix the free components of the cell"

# Part of the strain interval below which a step is not divided further.
_SMALLEST_PART = 2.0**-16
# Steps towards one strain, and iterations of Newton's method: no path within them needed more than a tenth.
_MOST_STEPS, _MOST_ITERATIONS = 400, 4000
# Stress η, in units of k, that stands for the limit of no stress: its effect is of this order, and rounding of 1e-10.
_DEPARTING_STRESS = 1e-6
# A step that covers this part of the remaining interval ends at the requested strain, not a rounding next to it.
_WHOLE = 0.999

_LIMIT = "the steps became too short to arrive: give strains that are closer together, or another method"
_UNRESOLVED = "this strain and the one before it give the same cell in floating-point numbers: choose larger ones"
_JUMPED = "the equilibrium jumps to another branch: the one followed ends before this strain"


@dataclass(frozen=True, eq=False)
class Cell:
    """The cell at one point of a path.

    gradient  by which it and the vertices have moved since γ = 0, x = gradient y, (d, d)
    free      free components q (m,); without those m = 0
    """

    strain: float
    gradient: Array
    free: Array

    @cached_property
    def inverse(self) -> Array:
        """The inverse of the gradient, (d, d)."""
        # LAPACK itself: NumPy takes ten times as long for so small a matrix, with the same bits.
        return np.asarray(dgesv(self.gradient, np.eye(len(self.gradient)))[2])


class Correction(NamedTuple):
    """The end of a correction: an equilibrium, a factor of the Hessian near it, and its cell.

    retry_smaller  a smaller step may succeed where this one failed
    """

    solution: Equilibrium[SpringState]
    factor: Factor | None
    cell: Cell
    retry_smaller: bool = True


class Unknowns(Protocol):
    """What a continuation needs to know about the unknowns z (n,) of a path; `Vertices` has those of springs."""

    def cell(self, strain: float, free: Array | None = None) -> Cell:
        """The cell at a strain, with free components q (m,), or none of their strain."""

    def point(self, state: SpringState, cell: Cell) -> Array:
        """z (n,) of a state."""

    def velocity(self, along: Tangent, cell: Cell) -> Array:
        """dz/dγ (n,) of a tangent."""

    def predicted(
        self, state: SpringState, here: Cell, strain: float, change: Array, stress: Array | None = None
    ) -> tuple[SpringState, Cell]:
        """The state at another strain after a change of z (n,), from which a correction begins, and its cell.

        stress  σ of the state at a transition
        """

    def corrected(self, start: SpringState, cell: Cell) -> Correction:
        """The equilibrium from a prediction."""

    def rates(self, cell: Cell) -> tuple[Array, Array]:
        """Rates A (1 + m, d, d) of the cell by γ and q, and second derivatives by γ and each (`tangent`)."""

    def beginning(self, problem: PathProblem, first: Beginning, gamma: Array) -> tuple[list[Interval], PathPoint]:
        """The first of the strains γ where they need no step, and the point from which the path goes on."""


@dataclass(frozen=True, eq=False)
class PathProblem:
    """What stays the same along a path: the network at γ = 0, its deformation, the unknowns and the measurements.

    exact    corrections, by Newton's method, end at the equilibrium to the rounding of its numbers
    measure  as of `strain_path`; without moduli those are not defined
    """

    reference: Network
    deformation: Deformation
    pattern: FixedPattern
    unknowns: Unknowns
    exact: bool
    measure: str
    has_moduli: bool


@dataclass(frozen=True, eq=False)
class Attempt:
    """End of one step, from which the continuation proceeds if it is accepted.

    predicted  changes of z that were extrapolated, of which one began the correction
    retry_smaller  a smaller step may succeed where this one failed
    velocity   dz/dγ; None where it was not computed
    tangent, moduli, coordinate_error  measured at the end; without tensors `moduli` has those of bulk and shear alone
    """

    cell: Cell
    state: SpringState
    predicted: Array = field(default_factory=lambda: np.zeros((1, 0)))
    iterations: int = 0
    status: Status = Status.ok
    note: str = ""
    retry_smaller: bool = True
    velocity: Array | None = None
    tangent: Tangent | None = None
    moduli: Elasticity | None = None
    coordinate_error: float = np.nan

    @property
    def ok(self) -> bool:
        return self.status is Status.ok

    def failed(self, status: Status, note: str, retry_smaller: bool = True) -> Attempt:
        """The same step, refused."""
        return replace(self, status=status, note=note, retry_smaller=retry_smaller)


@dataclass(frozen=True, eq=False)
class PathPoint:
    """The last accepted point of a path, and what the next step begins with.

    stride    length of the next step in strain
    stress    tension over length of each spring at a transition, σ (N_b,) or T/p (N_f,); None elsewhere
    """

    cell: Cell
    state: SpringState
    predictor: Predictor
    stride: float = np.inf
    stress: Array | None = None


@dataclass(frozen=True, eq=False)
class Interval:
    """The part of a path from one strain to the next.

    point       last accepted point
    iterations  of all steps
    inserted    accepted steps before the one that ends
    end         the last step
    ended       whether the strain is reached, or given up
    failed      the longest step that failed since the last accepted one
    """

    point: PathPoint
    target: float
    end: Attempt
    ended: bool = False
    smallest: float = 0.0
    iterations: int = 0
    inserted: int = 0
    failed: Attempt | None = None


def begin(problem: PathProblem, springs: SpringState, stress: Array | None, cell: Cell | None = None) -> Interval:
    """The first point of a path: a transition with its stress as it is, or springs relaxed at γ = 0.

    cell  of the transition, where that is not at γ = 0
    """
    unknowns = problem.unknowns
    cell = cell or unknowns.cell(0.0)
    point = PathPoint(cell, springs, Predictor.at(cell.strain, unknowns.point(springs, cell)), stress=stress)
    if stress is not None:
        return Interval(point, cell.strain, Attempt(cell, springs), ended=True)
    # Unknowns other than vertices may have forces here, and velocities are unknown.
    end = attempt(problem, point, 0.0)
    if end.ok:
        predictor = Predictor.at(0.0, unknowns.point(end.state, end.cell), end.velocity)
        point = PathPoint(end.cell, end.state, predictor)
    return Interval(point, 0.0, end, ended=True, iterations=end.iterations)


def refused(point: PathPoint, strain: float, status: Status, note: str) -> Interval:
    """The end of a path before a strain, without a step."""
    return Interval(point, strain, Attempt(point.cell, point.state).failed(status, note), ended=True)


def advance(problem: PathProblem, point: PathPoint, strain: float) -> Interval:
    """Proceed to a strain by steps that halve after failures and double after successes."""
    here = point.cell
    if (problem.unknowns.cell(strain, here.free).gradient == here.gradient).all():
        return refused(point, strain, Status.ill_conditioned, _UNRESOLVED)
    # F(γ) does not resolve smaller strains.
    smallest = max(_SMALLEST_PART * abs(strain - here.strain), EPS)
    if point.stress is not None:
        point = with_departure_velocity(problem, point, point.stress, strain)
    if point.stride < smallest:
        point = replace(point, stride=smallest)
    interval = Interval(point, strain, Attempt(here, point.state), smallest=smallest)
    for _ in range(_MOST_STEPS):
        interval = step(problem, interval)
        if interval.ended:
            return interval
        if problem.exact and interval.iterations > _MOST_ITERATIONS:
            break
    return replace(interval, end=interval.end.failed(Status.step_limit, _LIMIT))


def step(problem: PathProblem, interval: Interval) -> Interval:
    """One attempt towards the strain, and the point and stride that follow from it (steps 6 and 7)."""
    point, target = interval.point, interval.target
    left = target - point.cell.strain
    ahead = min(point.stride, abs(left))
    strain = target if ahead >= _WHOLE * abs(left) else point.cell.strain + np.copysign(ahead, left)
    end = attempt(problem, point, strain)
    iterations = interval.iterations + end.iterations
    if end.ok:
        arrived = strain == target
        stride = 2 * ahead if not arrived or ahead == point.stride else point.stride
        z = problem.unknowns.point(end.state, end.cell)
        accepted = PathPoint(
            end.cell, end.state, point.predictor.extended(strain, z, end.velocity, end.predicted), stride
        )
        inserted = interval.inserted + (not arrived)
        return Interval(accepted, target, end, arrived, interval.smallest, iterations, inserted)
    failed = (interval.failed or end) if end.retry_smaller else end
    interval = replace(interval, end=end, iterations=iterations)
    if not end.retry_smaller or 0.5 * ahead < interval.smallest:
        return replace(interval, end=failed, ended=True)
    return replace(interval, point=replace(point, stride=0.5 * ahead), failed=failed)


def attempt(problem: PathProblem, point: PathPoint, strain: float) -> Attempt:
    """One step to a strain (steps 1 to 5 of the module)."""
    predicted = point.predictor.changes(strain)
    change = point.predictor.chosen(predicted)
    start, cell = problem.unknowns.predicted(point.state, point.cell, strain, change, point.stress)
    solution, factor, cell, retry_smaller = problem.unknowns.corrected(start, cell)
    end = Attempt(cell, solution.value, predicted, solution.stats.steps, coordinate_error=solution.stats.error_bound)
    if not solution.ok:
        return end.failed(solution.status, solution.reason, retry_smaller)
    if keeps_lengths(end.state, strain):
        return end.failed(Status.floppy, FLOPPY.format(strain), retry_smaller=False)
    certain = end.state.unique
    if not (certain or expects(problem, start, solution)):
        return end.failed(Status.unstable, _JUMPED)
    end = _measured(problem, end, factor)
    if end.ok and not (certain or steps_back_to_start(problem, point, start, end)):
        return end.failed(Status.unstable, _JUMPED)
    return end


def expects(problem: PathProblem, start: SpringState, solution: Equilibrium[SpringState]) -> bool:
    """Whether a correction ended near its start, after few steps and no indefinite Hessian."""
    # FIRE takes many steps everywhere.
    few = (solution.stats.steps <= EXPECTED_STEPS or not problem.exact) and not solution.indefinite
    return few and distance(start, solution.value) <= EXPECTED_DISTANCE


def steps_back_to_start(problem: PathProblem, point: PathPoint, start: SpringState, end: Attempt) -> bool:
    """Whether the step back ends at the last state, which it does not from beyond a fold."""
    behind = point.cell.strain - end.cell.strain
    # No step returns to a transition, where nothing is determined.
    away = point.stress is None and behind != 0
    if not away or distance(start, end.state) <= DOUBTED_DISTANCE:
        return True
    velocity = np.zeros(end.predicted.shape[1]) if end.velocity is None else end.velocity
    back = problem.unknowns.predicted(end.state, end.cell, point.cell.strain, behind * velocity)
    solution = problem.unknowns.corrected(*back).solution
    return solution.ok and distance(solution.value, point.state) <= RETURN_DISTANCE


def _measured(problem: PathProblem, end: Attempt, factor: Factor | None) -> Attempt:
    """The end of a step with moduli and velocity, or refused where its response is not determined."""
    springs, rates, moduli = end.state, problem.unknowns.rates(end.cell), None
    if not problem.has_moduli:
        along = tangent_of_springs(springs, *rates, problem.pattern, factor)
    else:
        strains = None if problem.measure == "tensors" else strains_of(rates[0])
        response = linear_response(
            *(springs, springs.network.volume, problem.pattern, problem.exact, factor), condition=False, strains=strains
        )
        if not response.ok:
            return end.failed(response.status, response.reason)
        along = tangent_of_response(response, *rates)
        moduli = response.value
    return replace(
        end,
        moduli=moduli,
        velocity=None if along is None else problem.unknowns.velocity(along, end.cell),
        tangent=None if problem.measure == "energy" else along,
    )


def with_departure_velocity(problem: PathProblem, point: PathPoint, stress: Array, strain: float) -> PathPoint:
    """A transition with its velocity on the side of a strain, where it is determined.

    It is the limit of the velocity of the same configuration under a stress η σ as η → 0.
    """
    springs, here = point.state, point.cell
    L, rates = springs.bond_vectors, problem.unknowns.rates(here)
    sigma = springs.edge_tension(stress * springs.spring_lengths) / springs.lengths
    work = np.vdot(sigma[:, None] * L, L @ rates[0][0].T)
    stress = stress / springs.stiffness * np.copysign(1.0, work * (strain - here.strain))
    tightened = springs.spring_lengths * (1 - _DEPARTING_STRESS * stress / np.abs(stress).max())
    # Slack edges resist nothing.
    rest = np.where(stress != 0, tightened, springs.rest_lengths)
    stressed = replace(springs, rest_lengths=rest, law=springs.law.near_rest)
    factor = stressed.factorize(problem.pattern, FLOPPY_SHIFT * springs.stiffness_scale)
    # Where all edges are tense the stress resists all motions.
    if not stressed.taut(0.0) and factor.indefinite:
        return point
    along = tangent_of_springs(stressed, *rates, problem.pattern, factor)
    if along is None:
        return point
    z, velocity = problem.unknowns.point(springs, here), problem.unknowns.velocity(along, here)
    return replace(point, predictor=Predictor.at(here.strain, z, velocity))


def keeps_lengths(state: SpringState, strain: float) -> bool:
    """Whether a strain causes no stress beyond rounding: all springs keep their lengths, by motions that none resists.

    Where they resist, a stress is of the order of the strain.
    """
    if strain == 0 or not weakly_stressed(state, strain):
        return False
    unit, rounding = strain**2 * state.stiffness_scale, ROUNDING_COMPRESSION * state.stress_rounding
    least = np.maximum(UNSTRESSED * unit, np.where(rounding < WEAK * unit, rounding, 0.0))
    return bool((np.abs(state.sigma) <= least).all())


def weakly_stressed(state: SpringState, strain: float) -> bool:
    """Whether the stress is far below that of a strain which the springs resist."""
    return largest(state.sigma) <= WEAK * abs(strain) * state.stiffness_scale


def distance(one: SpringState, other: SpringState) -> float:
    """The largest difference of two states' bond vectors, in units of the mean length."""
    return largest(one.bond_vectors - other.bond_vectors) / mean(one.lengths)


# The unknowns of a strain path, chosen once for each path: the vertices, or what an extra adds to them.

NONE_FREE = np.zeros(0)  # q of a cell without free components
LOOSENING_WORK = 1e-9  # work of a strain on the stress of a transition, relative to its size, below which it loosens
_LOOSENED = "the strain loosens the network, which is floppy on this side of the transition: change its sign"


def unknowns_of(
    springs: SpringState, deformation: Deformation, gamma: Array, pattern: FixedPattern, method: str, tolerance: float
) -> Unknowns:
    """The vertices, with the free components of a cell that has some, and as cables demand it if springs are cables.

    Raises `InputError` where a strain γ inverts the cell.
    Raises `InputError` where the extra with one of these is not installed.
    """
    kind = provided("free_cell_unknowns", "free components of the cell") if deformation.free else Vertices
    # Predictions for springs are within reach of the last correction of Newton's method.
    rough = method == "newton" and not springs.law.one_sided and not deformation.free
    gradients = {strain: deformation.gradient(strain) for strain in gamma.tolist()}
    vertices = kind(
        *(springs.network, deformation, gradients, pattern, method),
        LOOSEST_TOLERANCE if rough else tolerance,
    )
    return provided("cable_unknowns", "paths of cables")(vertices) if springs.law.one_sided else vertices


@dataclass(frozen=True, eq=False)
class Vertices:
    """The coordinates y (n_free, d) that move with the cell, x = F(γ) y: the `Unknowns` of springs.

    gradients          F (d, d) of the strains of the path
    method, tolerance  of `relaxed`
    """

    reference: Network
    deformation: Deformation
    gradients: dict[float, Array]
    pattern: FixedPattern
    method: str
    tolerance: float

    def cell(self, strain: float, free: Array | None = None) -> Cell:
        """The cell F(γ)."""
        return Cell(strain, self.gradient(strain), NONE_FREE)

    def gradient(self, strain: float) -> Array:
        """F(γ), (d, d)."""
        F = self.gradients.get(strain)
        return self.deformation.gradient(strain) if F is None else F

    def point(self, state: SpringState, cell: Cell) -> Array:
        """y, (n_free·d,)."""
        return np.asarray(state.coordinates[state.network.free_rows] @ cell.inverse.T).ravel()

    def velocity(self, along: Tangent, cell: Cell) -> Array:
        """dy/dγ, (n_free·d,)."""
        return np.asarray(along.relaxation @ cell.inverse.T).ravel()

    def predicted(
        self, state: SpringState, here: Cell, strain: float, change: Array, stress: Array | None = None
    ) -> tuple[SpringState, Cell]:
        """The state after a change of y (n_free·d,) and the affine motion to another cell."""
        cell = self.cell(strain)
        return self.moved(state, here, cell, change), cell

    def moved(self, state: SpringState, here: Cell, cell: Cell, change: Array) -> SpringState:
        """A state in a cell after a change of y (n_free·d,) and the affine motion to another."""
        before, after = here.gradient, cell.gradient
        displacement = change.reshape(-1, len(before)) @ before.T
        return state.deformed_to(self.reference.deformed(after), after @ here.inverse, displacement)

    def corrected(self, start: SpringState, cell: Cell) -> Correction:
        """The equilibrium from a prediction."""
        solution, factor = relaxed(start, self.pattern, self.method, self.tolerance, condition=False)
        # FIRE at its step limit gains nothing from smaller strain steps.
        limited = self.method == "fire" and solution.status is Status.step_limit
        return Correction(solution, factor, cell, retry_smaller=not limited)

    def rates(self, cell: Cell) -> tuple[Array, Array]:
        """F'F⁻¹ and F''F⁻¹, (1, d, d)."""
        velocity = self.deformation.rate(cell.strain) @ cell.inverse
        return velocity[None], (self.deformation.second_rate(cell.strain) @ cell.inverse)[None]

    def beginning(self, problem: PathProblem, first: Beginning, gamma: Array) -> tuple[list[Interval], PathPoint]:
        """A transition, or springs relaxed at γ = 0: an end where they are not, or where γ loosens a transition."""
        springs, stress = first.springs, first.stress
        if stress is None and not balanced(springs):
            raise InputError(
                f"the springs are not in equilibrium, a force of {springs.max_force:.2g} is left: call equilibrium() "
                "first"
            )
        start = begin(problem, springs, stress)
        if stress is None:
            return [start] if gamma[0] == 0 or not start.end.ok else [], start.point
        if loosened(springs, stress, self.deformation, gamma[0]):
            return [refused(start.point, gamma[0], Status.floppy, _LOOSENED)], start.point
        return [], start.point


def loosened(springs: SpringState, stress: Array, deformation: Deformation, strain: float) -> bool:
    """Whether a strain of this sign loosens a network in tension, which is then floppy: γ Σ σ L·A L < 0."""
    sigma = springs.edge_tension(stress * springs.spring_lengths) / springs.lengths
    L, A = springs.bond_vectors, np.copysign(1.0, strain) * deformation.velocity(0.0)
    work, size = np.sum(sigma[:, None] * L * (L @ A.T)), np.linalg.norm(A) * np.sum(sigma * springs.lengths**2)
    return bool((sigma >= 0).all() and work < -LOOSENING_WORK * size)


# The strain path: springs deformed step by step from an equilibrium, each step from the last state.
#
# From a transition the rest lengths are the lengths there, ℓ = |L(0)|; the default is dilation, with volumes
# V(γ) = V(0)(1 + γ) (`RestLengthVolumetric`).  Where rest lengths are known, as of an onset, slack edges follow as
# cables until they tighten.  `continuation` has the algorithm, `start` the state at γ = 0.

MEASURES = ("tensors", "moduli", "energy")  # what a path measures at each strain, in falling order of time


@dataclass(frozen=True, eq=False, repr=False)
class StrainPath(Record):
    """Equilibria at strains γ (n,): moduli, energy and forces (n,), Newton steps and status, the states.

    From the first strain that is not reached, values are NaN and `status` holds the reason.
    Stability is tested at these strains and at inserted ones: a symmetric state that loses and regains it in between,
    where F(γ) turns back, passes.

    steps     Newton steps (n,) before the correction to the exact equilibrium, none from a close prediction
    inserted  steps (n,) to intermediate strains, which are not stored
    coordinate_error, bulk_modulus_error, shear_modulus_error  bounds (n,) on the errors against the exact equilibrium;
    the last one for both conventions.  Error bounds (estimate): those of `equilibrium` and `elasticity`

    deformation      the path F(γ) of the cell
    modulus          (1/V) d²E/dγ² along the path (n,) with the volume V(γ) and the relaxed energy E(γ), with its error
                     bound (estimate); dilation has B/(1 + γ)²
    stress           Cauchy stress (1/V) Σ σ L⊗L, (n, d, d)
    elasticity       tensors of each state (`Elasticity`); empty without moduli or tensors, and without a cell
    free_components  q (n, m) of the cell (1 + Σ q E) F(γ), free of stress (`Deformation.free`)
    total_strains    (n,) strains of the network as given where the path starts from an onset: F(γ_total) = F(γ) F(γ_c),
                     NaN where the deformation has no such strain, as along another one than that of the onset; of any
                     other start the strains themselves

    Networks without a cell have no volume: their moduli and stresses are those of V = 1.
    """

    strains: Array
    bulk_modulus: Array
    shear_modulus: Array
    shear_modulus_stress_corrected: Array
    energy: Array
    max_force: Array
    steps: NDArray[np.int64]
    status: NDArray[np.int64]
    states: tuple[SpringState, ...]
    inserted: NDArray[np.int64]
    coordinate_error: Array
    bulk_modulus_error: Array
    shear_modulus_error: Array
    deformation: Deformation
    modulus: Array
    modulus_error: Array
    stress: Array
    elasticity: tuple[Elasticity, ...]
    free_components: Array
    total_strains: Array


def check_strains(strains: ArrayLike, signed: bool = False, zero: bool = False) -> Array:
    """Strains as an increasing array of positive numbers, else an `InputError`.

    signed  they may also be negative and decreasing
    zero    the first one may be zero
    """
    of_kind(np.ndarray, strains=strains)
    gamma = np.atleast_1d(np.asarray(strains, dtype=float))
    if gamma.ndim != 1:
        raise InputError(f"strains must be a list of numbers, not an array of shape {gamma.shape}")
    if len(gamma) == 0:
        raise InputError("the list of strains is empty: give at least one, such as 0.001")
    size = -gamma if signed and gamma[-1] < 0 else gamma
    if not (np.isfinite(size).all() and (size[0] > 0 or (zero and size[0] == 0)) and (np.diff(size) > 0).all()):
        other = ", or negative and decreasing: one path for each sign" if signed else ""
        raise InputError(f"strains must be finite, positive and increasing, such as 0.001:0.010:0.001{other}")
    return gamma


@dataclass(frozen=True)
class PathSolver:
    """How the springs of a path are relaxed: method and tolerance of `equilibrium`.

    tolerance  for FIRE, cables, and free components of the cell; Newton's answer is otherwise exact to rounding
    pattern    of the Hessian; by default that of the manifold that made the start, or one made for the path
    """

    method: str = "auto"
    tolerance: float = FINEST_TOLERANCE
    pattern: FixedPattern | None = None


@running("strain_path")
def strain_path(
    start: Start,
    strains: ArrayLike,
    deformation: Deformable = "dilation",
    *,
    law: SpringLaw | None = None,
    taut_only: bool = False,
    measure: Literal["tensors", "moduli", "energy"] = "tensors",
    solver: PathSolver | None = None,
    throw: bool = True,
) -> Solution[StrainPath]:
    """Deform springs from an equilibrium through strains γ away from zero, relaxing and measuring at each.

    b → F(γ) b, with γ positive and increasing or negative and decreasing.  Strains count from the start: from an onset
    at γ_c the network as given is deformed by F(γ) F(γ_c), and `total_strains` are its strains.  Each step starts from
    the last state, extrapolated by the last states and their linear responses.  A step that fails, or may have left its
    branch of equilibria, is halved, down to 2⁻¹⁶ of the strain interval, and steps grow again after that; where even
    the smallest leaves the branch the path ends with `Status.unstable`.  An equilibrium of a convex law without
    compressed springs is unique and the global minimum, so its branch is not checked.

    start              a critical configuration, also of a tissue, a state of springs in equilibrium, such as
                       `spring_state` or a state of another path, or a solution with one.  A configuration that knows
                       rest lengths, as that of `critical_strain` or `critical_from_lengths`, is one of cables, taut and
                       slack ones; of others the lengths are the rest lengths, and where edges are slack, σ = 0, the
                       path is that of the taut part (`backbone`).  Only a state may begin with γ = 0
    deformation        what `deformation_of` accepts
    law                of springs from a critical configuration: Cable() where rest lengths are known, else Hookean; a
                       state has one
    taut_only          True: the taut part alone also where rest lengths are known, as springs at rest
    measure            "tensors"; "moduli": bulk and shear moduli alone, in less time, and `elasticity` is empty;
                       "energy": equilibria only
    solver             `PathSolver`; free components of the cell need Newton's method

    Cables that are floppy at γ = 0, as `spring_state(..., Cable())` at any coordinates, are followed through their
    onset: energy, stress and moduli are zero up to γ_c of `critical_strain`, at which the branch begins.  Coordinates
    are not unique before, and their error is NaN.
    `Status.floppy` at a strain where springs keep all lengths, as free components of the cell permit next to a
    transition, or where no stress fixes these components: cables only pull, so free sides are undetermined past the
    onset, or are pulled together until the cell is flat.

    Raises `InputError` for strains that do not lead away from zero, a deformation that inverts the cell, a start
    without balance, `SolveError` where the path stops and `throw` is set.

    >>> import critflow as cf
    >>> network = cf.voronoi_network(n_vertices=20, seed=1)
    >>> path = cf.strain_path(cf.optimize(network, 'B_0'), [0.001, 0.002]).value
    >>> path.bulk_modulus.round(6)
    array([0.296637, 0.296489])
    """
    of_kind(SpringLaw, None, law=law)
    of_kind(bool, taut_only=taut_only, throw=throw)
    first, options = start_of(start, law, taut_only), of_kind(PathSolver, None, solver=solver) or PathSolver()
    gamma, method = check_strains(strains, signed=True, zero=first.stress is None), relaxation_method(options.method)
    path = deformation_of(deformation, first.springs.network.dimension)
    if not isinstance(measure, str) or measure not in MEASURES:
        raise InputError(f"a path measures one of {', '.join(MEASURES)}, not {shown(measure)}")
    springs, network = first.springs, first.springs.network
    pattern = (None if first.part else options.pattern) or first.pattern or springs.pattern()
    unknowns = unknowns_of(springs, path, gamma, pattern, method, options.tolerance)
    has_moduli = measure != "energy" and network.has_volume and network.dimension > 1
    problem = PathProblem(network, path, pattern, unknowns, method == "newton", measure, has_moduli)
    result = _solution(problem, method, gamma, _follow(problem, first, gamma), first)
    return result.or_raise("the strain path stopped") if throw else result


def _follow(problem: PathProblem, first: Beginning, gamma: Array) -> list[Interval]:
    """Advance from strain to strain; the last entry alone may have failed."""
    reached, point = problem.unknowns.beginning(problem, first, gamma)
    for strain in counted(gamma[len(reached) :].tolist(), "strain"):
        if reached and not reached[-1].end.ok:
            break
        reached.append(advance(problem, point, strain))
        point = reached[-1].point
    return reached


def _solution(
    problem: PathProblem, method: str, gamma: Array, reached: list[Interval], first: Beginning
) -> Solution[StrainPath]:
    """The path up to the last strain that was reached, with the status of the last step."""
    path, last = _assembled(problem, gamma, reached, first), reached[-1]
    stats = Stats(
        method,
        int(path.steps.sum()),
        residual=float(np.max(path.max_force[: len(path.states)], initial=0.0)),
        error_bound=float(np.nanmax(path.coordinate_error[: len(path.states)], initial=0.0)),
    )
    note = first.note if last.end.ok else f"at strain {last.target:g}, {last.end.note}"
    return Solution(path, last.end.status, stats, note)


def _assembled(problem: PathProblem, gamma: Array, reached: list[Interval], first: Beginning) -> StrainPath:
    """The path of all strains, of which only the last one tried may have failed."""
    n, d, m = len(gamma), problem.deformation.dimension, len(problem.deformation.free)
    ends = [interval.end for interval in reached if interval.end.ok]
    measured = {name: np.full(n, np.nan) for name in _SCALARS}
    measured |= {"stress": np.full((n, d, d), np.nan), "free_components": np.full((n, m), np.nan)}
    if ends:
        rows = [_measurements(end) for end in ends]
        for name, missing in measured.items():
            measured[name] = np.concatenate([[row[name] for row in rows], missing[len(ends) :]])
    steps, inserted, status = (np.full(n, value) for value in (0, 0, int(Status.missing)))
    steps[: len(reached)] = [interval.iterations for interval in reached]
    inserted[: len(reached)] = [interval.inserted for interval in reached]
    status[: len(reached)] = [interval.end.status for interval in reached]
    return StrainPath(
        strains=gamma,
        steps=steps,
        status=status,
        inserted=inserted,
        states=tuple(end.state for end in ends),
        deformation=problem.deformation,
        total_strains=gamma if first.total_strains is None else first.total_strains(problem.deformation, gamma),
        elasticity=tuple(end.moduli for end in ends if end.moduli and problem.measure == "tensors"),
        **measured,
    )


_SCALARS = (
    *("bulk_modulus", "shear_modulus", "shear_modulus_stress_corrected", "bulk_modulus_error", "shear_modulus_error"),
    *("energy", "max_force", "coordinate_error", "modulus", "modulus_error"),
)


def _measurements(end: Attempt) -> dict[str, float | Array]:
    """What `StrainPath` has of one state: floats `_SCALARS`, the stress (d, d) and q (m,); NaN where not measured."""
    state, along, moduli = end.state, end.tangent, end.moduli
    # V of the cell or as named, or 1 without either.
    volume = state.network.volume if state.network.has_volume else 1.0
    row: dict[str, float | Array] = dict.fromkeys(_SCALARS, np.nan)
    row |= {"energy": state.energy, "max_force": state.max_force, "coordinate_error": end.coordinate_error}
    if along is not None:
        row |= {"modulus": along.second / volume, "modulus_error": along.second_error / volume}
    if moduli is None:
        L = state.bond_vectors
        stress = L.T @ (state.sigma[:, None] * L) / volume
    else:
        stress, shear, corrected = moduli.stress, moduli.errors.shear, moduli.errors.shear_stress_corrected
        row |= {"bulk_modulus": moduli.bulk, "bulk_modulus_error": moduli.errors.bulk}
        row |= {"shear_modulus": moduli.shear, "shear_modulus_error": max(shear, corrected)}
        row["shear_modulus_stress_corrected"] = moduli.shear_stress_corrected
    return row | {"stress": stress, "free_components": end.cell.free}
