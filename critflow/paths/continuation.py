"""Numerical continuation of equilibria in strain: predictor, corrector, and checks that the branch is not left.

An equilibrium at strain γ has vertices x = (1 + Σ q E) F(γ) y with coordinates y that move with the cell and free
components q of the cell.  A path is a curve z(γ) = (y, q).  One step from γ to γ + δ (`attempt`):

1. Predict z(γ + δ) by a Hermite polynomial through the last points and their velocities (`Predictor`); floppy vertices
   among slack cables are placed where none of these is tight (`slack`).
2. Correct it by Newton's method, H u = f, or FIRE: forces on vertices and stresses conjugate to q vanish.
3. Without compressed springs, or for cables of a convex law, the equilibrium is the global minimum and lies on the
   branch of taut states (`SpringState.unique`).  Otherwise the step is refused where the correction took many
   iterations, met an indefinite Hessian, or ended far from the prediction (`_expected`).
4. Compute moduli and the velocity dz/dγ from the factor of the Hessian, H u = −∂²E/∂x∂γ.
5. Where the branch is still in doubt take the step back, by that velocity: beyond a fold it does not end at the last
   point (`_returns`).

From one strain to the next (`step`, with the loop in `advance`):

6. An accepted step becomes the last point and the stride doubles.
7. A refused step is halved.  The path ends where a stride is below 2⁻¹⁶ of the distance between the strains, with the
   reason of the longest step that failed: shorter ones may fail by rounding alone.

The velocity at a transition is the limit of that under a stress η σ as η → 0 (`_departing`).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from critflow.extras.cables.slack import with_slack_placed
from critflow.extras.rest.free_cell import FreeCellState, relaxed_with_cell, stretched
from critflow.linalg.factor import Factor, FixedPattern
from critflow.linalg.tolerances import EPS
from critflow.networks.deformation import Deformation
from critflow.networks.network import Array, Network
from critflow.paths.predictor import Predictor
from critflow.paths.tangent import Tangent, path_rates, relaxations_to, tangent, tangent_of_response
from critflow.response.linear_response import linear_response, strains_of
from critflow.response.tensor import Elasticity
from critflow.result import Status
from critflow.springs.equilibrium import LOOSEST_TOLERANCE, Equilibrium, relaxed
from critflow.springs.laws import HOOKEAN
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
# Stress over the strain, in units of k, below which a state may have none: a strain that is resisted causes one of
# order one, and forces balanced to 1e-14 leave up to 1e-9 where stresses are nearly balanced by themselves.
WEAK = 1e-6

# Part of the strain interval below which a step is not divided further.
_SMALLEST_PART = 2.0**-16
# Steps, and their iterations, towards one strain: no path within them needed more than a tenth.
_MOST_STEPS, _MOST_ITERATIONS = 400, 4000
# Stress η, in units of k, that stands for the limit of no stress: its effect is of this order, and rounding of 1e-10.
_DEPARTING_STRESS = 1e-6
# A step that covers this part of the remaining interval ends at the requested strain, not a rounding next to it.
_WHOLE = 0.999

_LIMIT = "the steps became too short to arrive: give strains that are closer together, or another method"
_UNRESOLVED = "this strain and the one before it give the same cell in floating-point numbers: choose larger ones"
_FLOPPY = "springs keep all lengths at strain {:.3g}, so nothing resists: fix the free components of the cell"
_JUMPED = "the equilibrium jumps to another branch: the one followed ends before this strain"


@dataclass(frozen=True, eq=False)
class Course:
    """What stays the same along a path: the network at γ = 0, the deformation, and the options of `strain_path`.

    gradients  F(γ) (d, d) of the strains so far
    """

    reference: Network
    deformation: Deformation
    method: str
    tolerance: float
    measure: str
    pattern: FixedPattern
    gradients: dict[float, Array] = field(default_factory=dict)

    @cached_property
    def free_strains(self) -> Array:
        """E (m, d, d) of the free components of the cell."""
        return self.deformation.free_strains

    @cached_property
    def has_moduli(self) -> bool:
        """Whether moduli are asked for and defined."""
        return self.measure != "energy" and self.reference.has_volume and self.reference.dimension > 1

    def cell(self, strain: float, stretch: Array) -> Cell:
        """The cell at a strain with free components q (m,)."""
        F = self.gradients.get(strain)
        if F is None:
            F = self.gradients[strain] = self.deformation.gradient(strain)
        return Cell(strain, F, stretch, self.free_strains)

    def moved(self, springs: SpringState, here: Cell, there: Cell, change: Array) -> SpringState:
        """Springs in one cell after a change of y (n_free·d,) and the affine motion to another."""
        before, after = here.gradient, there.gradient
        springs = springs.moved(change.reshape(-1, len(before)) @ before.T)
        return springs.deformed_to(self.reference.deformed(after), after @ here.inverse)

    def relaxed(self, start: SpringState, cell: Cell) -> tuple[Equilibrium[SpringState], Factor | None, Cell]:
        """The equilibrium from a prediction, a factor of the Hessian near it, and its cell."""
        if len(cell.stretch):
            free = FreeCellState(start, cell.stretch, cell.free_strains)
            solution, factor, q = relaxed_with_cell(free, self.reference, cell.affine, self.pattern, self.tolerance)
            return solution, factor, replace(cell, stretch=q)
        # Predictions are within reach of the last correction of Newton's method, but for cables, which tighten.
        exact = self.method == "newton" and not start.law.one_sided
        tolerance = LOOSEST_TOLERANCE if exact else self.tolerance
        solution, factor = relaxed(start, self.pattern, self.method, tolerance, condition=False)
        if not solution.ok and start.law.one_sided:
            # On the kinks of cables that are just tight corrections do not converge.
            placed = with_slack_placed(solution.value, solution.value.sigma)
            if placed is not solution.value:
                steps = solution.stats.steps
                solution, factor = relaxed(placed, self.pattern, self.method, tolerance, condition=False)
                solution = replace(solution, stats=replace(solution.stats, steps=steps + solution.stats.steps))
        return solution, factor, cell

    def rates(self, cell: Cell) -> tuple[Array, Array]:
        """Rates of the strain and of the free components, and second derivatives (`path_rates`)."""
        return path_rates(self.deformation, cell.strain, cell.affine, cell.stretch)

    def tangent(self, springs: SpringState, rates: tuple[Array, Array], factor: Factor | None) -> Tangent | None:
        """The tangent of the path from a factor near the springs; None where it is not determined."""
        if factor is None:
            factor = springs.factorize(self.pattern)
            if factor.indefinite:
                factor = springs.factorize(self.pattern, FLOPPY_SHIFT * springs.stiffness_scale)
        relaxations = relaxations_to(springs, factor, rates[0])
        return None if relaxations is None else tangent(springs, *rates, relaxations)


@dataclass(frozen=True, eq=False)
class Cell:
    """The cell (1 + Σ q E) F(γ) at one point of a path.

    affine        F(γ), (d, d)
    stretch       q (m,)
    free_strains  E (m, d, d)
    """

    strain: float
    affine: Array
    stretch: Array
    free_strains: Array

    @cached_property
    def gradient(self) -> Array:
        """(1 + Σ q E) F(γ), (d, d)."""
        return stretched(self.stretch, self.free_strains) @ self.affine if len(self.stretch) else self.affine

    @cached_property
    def inverse(self) -> Array:
        """F⁻¹ (1 + Σ q E)⁻¹, (d, d)."""
        return np.asarray(np.linalg.inv(self.gradient))

    def point(self, springs: SpringState) -> Array:
        """z = (y, q) of springs in this cell, (n_free·d + m,)."""
        y = springs.coordinates[springs.network.free_rows] @ self.inverse.T
        return np.concatenate([y.ravel(), self.stretch])

    def velocity(self, along: Tangent) -> Array:
        """dz/dγ of a tangent, (n_free·d + m,)."""
        y = along.relaxation @ self.inverse.T
        return np.concatenate([y.ravel(), along.stretch_rate])

    def changed(self, change: Array) -> Cell:
        """The cell after a change of q, unless that inverts it."""
        if not len(change):
            return self
        q = self.stretch + change
        return replace(self, stretch=q) if np.linalg.det(stretched(q, self.free_strains)) > 0 else self


@dataclass(frozen=True, eq=False)
class Step:
    """End of one step, from which the continuation proceeds if it is accepted.

    predicted  changes of z that were extrapolated, of which one began the correction
    curable    a smaller step may succeed where this one failed
    velocity   dz/dγ; None where it was not computed
    tangent, moduli, coordinate_error  measured at the end; without tensors `moduli` has those of bulk and shear alone
    """

    cell: Cell
    state: SpringState
    predicted: Array
    iterations: int = 0
    status: Status = Status.ok
    note: str = ""
    curable: bool = True
    velocity: Array | None = None
    tangent: Tangent | None = None
    moduli: Elasticity | None = None
    coordinate_error: float = np.nan

    @property
    def ok(self) -> bool:
        return self.status is Status.ok

    def failed(self, status: Status, note: str) -> Step:
        """The same step, refused."""
        return replace(self, status=status, note=note)


@dataclass(frozen=True, eq=False)
class Point:
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
class Progress:
    """The way from one strain of a path to the next.

    point       last accepted point
    iterations  of all steps
    inserted    accepted steps before the one that ends
    end         the last step
    ended       whether the strain is reached, or given up
    failed      the longest step that failed since the last accepted one
    """

    point: Point
    target: float
    end: Step
    ended: bool = False
    smallest: float = 0.0
    iterations: int = 0
    inserted: int = 0
    failed: Step | None = None


def begin(course: Course, springs: SpringState, stress: Array | None, cell: Cell | None = None) -> Progress:
    """The first point of a path: a transition with its stress as it is, or springs relaxed at γ = 0.

    cell  of the transition, where that is not at γ = 0
    """
    cell = cell or course.cell(0.0, np.zeros(len(course.free_strains)))
    predictor = Predictor.at(cell.strain, cell.point(springs))
    point = Point(cell, springs, predictor, stress=stress)
    if stress is not None:
        return Progress(point, cell.strain, _unmoved(point), ended=True)
    # Free components of the cell may have stress here, and velocities are unknown.
    end = attempt(course, point, 0.0)
    if end.ok:
        predictor = Predictor.at(0.0, end.cell.point(end.state), end.velocity)
        point = Point(end.cell, end.state, predictor)
    return Progress(point, 0.0, end, ended=True, iterations=end.iterations)


def refused(point: Point, strain: float, status: Status, note: str) -> Progress:
    """The end of a path before a strain, without a step."""
    return Progress(point, strain, _unmoved(point).failed(status, note), ended=True)


def _unmoved(point: Point) -> Step:
    return Step(point.cell, point.state, np.zeros((1, 0)))


def advance(course: Course, point: Point, strain: float) -> Progress:
    """Proceed to a strain by steps that halve after failures and double after successes."""
    here = point.cell
    if (course.cell(strain, here.stretch).affine == here.affine).all():
        return refused(point, strain, Status.ill_conditioned, _UNRESOLVED)
    # F(γ) does not resolve smaller strains.
    smallest = max(_SMALLEST_PART * abs(strain - here.strain), EPS)
    if point.stress is not None:
        point = _departing(course, point, point.stress, strain)
    point = replace(point, stride=max(point.stride, smallest))
    progress = Progress(point, strain, _unmoved(point), smallest=smallest)
    for _ in range(_MOST_STEPS):
        progress = step(course, progress)
        if progress.ended:
            return progress
        if course.method == "newton" and progress.iterations > _MOST_ITERATIONS:
            break
    return replace(progress, end=progress.end.failed(Status.step_limit, _LIMIT))


def step(course: Course, progress: Progress) -> Progress:
    """One attempt towards the strain, and the point and stride that follow from it (steps 6 and 7)."""
    point, target = progress.point, progress.target
    left = target - point.cell.strain
    ahead = min(point.stride, abs(left))
    strain = target if ahead >= _WHOLE * abs(left) else point.cell.strain + np.copysign(ahead, left)
    end = attempt(course, point, strain)
    progress = replace(progress, end=end, iterations=progress.iterations + end.iterations)
    if end.ok:
        arrived = strain == target
        stride = 2 * ahead if not arrived or ahead == point.stride else point.stride
        predictor = point.predictor.extended(strain, end.cell.point(end.state), end.velocity, end.predicted)
        accepted = Point(end.cell, end.state, predictor, stride)
        inserted = progress.inserted + (not arrived)
        return replace(progress, point=accepted, ended=arrived, inserted=inserted, failed=None)
    failed = (progress.failed or end) if end.curable else end
    if not end.curable or 0.5 * ahead < progress.smallest:
        return replace(progress, end=failed, ended=True)
    return replace(progress, point=replace(point, stride=0.5 * ahead), failed=failed)


def attempt(course: Course, point: Point, strain: float) -> Step:
    """One step to a strain (steps 1 to 5 of the module)."""
    predicted = point.predictor.changes(strain)
    change = point.predictor.chosen(predicted)
    n = len(change) - len(point.cell.stretch)
    cell = course.cell(strain, point.cell.stretch).changed(change[n:])
    start = course.moved(point.state, point.cell, cell, change[:n])
    if start.law.one_sided:
        start = with_slack_placed(start, point.state.sigma if point.stress is None else point.stress)
    solution, factor, cell = course.relaxed(start, cell)
    end = Step(cell, solution.value, predicted, solution.stats.steps, coordinate_error=solution.stats.error_bound)
    if len(cell.stretch) and solution.status is Status.ill_conditioned and _weakly_stressed(end.state, strain):
        # Nearly balanced stresses remain that the tolerance of the forces hides, though all lengths can be kept.
        near = FreeCellState(end.state, cell.stretch, cell.free_strains).near_rest(course.pattern).springs
        if _keeps_lengths(near, strain):
            return replace(end.failed(Status.floppy, _FLOPPY.format(strain)), curable=False)
    if not solution.ok:
        # FIRE at its step limit gains nothing from smaller strain steps, nor do cables in a floppy cell: their energy
        # is convex.
        limited = course.method == "fire" and solution.status is Status.step_limit
        loose = solution.status is Status.floppy and end.state.unique
        return replace(end.failed(solution.status, solution.reason), curable=not (limited or loose))
    if _keeps_lengths(end.state, strain):
        return replace(end.failed(Status.floppy, _FLOPPY.format(strain)), curable=False)
    unique = end.state.unique
    if not (unique or _expected(course.method, start, solution)):
        return end.failed(Status.unstable, _JUMPED)
    end = _measured(course, end, factor)
    if end.ok and not (unique or _returns(course, point, start, end)):
        return end.failed(Status.unstable, _JUMPED)
    return end


def _measured(course: Course, end: Step, factor: Factor | None) -> Step:
    """The end of a step with moduli and velocity, or refused where its response is not determined."""
    springs, rates, moduli = end.state, course.rates(end.cell), None
    if not course.has_moduli:
        along = course.tangent(springs, rates, factor)
    else:
        exact, volume = course.method == "newton", springs.network.volume
        strains = None if course.measure == "tensors" else strains_of(rates[0])
        response = linear_response(springs, volume, course.pattern, exact, factor, condition=False, strains=strains)
        if not response.ok:
            return end.failed(response.status, response.reason)
        along = tangent_of_response(response, *rates)
        moduli = response.value
    return replace(
        end,
        moduli=moduli,
        velocity=None if along is None else end.cell.velocity(along),
        tangent=None if course.measure == "energy" else along,
    )


def _departing(course: Course, point: Point, stress: Array, strain: float) -> Point:
    """A transition with its velocity on the side of a strain, where it is determined.

    It is the limit of the velocity of the same configuration under a stress η σ as η → 0.
    """
    springs = point.state
    L, rates = springs.bond_vectors, course.rates(point.cell)
    sigma = springs.edge_tension(stress * springs.spring_lengths) / springs.lengths
    work = np.vdot(sigma[:, None] * L, L @ rates[0][0].T)
    stress = stress / springs.stiffness * np.copysign(1.0, work * (strain - point.cell.strain))
    tightened = springs.spring_lengths * (1 - _DEPARTING_STRESS * stress / np.abs(stress).max())
    # Slack edges of cables resist nothing.
    cables = springs.law.one_sided
    rest = np.where(stress != 0, tightened, springs.rest_lengths) if cables else tightened
    stressed = replace(springs, rest_lengths=rest, law=springs.law if cables else HOOKEAN)
    factor = stressed.factorize(course.pattern, FLOPPY_SHIFT * springs.stiffness_scale)
    # Where all edges are tense the stress resists all motions.
    definite = stressed.taut(0.0)
    along = course.tangent(stressed, rates, factor) if definite or not factor.indefinite else None
    if along is None:
        return point
    here = point.cell
    return replace(point, predictor=Predictor.at(here.strain, here.point(springs), here.velocity(along)))


def _expected(method: str, start: SpringState, solution: Equilibrium[SpringState]) -> bool:
    """Whether the relaxation ended near its prediction, after few steps and no indefinite Hessian."""
    few = method != "newton" or solution.stats.steps <= EXPECTED_STEPS
    return few and not solution.indefinite and _distance(start, solution.value) <= EXPECTED_DISTANCE


def _returns(course: Course, point: Point, start: SpringState, end: Step) -> bool:
    """Whether the step back ends at the last state, which it does not from beyond a fold."""
    here = point.cell
    # No step returns to a transition, where nothing is determined.
    away = point.stress is None and here.strain != end.cell.strain
    if not away or _distance(start, end.state) <= DOUBTED_DISTANCE:
        return True
    n = end.predicted.shape[1] - len(point.cell.stretch)
    velocity = np.zeros(end.predicted.shape[1]) if end.velocity is None else end.velocity
    back = (here.strain - end.cell.strain) * velocity
    cell = replace(here, stretch=end.cell.stretch).changed(back[n:])
    solution, _, _ = course.relaxed(course.moved(end.state, end.cell, cell, back[:n]), cell)
    return solution.ok and _distance(solution.value, point.state) <= RETURN_DISTANCE


def _keeps_lengths(state: SpringState, strain: float) -> bool:
    """Whether a strain causes no stress beyond rounding: all springs keep their lengths, by motions that none resists.

    Where they resist, a stress is of the order of the strain.
    """
    if strain == 0 or not _weakly_stressed(state, strain):
        return False
    unit, rounding = strain**2 * state.stiffness_scale, ROUNDING_COMPRESSION * state.stress_rounding
    least = np.maximum(UNSTRESSED * unit, np.where(rounding < WEAK * unit, rounding, 0.0))
    return bool((np.abs(state.sigma) <= least).all())


def _weakly_stressed(state: SpringState, strain: float) -> bool:
    """Whether the stress is far below that of a strain which the springs resist."""
    return bool(np.abs(state.sigma).max() <= WEAK * abs(strain) * state.stiffness_scale)


def _distance(one: SpringState, other: SpringState) -> float:
    """The largest difference of two states' bond vectors, in units of the mean length."""
    return float(np.abs(one.bond_vectors - other.bond_vectors).max() / one.lengths.mean())
