"""The result of a design, the same for all kinds of variables."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, TypeVar

import numpy as np

from critflow.networks.network import Array
from critflow.result import Record, Solution

# Least eigenvalue of the cosines of the gradients of targets that can be changed independently.
INDEPENDENT_TARGETS = 1e-6

Value = TypeVar("Value")


@dataclass(frozen=True)
class Achieved(Record):
    """What a design has of one target.

    value         of the quantity
    error         of the value (estimate): from the errors of the bond vectors, and rounding
    multiplier    cost of the target: derivative of the least preference by its value, 0 inside an interval
    independence  sine of the angle between the gradient of the target and the span of the others, which is the part of
                  a unit change of this target alone; 0 where the others determine it
    """

    value: float
    error: float
    multiplier: float
    independence: float


@dataclass(frozen=True, eq=False, kw_only=True)
class Design(Solution[Value]):
    """A configuration or a state with requested properties.

    reached     whether all targets are reached, whatever became of the preference
    targets     what is achieved of each target, by name
    preference  value of the preference: ½|z − z_0|² of the variables z, unless `design` was given another one
    distance    root mean square of the change: of log σ (of σ where `signs` is "any"), log lengths, log k or log ℓ
    gram        (n, n) cosines between the gradients of the targets, in their order; 0 in the row of a target that no
                variable changes
    solved      the solve that gives the values: the balance of forces, the elasticity at rest, or the onset
    """

    reached: bool
    targets: dict[str, Achieved]
    preference: float
    distance: float
    gram: Array = field(repr=False)
    solved: Solution[Any] = field(repr=False)

    @property
    def independent(self) -> bool:
        """Whether all targets can be changed independently here: the least eigenvalue of `gram` is not zero."""
        return bool(np.linalg.eigvalsh(self.gram)[0] > INDEPENDENT_TARGETS)


def cosines(rows: Array) -> tuple[Array, Array]:
    """Cosines (n, n) between gradients (n, N), and the sine of each to the span of the others (n,)."""
    norm = np.linalg.norm(rows, axis=1)
    unit = rows / np.where(norm > 0, norm, 1.0)[:, None]
    gram = unit @ unit.T
    return gram, np.sqrt(1 / np.maximum(np.diag(np.linalg.pinv(gram)), 1.0)) * (norm > 0)
