"""The strain path: a critical configuration expanded step by step past the transition, each step from the last.

Rest lengths are the lengths at the transition, ℓ = |L(0)|; volumes follow V(γ) = V(0)(1 + γ) (`RestLengthVolumetric`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from critflow.laws import HOOKEAN, SpringLaw, checked_law
from critflow.linalg import FixedPattern
from critflow.manifold import CriticalConfiguration
from critflow.moduli import Moduli, linear_response
from critflow.network import Array, Network
from critflow.result import InputError, Solution, Stats, Status
from critflow.springs import SpringState, equilibrium


@dataclass(frozen=True, eq=False)
class StrainPath:
    """Equilibria at strains γ (n,): moduli, energy and forces (n,), work and status of each step, the last state.

    A step that failed and all after it hold NaN and say so in `status`.
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
    method: str = "newton",
    *,
    law: SpringLaw = HOOKEAN,
    tolerance: float = 1e-14,
    moduli: bool = True,
    pattern: FixedPattern | None = None,
    throw: bool = True,
) -> Solution[StrainPath]:
    """Expand a critical configuration of a network through increasing strains γ > 0, relaxing and measuring at each.

    Each step starts from the last state, carried on affinely and along the curve that the last two states and their
    linear responses trace.  `method` and `tolerance` are those of `equilibrium`; without `moduli` only the equilibria
    are found.
    """
    gamma = check_strains(strains)
    network = critical.springs_of(network)
    d = network.dimension
    law = checked_law(law, critical.lengths, network.stiffness)
    state = SpringState(network, critical.lengths, critical.coordinates, critical.bond_vectors, law)
    pattern = pattern or state.pattern()
    records = np.full((5, len(gamma)), np.nan)
    steps, statuses = np.zeros(len(gamma), int), np.full(len(gamma), int(Status.missing))
    states: list[SpringState] = []
    why = ""
    before, trace = 0.0, _Trace(state.coordinates[network.free])
    for n, strain in enumerate(gamma):
        size = (1 + before) ** (1 / d)
        growth = ((1 + strain) / (1 + before)) ** (1 / d)
        start = state.moved(size * trace.step_to(strain)).deformed(growth * np.eye(d))
        solution = equilibrium(start, method, tolerance, pattern=pattern, throw=False)
        state, steps[n], statuses[n] = solution.value, solution.stats.iterations, solution.status
        if not solution.ok:
            why = solution.stats.details.get("note", solution.status.message)
            break
        measured, slope = _NOTHING, None
        size = (1 + strain) ** (1 / d)
        if moduli:
            response, relaxation = linear_response(state, pattern)
            measured, statuses[n] = response.value, response.status
            if not response.ok:
                why = response.status.message
                break
            slope = relaxation / ((1 + strain) * size)
        trace.add(strain, state.coordinates[network.free] / size, slope)
        records[:, n] = (measured.bulk, measured.shear, measured.shear_stress_corrected, state.energy, state.max_force)
        states.append(state)
        before = strain
    bad = np.flatnonzero(statuses != Status.ok)
    status = Status(int(statuses[bad[0]])) if len(bad) else Status.ok
    bulk, shear, corrected, energy, force = records
    path = StrainPath(gamma, bulk, shear, corrected, energy, force, steps, statuses, tuple(states))
    details = {"note": f"at strain {gamma[bad[0]]:g}, {why}"} if len(bad) else {}
    worst = float(np.max(path.max_force[: len(states)], initial=0.0))
    result = Solution(path, status, Stats(method, int(steps.sum()), residual=worst, details=details))
    return result.or_raise("the strain path stopped") if throw else result


_NOTHING = Moduli(np.nan, np.nan, np.nan)


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
