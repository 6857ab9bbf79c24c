"""The result of a design, the same for stresses, isogonal modes and stiffnesses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeVar

import numpy as np

from critflow.networks.network import Array
from critflow.quantities.table import limits_of
from critflow.result import Solution, Status
from critflow.solvers.constrained import Minimum

# Least eigenvalue of the cosines of the gradients of targets that can be changed independently.
INDEPENDENT_TARGETS = 1e-6

Value = TypeVar("Value")
Interval = float | tuple[float, float]


@dataclass(frozen=True, eq=False, kw_only=True)
class Design(Solution[Value]):
    """A configuration or a network with requested properties.

    achieved      values of the targets by name
    error_bounds  of the achieved values by name (estimate): from the bounds of the bond vectors, and rounding
    multipliers   cost of each target, by name: derivative of the least preference by its value, 0 inside an interval
    gram          (n, n) cosines between the gradients of the targets, in their order; 0 in the row of a target that no
                  unknown changes
    independence  by name: the sine of the angle between the gradient of a target and the span of the others, which is
                  the part of a unit change of this target alone; 0 where the others determine it
    independent   whether all targets can be changed independently here: the least eigenvalue of `gram` is not zero
    preference    value of the preference: ½|z − z_0|² of the unknowns z, unless `design` was given another one
    distance      root mean square of z − z_0: of log σ (of σ where `signs` is "any"), of log lengths or of log k
    """

    achieved: dict[str, float]
    error_bounds: dict[str, float] = field(repr=False)
    multipliers: dict[str, float]
    gram: Array = field(repr=False)
    independence: dict[str, float] = field(repr=False)
    preference: float
    distance: float

    @property
    def independent(self) -> bool:
        """Whether all targets can be changed independently here."""
        return bool(np.linalg.eigvalsh(self.gram)[0] > INDEPENDENT_TARGETS)


def of_targets(
    names: Sequence[str], achieved: Array, error_bounds: Array, multipliers: Array, rows: Array
) -> dict[str, Any]:
    """The fields of a design that its targets (n,) and their gradients (n, N) determine."""
    norm = np.linalg.norm(rows, axis=1)
    unit = rows / np.where(norm > 0, norm, 1.0)[:, None]
    gram = unit @ unit.T
    sines = np.sqrt(1 / np.maximum(np.diag(np.linalg.pinv(gram)), 1.0)) * (norm > 0)
    by_name = {"achieved": achieved, "error_bounds": error_bounds, "multipliers": multipliers, "independence": sines}
    fields = {key: dict(zip(names, map(float, values), strict=True)) for key, values in by_name.items()}
    return fields | {"gram": gram}


def outcome(found: Minimum, refused: str, unreached: str) -> tuple[Status, str]:
    """Status and note of a search in which the least change only selects: a design with its targets is complete.

    refused    the reason why a closed form excludes the targets, or an empty string
    unreached  the next step where the search reduces the errors no further
    """
    if refused:
        return Status.infeasible, refused
    if found.reached:
        return Status.ok, ""
    return found.status, unreached if found.status is Status.infeasible else ""


def all_limits(targets: Mapping[str, Interval]) -> tuple[Array, Array]:
    """Low and high limits (n,) of the targets."""
    limits = np.array([limits_of(name, value) for name, value in targets.items()])
    return limits[:, 0], limits[:, 1]
