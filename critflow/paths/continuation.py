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

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple, Protocol

import numpy as np
from scipy.linalg.lapack import dgesv

from critflow.linalg.factor import Factor, FixedPattern
from critflow.linalg.tolerances import EPS
from critflow.linalg.vectors import largest, mean
from critflow.networks.deformation import Deformation
from critflow.networks.network import Array, Network
from critflow.paths.start import Beginning
from critflow.paths.tangent import Predictor, Tangent, tangent_of_response, tangent_of_springs
from critflow.response.linear_response import linear_response, strains_of
from critflow.response.tensor import Elasticity
from critflow.result import Status
from critflow.springs.equilibrium import Equilibrium
from critflow.springs.minimum import ROUNDING_COMPRESSION
from critflow.springs.newton import FLOPPY_SHIFT
from critflow.springs.state import SpringState

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
