"""What a design may change: the variables z of a constrained problem.

Each kind maps z to what the quantities are evaluated on, and gives their gradients by z: stresses (`stresses`),
stiffnesses (`stiffnesses`), amplitudes of faces (`faces`), and rest lengths (`rest_lengths`).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from critflow.critical.quantity import Quantity
from critflow.design.limits import Target, limit_sizes
from critflow.networks.network import Array
from critflow.result import InputError, Solution
from critflow.solvers.constrained import Minimum, Problem, minimise_constrained


@dataclass(frozen=True, eq=False)
class Designed:
    """The end of a design: its value, the solve behind it, and values, errors (n,) and gradients by z (n, N)."""

    value: Any
    solved: Solution[Any]
    values: Array
    errors: Array
    rows: Array
    error_bound: float = np.nan


class Variables(ABC):
    """Variables z (N,) of a design.

    origin      z_0, (N,)
    low, high   limits (m,) of the values of `limited`
    longest     largest change of a component of z in one step
    tolerance   residual of the first-order conditions at which the least change has been selected
    """

    origin: Array
    low: Array = np.zeros(0)
    high: Array = np.zeros(0)
    longest: ClassVar[float]
    tolerance: ClassVar[float]

    @abstractmethod
    def at(self, z: Array) -> Any:
        """What quantities are evaluated on at z."""

    @abstractmethod
    def values(self, state: Any, quantities: Sequence[Quantity]) -> tuple[Array, Array]:
        """Values (n,) of quantities and their gradients by z, (n, N)."""

    @abstractmethod
    def designed(self, z: Array, quantities: Sequence[Quantity]) -> Designed:
        """The end of a design at z, solved to the last digit."""

    def at_configuration(self, solved: Solution[Any], z: Array, quantities: Sequence[Quantity]) -> Designed:
        """The end at a refined configuration, to which the errors refer."""
        value = solved.value
        values, errors = np.array([(one.evaluate(value)[0], one.error(value)) for one in quantities]).reshape(-1, 2).T
        return Designed(value, solved, values, errors, self.values(self.at(z), quantities)[1], value.error_bound)

    def change(self, state: Any, z: Array) -> tuple[float, Array]:
        """Half the square of the change, and its gradient by z (N,)."""
        change = z - self.origin
        return 0.5 * float(change @ change), change

    def limited(self, state: Any) -> Array:
        """Values (m,) that have limits."""
        return np.zeros(0)

    def limited_rows(self, state: Any, indices: NDArray[np.intp]) -> Array:
        """Gradients by z of limited values, (len(indices), N)."""
        return np.zeros((0, len(self.origin)))

    def sizes(self, targets: Sequence[Target]) -> Array:
        """Errors of targets are relative to these (n,), and absolute below a hundredth."""
        return np.maximum(limit_sizes(targets), 1e-2)

    def excluded(self, targets: Sequence[Target]) -> str:
        """A sentence where a proof excludes the targets, else an empty string."""
        return ""

    def distance(self, z: Array) -> float:
        """Root mean square of the change."""
        return float(np.sqrt(np.mean((z - self.origin) ** 2)))

    def search(self, problem: Problem, tolerance: float, max_steps: int) -> Minimum:
        """The end of the search for the targets."""
        return minimise_constrained(problem, self.origin, tolerance, self.longest, max_steps)


def require_unused(change: str, **options: object) -> None:
    """Raise `InputError` for options of `design` that do not apply to the variables."""
    given = [name for name, value in options.items() if value is not None]
    if given:
        raise InputError(f"{given[0]} does not apply to change={change!r}: omit it")
