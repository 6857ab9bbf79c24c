"""Task: one strain step of springs from their critical configuration, by minimisers of the energy.

All start from the same affinely strained state with the same springs, and stop at the same largest force component, in
units of k times the mean length.  The pattern of the Hessian of critflow and the bonds and lists of LAMMPS are
prepared, and every run puts the vertices back where they start.

LAMMPS runs without pair forces, with the largest component as its norm and an energy tolerance of zero; it stops
where its line search finds no lower energy, and `forcezero` looks at forces instead.  Step limits keep iterative
methods below some seconds; a method that reaches its limit has `Status.step_limit`.
"""

from dataclasses import replace
from functools import partial

import numpy as np

from critflow import Status, equilibrium
from critflow.equilibria import Relaxation
from critflow.minimisers import lbfgs, minimise
from critflow.networks import Array

from ..lammps import Lammps, representable
from ..timing import Answer, Method, Run, Task
from .springs import StrainedSprings, prepared

SIZES = (100, 1_000, 10_000)
LEVELS = (1e-4, 1e-6, 1e-8, 1e-10, 1e-12, 1e-14)
# Steps times vertices that take some seconds, and steps that small networks may take, each of a constant cost.
_LIMITS = {
    "FIRE": (20_000_000, 20_000),
    "L-BFGS": (5_000_000, 4_000),
    "LAMMPS": (200_000_000, 200_000),
}
_LAMMPS = {
    "LAMMPS cg": ("cg", "line quadratic"),
    "LAMMPS cg forcezero": ("cg", "line forcezero"),
    "LAMMPS hftn": ("hftn", "line quadratic"),
    "LAMMPS fire": ("fire", "line quadratic"),
}


def _most_steps(springs: StrainedSprings, name: str) -> int:
    work, most = _LIMITS[name]
    return min(work // springs.start.network.n_vertices, most)


def error(springs: StrainedSprings, coordinates: Array) -> float:
    """Largest error of a coordinate over that of the start; the vertex that is grounded stays where it is."""
    return _distance(springs, coordinates) / _distance(springs, springs.start.coordinates)


def _distance(springs: StrainedSprings, coordinates: Array) -> float:
    reference = springs.exact[0].x
    x = coordinates[springs.start.network.free]
    return float(np.abs((x - reference.high) - reference.low).max())


def peer_error(springs: StrainedSprings, coordinates: Array) -> float:
    """The same for coordinates (N_v, 2) that the box may have wrapped and that have drifted."""
    network = springs.start.network
    side = network.cell[0, 0]
    exact = springs.start.coordinates.copy()
    exact[network.free] = springs.exact[0].x.high
    difference = coordinates - exact
    for _ in range(2):
        difference -= side * np.round(difference / side)
        difference -= difference.mean(axis=0)
    return float(np.abs(difference).max()) / _distance(springs, springs.start.coordinates)


def _by_equilibrium(springs: StrainedSprings, method: str, most_steps: int | None) -> Run:
    start = prepared(springs.start)

    def run(tolerance: float) -> Answer:
        # A copy of the start has nothing that was computed from it.
        solution = equilibrium(replace(start), method, tolerance, most_steps, throw=False)
        return Answer(solution.value.coordinates, solution.status)

    return run


def _by_lbfgs(springs: StrainedSprings) -> Run:
    start, limit = prepared(springs.start), _most_steps(springs, "L-BFGS")

    def run(tolerance: float) -> Answer:
        state = replace(start)
        end = minimise(Relaxation(state), lbfgs, np.zeros(state.forces.size), tolerance * springs.unit, limit)
        return Answer(state.moved(end.point.x.reshape(state.forces.shape)).coordinates, end.status)

    return run


def _by_lammps(springs: StrainedSprings, style: str, options: str) -> Run:
    engine, most_steps = Lammps(prepared(springs.start)), _most_steps(springs, "LAMMPS")

    def run(tolerance: float) -> Answer:
        x, iterations, force = engine.relax(style, options, tolerance * springs.unit, most_steps)
        short = Status.stalled if iterations < most_steps else Status.step_limit
        return Answer(x, Status.ok if force <= tolerance * springs.unit else short)

    return run


def _methods(n_vertices: int, seed: int) -> list[Method]:
    springs = StrainedSprings.of(n_vertices, seed)
    judged = partial(error, springs)
    fire = partial(_by_equilibrium, springs, "fire", _most_steps(springs, "FIRE"))
    methods = [
        Method("Newton", partial(_by_equilibrium, springs, "newton", None), judged, LEVELS, backend="qdldl"),
        Method("L-BFGS", partial(_by_lbfgs, springs), judged, LEVELS),
        Method("FIRE", fire, judged, LEVELS),
    ]
    if representable(springs.start):
        judged = partial(peer_error, springs)
        for name, choice in _LAMMPS.items():
            methods.append(Method(name, partial(_by_lammps, springs, *choice), judged, LEVELS, "lammps"))
    return methods


TASKS = (
    Task(
        "strain_step",
        "a strain step, γ = 0.001",
        "largest error of a coordinate over that of the affine start",
        SIZES,
        ("Newton", "L-BFGS", "FIRE", *_LAMMPS),
        "Newton",
        _methods,
    ),
)
