"""Task: C_B and C_G, exactly, by Richardson extrapolation, and by fits.

Fits and extrapolation need the moduli at several strains, each a relaxation and a linear response; levels are the
largest strain.  A fit of degree n has a bias of that strain to the nth power, and the rounding of the moduli over it.
The reference is the derivative at γ = 0 of the polynomial through moduli at 13 strains, in double-double arithmetic,
and does not contain the exact formula.
"""

from dataclasses import replace
from functools import partial

import numpy as np

from critflow import Solution, stiffening, strain_path
from critflow.networks.network import Array
from critflow.paths.strain_path import PathSolver, StrainPath
from critflow.response.elasticity import elasticity

from ..timing import Answer, Method, Task
from . import references
from .moduli import LARGE
from .springs import answer_of, random_critical, relative

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


def _methods(n_vertices: int, seed: int) -> list[Method]:
    manifold, critical = random_critical(n_vertices, seed)
    error = partial(relative, references.stiffening(manifold, critical.sigma))
    windows = WINDOWS if n_vertices < LARGE else WINDOWS[-1:]

    # Every run starts from a copy of the configuration without cached results.
    def exactly(level: float) -> Answer:
        return answer_of(stiffening(replace(critical), throw=False), "C_B", "C_G")

    def path_to(strains: Array) -> Solution[StrainPath]:
        solver = PathSolver(pattern=manifold.hessian)
        return strain_path(replace(critical), strains, measure="moduli", solver=solver, throw=False)

    def fitted(degree: int, n_strains: int, window: float) -> Answer:
        solution = path_to(window * np.arange(1, n_strains + 1) / n_strains)
        path = solution.value
        moduli = path.bulk_modulus, path.shear_modulus
        slopes = [_slope(path.strains, values, degree) for values in moduli]
        return Answer(slopes, solution.status, int(path.steps.sum()))

    def extrapolated(reach: float) -> Answer:
        solution = path_to(reach * 2.0 ** np.arange(-HALVINGS, 1))
        path, start = solution.value, elasticity(replace(critical)).value
        changes = path.bulk_modulus - start.bulk, path.shear_modulus - start.shear
        return Answer([_limit(change / path.strains) for change in changes], solution.status, int(path.steps.sum()))

    return [
        Method("exact", exactly, error, backend="qdldl"),
        Method("Richardson", extrapolated, error, windows, backend="qdldl"),
        *(Method(name, partial(fitted, *fit), error, windows, backend="qdldl") for name, fit in _FITS.items()),
    ]


def _slope(strains: Array, moduli: Array, degree: int) -> float:
    """The slope at γ = 0 of the polynomial fitted to moduli; NaN where the path stopped."""
    return float(np.polyfit(strains, moduli, degree)[-2]) if np.isfinite(moduli).all() else np.nan


def _limit(quotients: Array) -> float:
    """The limit γ → 0 of difference quotients at strains that double, of errors γ, γ², …, eliminated in turn."""
    for order in range(1, HALVINGS + 1):
        quotients = (2**order * quotients[:-1] - quotients[1:]) / (2**order - 1)
    return float(quotients[0])


TASKS = (
    Task(
        "coefficients",
        "stiffening coefficients $C_B$ and $C_G$",
        "larger of the relative errors of $C_B$ and $C_G$",
        SIZES,
        ("exact", "Richardson", *_FITS),
        "exact",
        _methods,
    ),
)
