"""The strain path: a critical configuration expanded step by step past the transition, each step from the last state.

Rest lengths are the lengths at the transition, ℓ = |L(0)|; volumes follow V(γ) = V(0)(1 + γ) (`RestLengthVolumetric`).
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from critflow.critical.manifold import CriticalConfiguration
from critflow.linalg.factor import FixedPattern
from critflow.mechanics.equilibrium import Equilibrium, relaxation_method, relaxed
from critflow.mechanics.laws import HOOKEAN, SpringLaw, checked_law
from critflow.mechanics.moduli import NO_MODULI, Moduli, linear_response
from critflow.mechanics.springs import SpringState
from critflow.mechanics.tolerances import DOUBTED_DISTANCE, EXPECTED_DISTANCE, EXPECTED_STEPS, RETURN_DISTANCE
from critflow.networks.network import Array, Network
from critflow.result import InputError, Solution, Stats, Status

# Part of the strain interval below which a step is not divided further.
_SMALLEST_PART = 2.0**-16
# A step that covers this part of the remaining interval ends at the requested strain, not a rounding next to it.
_WHOLE = 0.999
# Beyond this number of previous steps ahead a polynomial extrapolates worse than a straight line.
_FARTHEST = 2

_JUMPED = "the equilibrium jumps to another branch: the one followed ends before this strain"


@dataclass(frozen=True, eq=False)
class StrainPath:
    """Equilibria at strains γ (n,): moduli, energy and forces (n,), work and status of each step, the states.

    From the first strain that is not reached, values are NaN and `status` holds the reason.

    inserted  steps (n,) to intermediate strains, which are not stored
    coordinate_error, bulk_modulus_error, shear_modulus_error  bounds (n,) on the errors against the exact equilibrium;
    the last one for both conventions.  Error bounds (estimate): those of `equilibrium` and `linear_response`
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


def check_strains(strains: ArrayLike) -> Array:
    """Strains as an increasing array of positive numbers, else an `InputError`."""
    gamma = np.atleast_1d(np.asarray(strains, dtype=float))
    if gamma.ndim != 1 or len(gamma) == 0:
        raise InputError("the list of strains is empty: give at least one, such as 0.001")
    if not (np.isfinite(gamma).all() and gamma[0] > 0 and (np.diff(gamma) > 0).all()):
        raise InputError("strains must be finite, positive and increasing, such as 0.001:0.010:0.001")
    return gamma


def strain_path(
    network: Network,
    critical: CriticalConfiguration,
    strains: ArrayLike,
    method: str = "auto",
    *,
    law: SpringLaw = HOOKEAN,
    tolerance: float = 1e-14,
    moduli: bool = True,
    pattern: FixedPattern | None = None,
    throw: bool = True,
) -> Solution[StrainPath]:
    """Expand a critical configuration of a network through increasing strains γ > 0, relaxing and measuring at each.

    Each step starts from the last state, extrapolated by the last two states and their linear responses.  A step that
    fails, or may have left its branch of equilibria, is halved, down to 2⁻¹⁶ of the strain interval, and steps grow
    again after that; where even the smallest leaves the branch the path ends with `Status.unstable`.  An equilibrium
    of a convex law without compressed springs is unique and the global minimum, so its branch is not checked.

    method, tolerance  those of `equilibrium`
    moduli             False: equilibria only
    pattern            of the Hessian, made here by default; given for many paths of one network

    Many parameters: those after the strains are options of the relaxation, most by keyword only.

    Raises `InputError` for strains that do not increase or a configuration of another network, `SolveError` where the
    path stops and `throw` is set.
    """
    gamma, method = check_strains(strains), relaxation_method(method)
    network = critical.springs_of(network)
    law = checked_law(law, critical.lengths, network.stiffness)
    state = SpringState(network, critical.lengths, critical.coordinates, critical.bond_vectors, law)
    continuation = _Continuation(state, method, tolerance, moduli, pattern or state.pattern())
    reached: list[_Arrival] = []
    for strain in gamma:
        reached.append(continuation.advance(strain))
        if not reached[-1].end.ok:
            break
    path, last = _assembled(gamma, reached), reached[-1].end
    stats = Stats(
        method,
        int(path.steps.sum()),
        residual=float(np.max(path.max_force[: len(path.states)], initial=0.0)),
        error_bound=float(np.max(path.coordinate_error[: len(path.states)], initial=0.0)),
    )
    note = "" if last.ok else f"at strain {gamma[len(reached) - 1]:g}, {last.note}"
    result = Solution(path, last.status, stats, note)
    return result.or_raise("the strain path stopped") if throw else result


@dataclass(frozen=True, eq=False)
class _Step:
    """End of one step, from which the continuation proceeds if it is accepted.

    curable   a smaller step may succeed where this one failed
    velocity  dy/dγ (n_free, d) of the coordinates y that move with the cell; None where it was not computed
    moduli, moduli_error, coordinate_error  measured at the end, with error bounds
    """

    strain: float
    state: SpringState
    iterations: int
    status: Status = Status.ok
    note: str = ""
    curable: bool = True
    velocity: Array | None = None
    moduli: Moduli = NO_MODULI
    moduli_error: Moduli = NO_MODULI
    coordinate_error: float = np.nan

    @property
    def ok(self) -> bool:
        return self.status is Status.ok


@dataclass(frozen=True, eq=False)
class _Arrival:
    """The last step towards one strain, the iterations of all steps to it, and the accepted ones before the last."""

    end: _Step
    iterations: int
    inserted: int


def _assembled(gamma: Array, arrivals: list[_Arrival]) -> StrainPath:
    """The path of all arrivals, of which only the last may have failed."""
    records = np.full((8, len(gamma)), np.nan)
    steps, inserted = np.zeros(len(gamma), int), np.zeros(len(gamma), int)
    statuses = np.full(len(gamma), int(Status.missing))
    states = []
    for n, arrival in enumerate(arrivals):
        end = arrival.end
        steps[n], inserted[n], statuses[n] = arrival.iterations, arrival.inserted, end.status
        if end.ok:
            value, error = end.moduli, end.moduli_error
            records[:5, n] = (
                *(value.bulk, value.shear, value.shear_stress_corrected),
                *(end.state.energy, end.state.max_force),
            )
            records[5:, n] = end.coordinate_error, error.bulk, max(error.shear, error.shear_stress_corrected)
            states.append(end.state)
    bulk, shear, corrected, energy, force, *errors = records
    return StrainPath(gamma, bulk, shear, corrected, energy, force, steps, statuses, tuple(states), inserted, *errors)


@dataclass(eq=False)
class _Continuation:
    """Numerical continuation in strain: the last accepted state, the predictor and the length of the next step."""

    state: SpringState
    method: str
    tolerance: float
    with_moduli: bool
    pattern: FixedPattern
    strain: float = 0.0
    stride: float = np.inf
    predictor: _Predictor = field(init=False)

    def __post_init__(self) -> None:
        self.predictor = _Predictor(self.state.coordinates[self.state.network.free])

    def advance(self, strain: float) -> _Arrival:
        """Proceed to a strain by steps that halve after failures and double after successes."""
        whole = strain - self.strain
        self.stride = max(self.stride, _SMALLEST_PART * whole)
        iterations = inserted = 0
        while True:
            left = strain - self.strain
            ahead = min(self.stride, left)
            target = strain if ahead >= _WHOLE * left else self.strain + ahead
            step = self._step(target)
            iterations += step.iterations
            if step.ok:
                self._accept(step)
                if target == strain:
                    self.stride *= 2 if ahead == self.stride else 1
                    break
                inserted += 1
                self.stride = 2 * ahead
            elif step.curable and 0.5 * ahead >= _SMALLEST_PART * whole:
                self.stride = 0.5 * ahead
            else:
                break
        return _Arrival(step, iterations, inserted)

    def _step(self, strain: float) -> _Step:
        """One step to a strain, which leaves the continuation unchanged."""
        start = self._predicted(strain)
        solution, factor = relaxed(start, self.pattern, self.method, self.tolerance)
        state, n = solution.value, solution.stats.steps
        if not solution.ok:
            # FIRE at its step limit gains nothing from smaller strain steps.
            curable = self.method != "fire" or solution.status is not Status.step_limit
            return _Step(strain, state, n, solution.status, solution.reason, curable)
        unique = _unique(state)
        if not (unique or self._expected(start, solution)):
            return _Step(strain, state, n, Status.unstable, _JUMPED)
        moduli, errors, velocity = NO_MODULI, NO_MODULI, None
        if self.with_moduli:
            response = linear_response(state, self.pattern, self.method == "newton", factor)
            if not response.ok:
                return _Step(strain, state, n, response.status, response.reason)
            moduli, errors = response.value, response.stats.error_bound
            velocity = response.relaxation / ((1 + strain) * self._size(strain))
        if not (unique or self._returns(start, state, strain, velocity)):
            return _Step(strain, state, n, Status.unstable, _JUMPED)
        return _Step(
            strain,
            state,
            n,
            velocity=velocity,
            moduli=moduli,
            moduli_error=errors,
            coordinate_error=solution.stats.error_bound,
        )

    def _accept(self, step: _Step) -> None:
        self.strain, self.state = step.strain, step.state
        y = step.state.coordinates[step.state.network.free] / self._size(step.strain)
        self.predictor.add(step.strain, y, step.velocity)

    def _size(self, strain: float) -> float:
        """Linear size of the cell relative to the transition, (1 + γ)^{1/d}."""
        return float((1 + strain) ** (1 / self.state.network.dimension))

    def _predicted(self, strain: float) -> SpringState:
        """The last state moved to a strain affinely and by the predictor."""
        start = self.state.moved(self._size(self.strain) * self.predictor.displacement(strain))
        return _dilated(start, (1 + strain) / (1 + self.strain))

    def _expected(self, start: SpringState, solution: Equilibrium[SpringState]) -> bool:
        """Whether the relaxation ended near its prediction, after few steps and no indefinite Hessian."""
        few = self.method != "newton" or solution.stats.steps <= EXPECTED_STEPS
        return few and not solution.indefinite and _distance(start, solution.value) <= EXPECTED_DISTANCE

    def _returns(self, start: SpringState, state: SpringState, strain: float, velocity: Array | None) -> bool:
        """Whether the step back ends at the last state, which it does not from beyond a fold."""
        if self.strain == 0.0 or _distance(start, state) <= DOUBTED_DISTANCE:
            return True
        if velocity is not None:
            state = state.moved(self._size(strain) * (self.strain - strain) * velocity)
        back = _dilated(state, (1 + self.strain) / (1 + strain))
        solution, _ = relaxed(back, self.pattern, self.method, self.tolerance)
        return solution.ok and _distance(solution.value, self.state) <= RETURN_DISTANCE


def _dilated(state: SpringState, growth: float) -> SpringState:
    """The state after an affine dilation of its volume by a factor."""
    d = state.network.dimension
    return state.deformed(growth ** (1 / d) * np.eye(d))


def _unique(state: SpringState) -> bool:
    """Whether the state is certainly the global minimum, and so on the branch formed by all taut states.

    Replace each spring by a cable of the same law with zero energy below ℓ: the energy is then convex and nowhere above
    that of the springs.  A taut equilibrium is its minimum, where both energies are equal.
    """
    return state.law.convex and bool((state.extension >= 0).all())


def _distance(one: SpringState, other: SpringState) -> float:
    """The largest difference of two states' bond vectors, in units of the mean length."""
    return float(np.abs(one.bond_vectors - other.bond_vectors).max() / one.lengths.mean())


class _Predictor:
    """Extrapolates the path y(γ) of the free vertices, in coordinates that move with the cell."""

    def __init__(self, start: Array):
        self._points: list[tuple[float, Array, Array | None]] = [(0.0, start, None)]

    def add(self, strain: float, y: Array, velocity: Array | None) -> None:
        """Add a point of the path (n_free, d) with its velocity dy/dγ; the last two are kept."""
        self._points = [*self._points[-1:], (strain, y, velocity)]

    def displacement(self, strain: float) -> Array:
        """Extrapolated change of y from the last point: Hermite polynomial of the last points, up to third order."""
        last, y, velocity = self._points[-1]
        if velocity is None:
            return np.zeros_like(y)
        ahead = strain - last
        earlier, y_earlier, velocity_earlier = self._points[0]
        behind = last - earlier
        if ahead > _FARTHEST * behind:
            return velocity * ahead
        # y(last − t) = y − velocity t + a t² − b t³ with y and, if known, the velocity of the earlier point.
        second = (y_earlier - y + velocity * behind) / behind**2
        if velocity_earlier is None:
            return velocity * ahead + second * ahead**2
        change = (velocity - velocity_earlier) / behind
        third = (change - 2 * second) / behind
        return velocity * ahead + (second + third * behind) * ahead**2 + third * ahead**3
