"""What an optimisation returns."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import NoReturn

import numpy as np
from numpy.typing import NDArray

from critflow.critical.manifold import CriticalConfiguration
from critflow.networks.network import Array
from critflow.result import Solution

_NO_EDGES, _NO_VALUES = np.zeros(0, np.intp), np.zeros(0)


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Optimum(Solution[CriticalConfiguration]):
    """The best critical configuration by an objective; `stats.residual` is the largest component of dO/dσ.

    Numbers that do not apply are NaN or None, lists are empty.

    objective         value of the objective; where the optimum is not attained, the limit of the value
    error_of          function that computes `objective_error`, where the optimum is known
    uncertainty       |objective − limit| where the optimum is not attained.  Error bound (estimate)
    bound             largest value over all stresses in closed form (moduli without a penalty)
    collapsed_edges   edges whose length is zero at an optimum that is attained, or tends to zero
                      (`Status.edge_collapse`)
    slack_edges       all edges whose tension tends to zero (`Status.slack_edges`)
    saddles           saddle points left on the descent; None where the end was not tested
    start             number of the start that led here
    starts            values of the objective from all starts, (n_starts,)
    crossings         steps after which the number of negative pivots of P differs (stresses of any sign)
    nearest_singular  smallest pivot of P over the largest on the descent (stresses of any sign)
    negative_pivots   number of negative pivots of P at the last step of the descent (stresses of any sign)
    """

    objective: float
    error_of: Callable[[], float] | None = field(default=None, repr=False)
    uncertainty: float = np.nan
    bound: float = np.nan
    collapsed_edges: NDArray[np.intp] = field(default_factory=_NO_EDGES.copy)
    slack_edges: NDArray[np.intp] = field(default_factory=_NO_EDGES.copy)
    saddles: int | None = None
    start: int = 0
    starts: Array = field(default_factory=_NO_VALUES.copy)
    crossings: tuple[int, ...] = ()
    nearest_singular: float = np.nan
    negative_pivots: int | None = None

    def __getattr__(self, name: str) -> NoReturn:
        """Only names that an optimum lacks come here: where they are."""
        raise AttributeError(
            f"{type(self).__name__!r} object has no attribute {name!r}: its value by the objective is .objective, its "
            "configuration .value, and elasticity(...) and properties(...) of it have moduli and other quantities",
            name=name,
            obj=self,
        )

    @cached_property
    def objective_error(self) -> float:
        """|objective − optimum| where the optimum is known, else NaN; computed at its first use.

        Error bound (proof), except for moduli other than B_0, where the rounding of the bound is an estimate.
        """
        return self.error_of() if self.error_of else np.nan

    @property
    def gap(self) -> float:
        """1 − objective/bound where the bound is attained, else NaN."""
        if not self.ok:
            return np.nan
        return 1 - self.objective / self.bound if self.bound else 0.0
