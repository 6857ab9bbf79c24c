"""Task: C_B and C_G, exactly, by Richardson extrapolation, and by fits.

Fits and extrapolation need the moduli at several strains, each a relaxation and a linear response; levels are the
largest strain.  A fit of degree n has a bias of that strain to the nth power, and the rounding of the moduli over it.
The reference is the derivative at γ = 0 of the polynomial through moduli at 13 strains, in double-double arithmetic,
and does not contain the exact formula.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from critflow import (
    CriticalConfiguration,
    CriticalManifold,
    Status,
    stiffening,
    strain_path,
    transition_moduli,
)
from critflow.mechanics.strain_path import StrainPath
from critflow.networks.network import Array
from critflow.precision.double_double import Extended

from ..timing import Accuracy, Method, Task
from . import references
from .moduli import LARGE, random_critical
from .references import relative_error

SIZES = (100, 1_000, 10_000)
WINDOWS = (1e-2, 1e-3, 1e-4, 1e-5)
# Halvings of the strain in Richardson's table.
HALVINGS = 3
# Name of a fit: its degree and number of strains.
_FITS = {
    "line through 4": (1, 4),
    "line through 16": (1, 16),
    "parabola through 4": (2, 4),
    "parabola through 16": (2, 16),
}


@dataclass(frozen=True)
class Answer:
    """Coefficients as a method gives them, how it ended, and a relative bound on their errors if it claims one."""

    C_B: float
    C_G: float
    status: Status = Status.ok
    iterations: int = 0
    bound: float = np.nan


@dataclass(frozen=True, eq=False)
class Problem:
    """A critical configuration with its exact C_B and C_G."""

    manifold: CriticalManifold
    critical: CriticalConfiguration
    C_B: Extended
    C_G: Extended

    @classmethod
    def of(cls, n_vertices: int, seed: int) -> Problem:
        manifold, critical = random_critical(n_vertices, seed)
        return cls(manifold, critical, *references.stiffening(manifold, critical.sigma))

    def path(self, strains: Array) -> tuple[StrainPath, Status]:
        """Moduli on a path that starts from a copy of the configuration without cached results."""
        start = replace(self.critical)
        solution = strain_path(
            self.manifold.network, start, strains, tensors=False, pattern=self.manifold.hessian, throw=False
        )
        return solution.value, solution.status

    def accuracy(self, answer: Answer) -> Accuracy:
        """The larger of the relative errors."""
        error = max(relative_error(answer.C_B, self.C_B), relative_error(answer.C_G, self.C_G))
        return Accuracy(error, answer.status, answer.iterations, answer.bound)


def _exactly(problem: Problem, level: float) -> Answer:
    critical = replace(problem.critical)
    solution = stiffening(problem.manifold, critical, throw=False)
    value, claim = solution.value, solution.stats.error_bound
    bound = np.nan
    if isinstance(claim, type(value)):
        bound = max(claim.C_B / abs(value.C_B), claim.C_G / abs(value.C_G))
    return Answer(value.C_B, value.C_G, solution.status, solution.stats.steps, bound)


def _fitted(problem: Problem, degree: int, n_strains: int, window: float) -> Answer:
    path, status = problem.path(window * np.arange(1, n_strains + 1) / n_strains)
    slopes = [np.polyfit(path.strains, values, degree)[-2] for values in (path.bulk_modulus, path.shear_modulus)]
    return Answer(*slopes, status, int(path.steps.sum()))


def _extrapolated(problem: Problem, reach: float) -> Answer:
    """Difference quotients with the moduli at the transition, of errors γ, γ², …, eliminated in turn."""
    gamma = reach * 2.0 ** np.arange(-HALVINGS, 1)
    path, status = problem.path(gamma)
    start = transition_moduli(replace(problem.critical))
    found = []
    for values, value_0 in ((path.bulk_modulus, start.bulk), (path.shear_modulus, start.shear)):
        table = (values - value_0) / gamma
        for order in range(1, HALVINGS + 1):
            table = (2**order * table[:-1] - table[1:]) / (2**order - 1)
        found.append(float(table[0]))
    return Answer(*found, status, int(path.steps.sum()))


def _methods(n_vertices: int, seed: int) -> list[Method]:
    problem = Problem.of(n_vertices, seed)
    windows = WINDOWS if n_vertices < LARGE else WINDOWS[-1:]
    return [
        Method("exact", partial(_exactly, problem), problem.accuracy, backend="qdldl"),
        Method("Richardson", partial(_extrapolated, problem), problem.accuracy, windows, backend="qdldl"),
        *(
            Method(name, partial(_fitted, problem, *fit), problem.accuracy, windows, backend="qdldl")
            for name, fit in _FITS.items()
        ),
    ]


TASKS = (
    Task(
        "coefficients",
        "stiffening coefficients C_B and C_G",
        "larger of the relative errors of C_B and C_G",
        SIZES,
        ("exact", "Richardson", *_FITS),
        "exact",
        _methods,
    ),
)
