"""The critical configuration of a random stress, and its springs past the transition with their exact equilibrium."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from critflow import CriticalConfiguration, CriticalManifold, Solution, equilibrium, spring_state, voronoi_network
from critflow.linalg.factor import Factor, FixedPattern
from critflow.precision.double_double import Extended, extended
from critflow.response.tensor import Elasticity
from critflow.springs.state import SpringState
from critflow.workflow import stable_rng

from ..timing import Answer
from . import references

STRAIN = 1e-3


def random_critical(n_vertices: int, seed: int) -> tuple[CriticalManifold, CriticalConfiguration]:
    """A network and its configuration under a random stress."""
    manifold = CriticalManifold(voronoi_network(n_vertices, seed))
    rng = stable_rng(seed, "contest", "stress")
    return manifold, manifold.configuration(np.abs(rng.standard_normal(manifold.network.n_edges)))


@dataclass(frozen=True, eq=False)
class StrainedSprings:
    """Springs strained affinely from their critical configuration, and their equilibrium.

    start    the affinely strained state
    relaxed  its equilibrium in working precision
    exact    the equilibrium in double-double arithmetic, and the factor of its Hessian
    """

    start: SpringState
    relaxed: SpringState
    pattern: FixedPattern
    exact: tuple[references.Springs, Factor]

    @classmethod
    def of(cls, n_vertices: int, seed: int) -> StrainedSprings:
        manifold, critical = random_critical(n_vertices, seed)
        F = np.sqrt(1 + STRAIN) * np.eye(2)
        start = spring_state(manifold.network.deformed(F), critical.lengths, critical.coordinates @ F.T)
        relaxed = equilibrium(start, pattern=manifold.hessian).value
        near = relaxed.coordinates[start.network.free]
        exact = references.equilibrium(start.network, extended(critical.lengths), near, manifold.hessian)
        return cls(start, relaxed, manifold.hessian, exact)

    @property
    def unit(self) -> float:
        """Mean length of the edges at the start."""
        return self.start.length_scale


def relative(exact: Sequence[Extended], values: Sequence[float]) -> float:
    """The largest of the relative errors of numbers."""
    return max(references.relative_error(value, truth) for value, truth in zip(values, exact, strict=True))


def answer_of(solution: Solution[Any], *names: str) -> Answer:
    """Numbers of the value of a solution, and the largest relative bound that it claims on their errors."""
    value, bound = solution.value, np.nan
    bounds = value.errors if isinstance(value, Elasticity) else solution.stats.error_bound
    if hasattr(bounds, names[0]):
        bound = max(getattr(bounds, name) / abs(getattr(value, name)) for name in names)
    return Answer([getattr(value, name) for name in names], solution.status, solution.stats.steps, bound)
