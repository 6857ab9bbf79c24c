"""Task: one strain step of springs from their critical configuration, by minimisers of the energy.

All start from the same affinely strained state with the same springs, and stop at the same largest force component, in
units of k times the mean length.  Only the solve is timed: the symbolic analysis of critflow and the bonds and lists of
LAMMPS are made before, and every run puts the vertices back where they start.

LAMMPS runs without pair forces, with the largest component as its norm and an energy tolerance of zero; it stops
where its line search finds no lower energy, and `forcezero` looks at forces instead.  Step limits keep iterative
methods below some seconds; a method that reaches its limit has `Status.step_limit`.
"""

from dataclasses import replace
from functools import partial

import numpy as np

from critflow import Status, equilibrium
from critflow.networks.network import Array
from critflow.optimisation.minimize import LBFGS, minimise
from critflow.springs.equilibrium import Relaxation

from ..lammps import Lammps, representable
from ..timing import Answer, Method, Task, installed
from .springs import StrainedSprings

# At most a hundredth of the error of the start.
USEFUL = 1e-5
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
    """Largest error of a coordinate, in mean lengths; the vertex that is grounded stays where it is."""
    reference = springs.exact[0].x
    x = coordinates[springs.start.network.free]
    return float(np.abs((x - reference.high) - reference.low).max()) / springs.unit


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
    return float(np.abs(difference).max()) / springs.unit


def _own(springs: StrainedSprings) -> list[Method]:
    def by(method: str, most_steps: int | None, tolerance: float) -> Answer:
        # A copy of the start has nothing that was computed from it.
        solution = equilibrium(replace(springs.start), method, tolerance, most_steps, springs.pattern, throw=False)
        bound = float(solution.stats.error_bound) / springs.unit
        return Answer(solution.value.coordinates, solution.status, solution.stats.steps, bound)

    def by_lbfgs(tolerance: float) -> Answer:
        state, limit = replace(springs.start), _most_steps(springs, "L-BFGS")
        end = minimise(Relaxation(state), LBFGS(), np.zeros(state.forces.size), tolerance * springs.unit, limit)
        return Answer(state.moved(end.point.x.reshape(state.forces.shape)).coordinates, end.status, end.steps)

    judged = partial(error, springs)
    return [
        Method("Newton", partial(by, "newton", None), judged, LEVELS, backend="qdldl"),
        Method("L-BFGS", by_lbfgs, judged, LEVELS),
        Method("FIRE", partial(by, "fire", _most_steps(springs, "FIRE")), judged, LEVELS),
    ]


def _lammps(springs: StrainedSprings) -> list[Method]:
    if not representable(springs.start):
        return []
    engine = Lammps(springs.start) if installed("lammps") else None
    most_steps = _most_steps(springs, "LAMMPS")

    def run(style: str, options: str, tolerance: float) -> Answer:
        assert engine is not None
        x, iterations, force = engine.relax(style, options, tolerance * springs.unit, most_steps)
        short = Status.stalled if iterations < most_steps else Status.step_limit
        return Answer(x, Status.ok if force <= tolerance * springs.unit else short, iterations)

    return [
        Method(name, partial(run, *choice), partial(peer_error, springs), LEVELS, "lammps")
        for name, choice in _LAMMPS.items()
    ]


def _methods(n_vertices: int, seed: int) -> list[Method]:
    springs = StrainedSprings.of(n_vertices, seed)
    return [*_own(springs), *_lammps(springs)]


TASKS = (
    Task(
        "strain_step",
        "a strain step, γ = 0.001",
        "largest error of a coordinate in mean edge lengths",
        SIZES,
        ("Newton", "L-BFGS", "FIRE", *_LAMMPS),
        "Newton",
        _methods,
        USEFUL,
    ),
)
