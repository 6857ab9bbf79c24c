"""Task: C_B of one member of the ensemble of random stresses, alone or with further variables of its table.

The exact C_B is the same number in all of them: the task compares times and bytes, and its error is that to the answer
of the shortest method.
"""

from __future__ import annotations

from functools import partial

from critflow.workflow import decimals

from ...shared.measurements import planar_member, table
from ..timing import Answer, Method, Task

SIZES = (100, 1_000)
STRAINS = decimals("0.001:0.010:0.001")
VARIABLES = {variable.name: variable for variable in table(planar=True)}
# Names of the methods, and of the variables that are stored.
METHODS = {
    "C_B alone": ("status", "bulk_modulus_0", "C_B_exact"),
    "all numbers": tuple(name for name, variable in VARIABLES.items() if set(variable.dims) <= {"population", "seed"}),
    "all variables": tuple(VARIABLES),
}


def member(n_vertices: int, seed: int, names: tuple[str, ...], level: float = 0.0) -> Answer:
    """The arrays of one member with the variables of these names, as they are stored."""
    settings = {"n_vertices": n_vertices, "hard_core": 0.82, "strains": STRAINS, "fit_window": max(STRAINS)}
    arrays = planar_member(settings, seed=seed, population="random_stress", wanted=frozenset(names))
    return Answer({name: VARIABLES[name].cast(arrays[name]) for name in names})


def _methods(n_vertices: int, seed: int) -> list[Method]:
    exact = float(member(n_vertices, seed, METHODS["C_B alone"]).values["C_B_exact"])

    def error(arrays: dict) -> float:
        return abs(float(arrays["C_B_exact"]) / exact - 1)

    return [Method(name, partial(member, n_vertices, seed, names), error) for name, names in METHODS.items()]


TASKS = (
    Task(
        "member",
        "$C_B$ of a member of the ensemble",
        "relative difference from $C_B$ alone",
        SIZES,
        tuple(METHODS),
        "C_B alone",
        _methods,
    ),
)
