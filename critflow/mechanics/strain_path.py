"""The strain path: a critical configuration expanded step by step past the transition, each step from the last.

Rest lengths are the lengths at the transition, ℓ = |L(0)|; volumes follow V(γ) = V(0)(1 + γ) (`RestLengthVolumetric`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from critflow.critical.manifold import CriticalConfiguration
from critflow.linalg.factor import FixedPattern
from critflow.mechanics.equilibrium import relaxation_method, relaxed
from critflow.mechanics.laws import CONVEX_LAWS, HOOKEAN, SpringLaw, checked_law
from critflow.mechanics.moduli import Moduli, linear_response
from critflow.mechanics.springs import SpringState
from critflow.networks.network import Array, Network
from critflow.result import InputError, Solution, Stats, Status

# The part of a step below which it is not divided any more.
_SMALLEST_PART = 2.0**-16
# A step that may have left its branch is believed if it took no more than so many iterations and ended no further from
# where the branch was expected, in units of the mean length.
_FEW_STEPS, _EXPECTED = 10, 0.05
# Ends further away than this are believed if a step back leads to where the step came from, to the second of the two.
_DOUBTED, _RETURNED = 1e-3, 1e-6


@dataclass(frozen=True, eq=False)
class StrainPath:
    """Equilibria at strains γ (n,): moduli, energy and forces (n,), work and status of each step, the last state.

    A step that failed and all after it hold NaN and say so in `status`.

    inserted  steps (n,) to strains in between, which are not kept, on the way to each strain
    coordinate_error, bulk_modulus_error, shear_modulus_error  bounds (n,) on the errors against the exact equilibrium;
    that of the shear modulus holds for both conventions
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

    Each step starts from the last state, carried on affinely and along the curve that the last two states and their
    linear responses trace.  A step that fails, or may have left the branch of equilibria that it started on, is
    halved, down to 2⁻¹⁶ of itself, and steps grow again after that; where even the smallest leaves the branch the
    path ends with `Status.unstable`.  An equilibrium without compressed springs needs no such doubt: it is the only
    one of its kind, and the global minimum.  `method` and `tolerance` are those of `equilibrium`; without `moduli`
    only the equilibria are found.
    """
    gamma, method = check_strains(strains), relaxation_method(method)
    network = critical.springs_of(network)
    law = checked_law(law, critical.lengths, network.stiffness)
    state = SpringState(network, critical.lengths, critical.coordinates, critical.bond_vectors, law)
    walk = _Walk(state, method, tolerance, moduli, pattern or state.pattern())
    records = np.full((8, len(gamma)), np.nan)
    steps, inserted = np.zeros(len(gamma), int), np.zeros(len(gamma), int)
    statuses = np.full(len(gamma), int(Status.missing))
    states: list[SpringState] = []
    why, stride = "", np.inf
    for n, strain in enumerate(gamma):
        whole = strain - walk.strain
        stride = max(stride, _SMALLEST_PART * whole)
        while True:
            ahead = min(stride, strain - walk.strain)
            # The last of several steps ends at the strain itself, and not a rounding beside it.
            target = strain if ahead >= 0.999 * (strain - walk.strain) else walk.strain + ahead
            attempt = walk.attempt(target)
            steps[n] += attempt.iterations
            if attempt.status is Status.ok:
                walk.accept(attempt)
                if target == strain:
                    stride = 2 * stride if ahead == stride else stride
                    break
                inserted[n] += 1
                stride = 2 * ahead
            elif attempt.curable and 0.5 * ahead >= _SMALLEST_PART * whole:
                stride = 0.5 * ahead
            else:
                break
        statuses[n] = attempt.status
        if attempt.status is not Status.ok:
            why = attempt.why
            break
        records[:, n] = attempt.record
        states.append(walk.state)
    bad = np.flatnonzero(statuses != Status.ok)
    status = Status(int(statuses[bad[0]])) if len(bad) else Status.ok
    bulk, shear, corrected, energy, force, *errors = records
    walked = (steps, statuses, tuple(states), inserted)
    path = StrainPath(gamma, bulk, shear, corrected, energy, force, *walked, *errors)
    details = {"note": f"at strain {gamma[bad[0]]:g}, {why}"} if len(bad) else {}
    worst = float(np.max(path.max_force[: len(states)], initial=0.0))
    bound = float(np.max(path.coordinate_error[: len(states)], initial=0.0))
    result = Solution(path, status, Stats(method, int(steps.sum()), residual=worst, details=details, error_bound=bound))
    return result.or_raise("the strain path stopped") if throw else result


_JUMPED = "the equilibrium jumps to another branch: the one followed ends before this strain"
_NOTHING = Moduli(np.nan, np.nan, np.nan)


@dataclass(frozen=True, eq=False)
class _Attempt:
    """Where a step ended.  curable: a smaller step may do better."""

    strain: float
    state: SpringState
    iterations: int
    status: Status
    why: str = ""
    curable: bool = True
    slope: Array | None = None
    record: tuple[float, ...] = ()


class _Walk:
    """The last state of a path and the way that led to it."""

    def __init__(self, state: SpringState, method: str, tolerance: float, moduli: bool, pattern: FixedPattern):
        self.strain, self.state = 0.0, state
        self._method, self._tolerance, self._moduli, self._pattern = method, tolerance, moduli, pattern
        self._trace = _Trace(state.coordinates[state.network.free])

    def _size(self, strain: float) -> float:
        return float((1 + strain) ** (1 / self.state.network.dimension))

    def attempt(self, strain: float) -> _Attempt:
        """One step to a strain; the walk stays where it is."""
        growth = (1 + strain) / (1 + self.strain)
        start = self.state.moved(self._size(self.strain) * self._trace.step_to(strain))
        start = start.deformed(growth ** (1 / start.network.dimension) * np.eye(start.network.dimension))
        solution, factor = relaxed(start, self._pattern, self._method, self._tolerance)
        state, stats, status = solution.value, solution.stats, solution.status
        if not solution.ok:
            # FIRE takes many small steps as it is.
            curable = self._method != "fire" or status is not Status.step_limit
            why = solution.reason
            return _Attempt(strain, state, stats.steps, status, why, curable)
        if not (self._only_one(state) or self._expected(start, state, stats)):
            return _Attempt(strain, state, stats.steps, Status.unstable, _JUMPED)
        measured, bounds, slope = _NOTHING, _NOTHING, None
        if self._moduli:
            response, relaxation = linear_response(state, self._pattern, self._method == "newton", factor)
            if not response.ok:
                why = response.reason
                return _Attempt(strain, state, stats.steps, response.status, why)
            measured, bounds = response.value, response.stats.error_bound
            slope = relaxation / ((1 + strain) * self._size(strain))
        if not (self._only_one(state) or self._returns(start, state, strain, slope)):
            return _Attempt(strain, state, stats.steps, Status.unstable, _JUMPED)
        values = (measured.bulk, measured.shear, measured.shear_stress_corrected, state.energy, state.max_force)
        errors = (stats.error_bound, bounds.bulk, max(bounds.shear, bounds.shear_stress_corrected))
        return _Attempt(strain, state, stats.steps, Status.ok, "", True, slope, (*values, *errors))

    def accept(self, attempt: _Attempt) -> None:
        """Go on from there."""
        self.strain, self.state = attempt.strain, attempt.state
        y = attempt.state.coordinates[attempt.state.network.free] / self._size(attempt.strain)
        self._trace.add(attempt.strain, y, attempt.slope)

    def _only_one(self, state: SpringState) -> bool:
        """Whether the state is certainly the global minimum, and so on the branch that all taut states form.

        Replace each spring by a cable of the same law, which does nothing below ℓ: a convex energy that is nowhere
        above that of springs.  A taut equilibrium is its minimum, where both energies are equal.
        """
        return type(state.law) in CONVEX_LAWS and bool((state.extension >= 0).all())

    def _expected(self, start: SpringState, state: SpringState, stats: Stats) -> bool:
        """Whether the relaxation led nowhere unexpected."""
        few = self._method != "newton" or stats.steps <= _FEW_STEPS
        return few and not stats.details.get("indefinite", False) and _apart(start, state) <= _EXPECTED

    def _returns(self, start: SpringState, state: SpringState, strain: float, slope: Array | None) -> bool:
        """Whether the way back leads to the last state, as it does not from beyond a fold."""
        if self.strain == 0.0 or _apart(start, state) <= _DOUBTED:
            return True
        d = state.network.dimension
        growth = ((1 + self.strain) / (1 + strain)) ** (1 / d)
        if slope is not None:
            state = state.moved(self._size(strain) * (self.strain - strain) * slope)
        back, _ = relaxed(state.deformed(growth * np.eye(d)), self._pattern, self._method, self._tolerance)
        return back.ok and _apart(back.value, self.state) <= _RETURNED


def _apart(one: SpringState, other: SpringState) -> float:
    """The largest difference of their bond vectors, in units of the mean length."""
    return float(np.abs(one.bond_vectors - other.bond_vectors).max() / one.lengths.mean())


class _Trace:
    """The path of the free vertices in coordinates that move with the box, y(γ), and its slopes: where it goes next."""

    def __init__(self, start: Array):
        self._points: list[tuple[float, Array, Array | None]] = [(0.0, start, None)]

    def add(self, strain: float, y: Array, slope: Array | None) -> None:
        self._points = [*self._points[-1:], (strain, y, slope)]

    def step_to(self, strain: float) -> Array:
        """Extrapolated change of y from the last point: the polynomial through what is known, up to third order."""
        last, y, slope = self._points[-1]
        if slope is None:
            return np.zeros_like(y)
        ahead = strain - last
        earlier, y_earlier, slope_earlier = self._points[0]
        behind = last - earlier
        # Far beyond the two points a polynomial is worse than a straight line.
        if ahead > 2 * behind:
            return slope * ahead
        # y(last − t) = y − slope t + a t² − b t³ with y and, if known, the slope of the earlier point.
        bend = (y_earlier - y + slope * behind) / behind**2
        if slope_earlier is None:
            return slope * ahead + bend * ahead**2
        turn = (slope - slope_earlier) / behind
        b = (turn - 2 * bend) / behind
        return slope * ahead + (bend + b * behind) * ahead**2 + b * ahead**3
