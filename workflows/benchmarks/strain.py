"""Task: one strain step of springs from their critical configuration, by minimisers of the energy.

All start from the same affinely strained state with the same springs.  Levels are the largest force component where
they stop, in units of γ² k times the mean length: modes along which lengths stay have the stiffness γ k, and the step
moves vertices by γ times the length, so that the level is about the error that it leaves.  The default has levels too:
its number of steps, the last without limit.  The stress is random: at the largest B_0 the affine state is the
equilibrium already, and no method has anything to do.

LAMMPS runs without pair forces, with the largest component as its norm and an energy tolerance of zero; it stops
where its line search finds no lower energy, and `forcezero` looks at forces instead.  SciPy has energy, forces and
products with the Hessian from critflow.  Step limits keep methods below some tenths of a second; a method that reaches
its limit has `Status.step_limit`.
"""

from dataclasses import replace
from functools import partial

import numpy as np

from critflow import Status, equilibrium
from critflow.equilibria import LONGEST_MOVE, TIME_STEP, Relaxation
from critflow.minimisers import Point, fire, lbfgs, minimise
from critflow.networks import Array
from critflow.springs import SpringState

from .lammps import Lammps, representable
from .scipy_methods import by_scipy
from .springs import StrainedSprings, prepared
from .timing import TALLY, Answer, Method, Run, Task

SIZES = (100, 1_000, 10_000)
LEVELS = (1.0, 1e-1, 1e-2, 1e-3, 1e-4, 1e-6, 1e-8, 1e-10)
# Steps of the default; the last is no limit.
STEPS = (1, 2, 3, 4, 5, 6, 0)
# Steps times the root of the vertices that take some tenths of a second.
LIMITS = {"FIRE": 100_000, "L-BFGS": 20_000, "LAMMPS": 400_000, "SciPy L-BFGS-B": 20_000, "SciPy trust-krylov": 3_000}
_LAMMPS = {
    "LAMMPS cg": ("cg", "line quadratic"),
    "LAMMPS cg forcezero": ("cg", "line forcezero"),
    "LAMMPS hftn": ("hftn", "line quadratic"),
    "LAMMPS fire": ("fire", "line quadratic"),
}


def error(springs: StrainedSprings, coordinates: Array) -> float:
    """Largest error of a coordinate over that of the start; the vertex that is grounded stays where it is."""
    return _distance(springs, coordinates) / _distance(springs, springs.start.coordinates)


def _distance(springs: StrainedSprings, coordinates: Array) -> float:
    reference = springs.exact[0].x
    x = coordinates[springs.start.network.free]
    return float(np.abs((x - reference.high) - reference.low).max())


def peer_error(springs: StrainedSprings, coordinates: Array) -> float:
    """The same for coordinates (N_v, 2) that the box may have wrapped and that have drifted."""
    network, exact = springs.start.network, springs.start.coordinates.copy()
    exact[network.free] = springs.exact[0].x.high
    return apart(coordinates, exact, network.cell[0, 0]) / _distance(springs, springs.start.coordinates)


def apart(coordinates: Array, exact: Array, side: float) -> float:
    """Largest distance in a component between coordinates that a box may have wrapped and that have drifted."""
    difference = coordinates - exact
    for _ in range(2):
        difference -= side * np.round(difference / side)
        difference -= difference.mean(axis=0)
    return float(np.abs(difference).max())


def _by_newton(springs: StrainedSprings) -> Run:
    start = prepared(springs.start)

    def run(steps: float) -> Answer:
        # A copy of the start has nothing that was computed from it.
        solution = equilibrium(replace(start), max_steps=int(steps) or None, throw=False)
        short = steps and solution.status is Status.step_limit
        return Answer(solution.value.coordinates, Status.ok if short else solution.status)

    return run


class _Energy(Relaxation):
    """The energy with products of its Hessian, for SciPy."""

    def at(self, x: Array) -> Point:
        point = super().at(x)
        return replace(point, state=self._state.moved(x.reshape(self._state.forces.shape)))

    def hessian_product(self, point: Point, direction: Array) -> Array:
        TALLY["evaluations"] += 1
        state = point.state
        return -state.force_rates(state.edge_rates(direction.reshape(state.forces.shape))).ravel()


# Minimisers, prepared for a start: largest force component -> coordinates and status


def _by_minimiser(start: SpringState, name: str, limit: int) -> Run:
    step = TIME_STEP * 2 / np.sqrt(start.largest_stiffness)
    method = partial(fire, time_step=step, max_move=LONGEST_MOVE * start.length_scale) if name == "FIRE" else lbfgs

    def run(force: float) -> Answer:
        state = replace(start)
        end, status, _ = minimise(Relaxation(state), method, np.zeros(state.forces.size), force, limit)
        return Answer(state.moved(end.x.reshape(state.forces.shape)).coordinates, status)

    return run


def _by_scipy(start: SpringState, name: str, limit: int) -> Run:
    solved = by_scipy(_Energy(start), name.split()[1], np.zeros(start.forces.size), limit)

    def run(force: float) -> Answer:
        u, status = solved(force)
        return Answer(start.moved(u.reshape(start.forces.shape)).coordinates, status)

    return run


def _by_lammps(start: SpringState, name: str, limit: int) -> Run:
    engine = Lammps(start)

    def run(force: float) -> Answer:
        x, evaluations, left = engine.relax(*_LAMMPS[name], force, limit)
        TALLY["evaluations"] += evaluations
        short = Status.stalled if evaluations < limit else Status.step_limit
        return Answer(x, Status.ok if left <= force else short)

    return run


# Package and maker of each.
MINIMISERS = {
    "L-BFGS": ("critflow", _by_minimiser),
    "FIRE": ("critflow", _by_minimiser),
    "SciPy L-BFGS-B": ("scipy", _by_scipy),
    "SciPy trust-krylov": ("scipy", _by_scipy),
    **dict.fromkeys(_LAMMPS, ("lammps", _by_lammps)),
}


def relaxer(start: SpringState, name: str) -> Run:
    """A minimiser by name with its step limit, prepared for a start."""
    work = LIMITS.get(name) or LIMITS[name.split()[0]]
    return MINIMISERS[name][1](prepared(start), name, int(work / np.sqrt(start.network.n_vertices)))


def _by_level(springs: StrainedSprings, name: str) -> Run:
    run = relaxer(springs.start, name)
    return lambda level: run(level * springs.softest)


def _methods(n_vertices: int, seed: int, gamma: float) -> list[Method]:
    springs = StrainedSprings.of(n_vertices, seed, gamma)
    methods = [Method("Newton", partial(_by_newton, springs), partial(error, springs), STEPS, backend="qdldl")]
    for name, (package, _) in MINIMISERS.items():
        judged = partial(peer_error if name in _LAMMPS else error, springs)
        if name not in _LAMMPS or representable(springs.start):
            methods.append(Method(name, partial(_by_level, springs, name), judged, LEVELS, package))
    return methods


TASKS = (
    Task(
        "strain_step",
        "a strain step γ from the transition",
        "largest error of a coordinate over that of the affine start",
        SIZES,
        ("Newton", *MINIMISERS),
        "Newton",
        _methods,
        strained=True,
    ),
)
