"""Rest lengths as the variables of a design: a prescribed onset of rigidity, z = log ℓ.

The gradient dγ_c/dℓ of the cone program is exact.  With g = dγ_c/dz the nearest rest lengths satisfy z − z_0 ∝ g; where
the set of taut edges changes at every step they need not be found, and the shortest steps to the onset remain.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

from critflow.arguments import edge_values
from critflow.deformation import Deformation
from critflow.lengths import critical_from_lengths
from critflow.networks import Array
from critflow.quantities import Quantity
from critflow.result import InputError, Solution, Status
from critflow.springs import SpringState, spring_state
from critflow_extras.cables.critical_strain import critical_strain
from critflow_extras.cables.onset_end import CriticalStrain
from critflow_extras.targets.constrained import RESTORED, Minimum, Problem, minimise_constrained
from critflow_extras.targets.problem import DesignOptions, DesignResult, Target, Variables

REACHED = 1e-10  # error of the strain of a designed onset that counts as reached


class RestLengths(Variables):
    """log ℓ (N_b,) of cables, of which the onsets of rigidity are prescribed.

    ratios  whether all rest lengths change by one factor: t ℓ_0 has the onset γ*, with t of the cone program at F(γ*)
    """

    preferences = ("ratios",)
    longest = 0.2
    tolerance = 1e-5  # component of the least change along the targets, relative to 1 plus the largest one

    def __init__(self, state: SpringState, ratios: bool = False, start: ArrayLike | None = None):
        rest = state.rest_lengths if start is None else start
        self.state, self.network, self.ratios = state, state.network, ratios
        self.origin = np.log(edge_values(rest, self.network.n_edges, "rest_lengths"))
        self._sought: dict[str, Target] = {}
        self._onsets: dict[tuple[str, bytes], Solution[CriticalStrain]] = {}

    @classmethod
    def of(cls, start: Any, options: DesignOptions) -> Self:
        options.limits(cls)
        options.require_unused("signs", "free")
        return cls(options.springs(start), options.prefers("ratios"), options.initial)

    def at(self, z: Array) -> Array:
        return z

    def onset(self, z: Array, quantity: Quantity) -> Solution[CriticalStrain]:
        """The onset at log ℓ = z in the direction of the target; the last ones are kept."""
        deformation: Deformation | None = getattr(quantity, "deformation", None)
        if not quantity.name.startswith("onset[") or deformation is None:
            raise InputError(f"rest lengths set onsets, such as onset[simple_shear], not {quantity.name}")
        key = quantity.name, z.tobytes()
        if key not in self._onsets:
            if len(self._onsets) > 2 * len(self._sought):
                self._onsets.clear()
            direction = 1 if self._sought[quantity.name].low > 0 else -1
            self._onsets[key] = critical_strain(self.network, np.exp(z), deformation, direction=direction, throw=False)
        return self._onsets[key]

    def values(self, state: Array, quantities: Sequence[Quantity]) -> tuple[Array, Array]:
        onsets = [self.onset(state, quantity) for quantity in quantities]
        rows = np.array([np.exp(state) * onset.value.gradient for onset in onsets])
        return np.array([onset.value.strain for onset in onsets]), rows.reshape(len(onsets), len(state))

    def sizes(self, targets: Sequence[Target]) -> Array:
        """Errors of strains are absolute, and `REACHED` counts as none."""
        return np.full(len(targets), REACHED / RESTORED)

    def refusal(self, targets: Sequence[Target]) -> str:
        for target in targets:
            if target.sense or not (target.low == target.high and np.isfinite(target.low) and target.low != 0):
                raise InputError(f"the strain of {target.name} must be a number other than zero")
        if self.ratios and len(targets) > 1:
            raise InputError("rest lengths in given ratios have one onset only: give one target")
        self._sought = {target.quantity.name: target for target in targets}
        return ""

    def search(self, problem: Problem, tolerance: float, max_steps: int) -> Minimum:
        """The nearest rest lengths with the onsets; those in the ratios of the start where none are found."""
        end: Minimum | None = None
        if not self.ratios:
            start = self.origin
            if not np.isfinite(problem.at(start).constraints).all():
                start = start + self._factor()
            if np.isfinite(problem.at(start).constraints).all():
                end = minimise_constrained(problem, start, tolerance, self.longest, max_steps)
        if end is None or not end.reached:
            scaled = self._scaled(problem)
            end = scaled if end is None or scaled.violation < end.violation else end
        return end

    def _scaled(self, problem: Problem) -> Minimum:
        """The rest lengths in the ratios of the start, by Newton's method."""
        z, steps = self.origin + self._factor(), 1
        point = problem.at(z)
        while np.isfinite(point.constraints).all() and steps < 4:
            error = float((problem.low - point.constraints)[0])
            if abs(error) <= RESTORED:
                break
            z = z + error / float(point.rows(np.arange(1))[0].sum())
            point, steps = problem.at(z), steps + 1
        violation = float(np.abs(point.constraints - problem.low).max())
        violation = violation if np.isfinite(violation) else np.inf
        # Along equal changes of log ℓ: ½|z − z_0|² changes by Σ(z − z_0) over that of the onset.
        multiplier = -float((z - self.origin).sum()) / float(point.rows(np.arange(1))[0].sum())
        status = Status.ok if violation <= RESTORED else Status.not_reached
        return Minimum(point, np.array([multiplier]), violation, np.nan, steps, status)

    def _factor(self) -> float:
        """log t at F(γ*) of the first target."""
        target = next(iter(self._sought.values()))
        deformation: Deformation = target.quantity.deformation  # type: ignore[attr-defined]
        deformed = self.network.deformed(deformation.gradient(target.low))
        return float(np.log(critical_from_lengths(deformed, np.exp(self.origin), throw=False).ratio))

    def designed(self, z: Array, quantities: Sequence[Quantity]) -> DesignResult:
        """The state with these rest lengths, at its coordinates, and the onset of the first target."""
        onsets = [self.onset(z, quantity) for quantity in quantities]
        values, rows = self.values(z, quantities)
        errors = np.array([onset.value.upper - onset.value.lower for onset in onsets])
        state = self.state
        value: Any = spring_state(self.network, np.exp(z), state.coordinates, state.law)
        return DesignResult(value, onsets[0], values, errors, rows, float(errors.max()))
