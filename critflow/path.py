"""The strain path: a critical configuration expanded step by step past the transition, each step from the last.

Rest lengths are the lengths at the transition, ℓ = |L(0)|; volumes follow V(γ) = V(0)(1 + γ) (`RestLengthVolumetric`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from critflow.linalg import FixedPattern
from critflow.manifold import CriticalConfiguration
from critflow.moduli import Moduli, linear_response
from critflow.network import Array
from critflow.result import InputError, Solution, Stats, Status
from critflow.springs import SpringState, equilibrium, hessian_pattern


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
    critical: CriticalConfiguration,
    strains: ArrayLike,
    method: str = "newton",
    *,
    tolerance: float = 1e-14,
    moduli: bool = True,
    pattern: FixedPattern | None = None,
    throw: bool = True,
) -> Solution[StrainPath]:
    """Expand a critical configuration through increasing strains γ > 0, relaxing and measuring at each.

    Each step starts from the last state, carried on affinely and by its own linear response.  `method` and
    `tolerance` are those of `equilibrium`; without `moduli` only the equilibria are found.
    """
    gamma = check_strains(strains)
    d = critical.network.dimension
    pattern = pattern or hessian_pattern(critical.network)
    state = SpringState(critical.network, critical.lengths, critical.coordinates, critical.bond_vectors)
    records = np.full((5, len(gamma)), np.nan)
    steps, statuses = np.zeros(len(gamma), int), np.full(len(gamma), int(Status.missing))
    states: list[SpringState] = []
    before, relaxation = 0.0, np.zeros_like(state.forces)
    for n, strain in enumerate(gamma):
        growth = (1 + strain) / (1 + before)
        # u is the answer to a relative change of volume, and grows with the box like everything else.
        start = state.moved((growth - 1) * relaxation).deformed(growth ** (1 / d) * np.eye(d))
        solution = equilibrium(start, method, tolerance, pattern=pattern, throw=False)
        state, steps[n], statuses[n] = solution.value, solution.stats.iterations, solution.status
        if not solution.ok:
            break
        measured = _NOTHING
        if moduli:
            response, relaxation = linear_response(state, pattern)
            measured, statuses[n] = response.value, response.status
        records[:, n] = (measured.bulk, measured.shear, measured.shear_stress_corrected, state.energy, state.max_force)
        states.append(state)
        before = strain
    bad = np.flatnonzero(statuses != Status.ok)
    status = Status(int(statuses[bad[0]])) if len(bad) else Status.ok
    bulk, shear, corrected, energy, force = records
    path = StrainPath(gamma, bulk, shear, corrected, energy, force, steps, statuses, tuple(states))
    details = {"note": f"at strain {gamma[bad[0]]:g}, {status.message}"} if len(bad) else {}
    worst = float(np.max(path.max_force[: len(states)], initial=0.0))
    result = Solution(path, status, Stats(method, int(steps.sum()), residual=worst, details=details))
    return result.or_raise("the strain path stopped") if throw else result


_NOTHING = Moduli(np.nan, np.nan, np.nan)
