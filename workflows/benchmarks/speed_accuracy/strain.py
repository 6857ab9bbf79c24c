"""Task: one strain step of springs from their critical configuration, by minimisers of the energy.

All start from the same affinely strained state with the same springs, and stop at the same largest force component, in
units of k times the mean length.  Only the solve is timed: the symbolic analysis of critflow, the bonds and lists of
LAMMPS and the atoms of ASE are made before, and every run puts the vertices back where they start.

LAMMPS runs without pair forces, with the largest component as its norm and an energy tolerance of zero; it stops
where its line search finds no lower energy, and `forcezero` looks at forces instead.  ASE's defaults are made for eV
and Å; its quasi-Newton methods start from the stiffness of a vertex, 3k, instead of 70.  Step limits keep
iterative methods below some seconds; a method that reaches its limit has `Status.step_limit`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from critflow import CriticalManifold, Solution, Stats, Status, equilibrium, spring_state, voronoi_network
from critflow.linalg.factor import FixedPattern
from critflow.networks.network import Array
from critflow.precision.double_double import Extended, extended
from critflow.solvers.minimize import LBFGS, minimise
from critflow.springs.equilibrium import Relaxation
from critflow.springs.state import SpringState
from critflow.workflow import stable_rng

from ..lammps import Lammps, representable
from ..timing import Accuracy, Method, Task, installed, peer
from . import references
from .ase import ase_springs, atoms_of

STRAIN = 1e-3
# At most a hundredth of the error of the start.
USEFUL = 1e-5
SIZES = (100, 1_000, 10_000)
LEVELS = (1e-4, 1e-6, 1e-8, 1e-10, 1e-12, 1e-14)
# ASE's BFGS diagonalises a dense matrix in each step.
DENSE = 300

# Steps times vertices that take some seconds, and steps that small networks may take, each of a constant cost.
_FIRE_STEPS = (20_000_000, 20_000)
_LBFGS_STEPS = (5_000_000, 4_000)
_LAMMPS_STEPS = (200_000_000, 200_000)
_ASE_STEPS = (5_000_000, 20_000)
_DENSE_STEPS = (5_000_000, 200)
_LAMMPS = {
    "LAMMPS cg": ("cg", "line quadratic"),
    "LAMMPS cg forcezero": ("cg", "line forcezero"),
    "LAMMPS hftn": ("hftn", "line quadratic"),
    "LAMMPS fire": ("fire", "line quadratic"),
}
# Optimiser, options, and most steps.
_ASE: dict[str, tuple[str, dict[str, Any], tuple[int, int]]] = {
    "ASE FIRE": ("FIRE", {}, _ASE_STEPS),
    "ASE LBFGS": ("LBFGS", {"alpha": 3.0}, _ASE_STEPS),
    "ASE BFGS": ("BFGS", {"alpha": 3.0}, _DENSE_STEPS),
}


@dataclass(frozen=True, eq=False)
class StrainStep:
    """Springs strained affinely from their critical configuration, and where the free vertices end, exactly."""

    start: SpringState
    pattern: FixedPattern
    reference: Extended

    @classmethod
    def of(cls, n_vertices: int, seed: int) -> StrainStep:
        manifold = CriticalManifold(voronoi_network(n_vertices, seed))
        rng = stable_rng(seed, "contest", "stress")
        critical = manifold.configuration(np.abs(rng.standard_normal(manifold.network.n_edges)))
        F = np.sqrt(1 + STRAIN) * np.eye(2)
        start = spring_state(manifold.network.deformed(F), critical.lengths, critical.coordinates @ F.T)
        near = equilibrium(start, pattern=manifold.hessian).value.coordinates[start.network.free]
        state, _ = references.equilibrium(start.network, extended(critical.lengths), near, manifold.hessian)
        return cls(start, manifold.hessian, state.x)

    @property
    def unit(self) -> float:
        """Mean length of the edges at rest."""
        return self.start.length_scale

    def most_steps(self, work: int, most: int) -> int:
        return min(work // self.start.network.n_vertices, most)

    def fresh(self) -> SpringState:
        """The start without anything that was computed from it."""
        return replace(self.start)

    def accuracy(self, solution: Solution[SpringState]) -> Accuracy:
        """Largest error of a coordinate, in mean lengths; the vertex that is grounded stays where it is."""
        x = solution.value.coordinates[self.start.network.free]
        error = float(np.abs((x - self.reference.high) - self.reference.low).max())
        bound = float(solution.stats.error_bound)
        return Accuracy(error / self.unit, solution.status, solution.stats.steps, bound / self.unit)

    def peer_accuracy(self, answer: tuple[Array, Status, int]) -> Accuracy:
        """The same for coordinates (N_v, 2) that the box may have wrapped and that have drifted."""
        x, status, iterations = answer
        side = self.start.network.cell[0, 0]  # type: ignore[index]
        exact = self.start.coordinates.copy()
        exact[self.start.network.free] = self.reference.high
        off = x - exact
        for _ in range(2):
            off -= side * np.round(off / side)
            off -= off.mean(axis=0)
        return Accuracy(float(np.abs(off).max()) / self.unit, status, iterations)


def _own(step: StrainStep) -> list[Method]:
    def by(method: str, most_steps: int | None, tolerance: float) -> Solution[SpringState]:
        return equilibrium(step.fresh(), method, tolerance, most_steps, step.pattern, throw=False)

    def by_lbfgs(tolerance: float) -> Solution[SpringState]:
        state = step.fresh()
        limit = step.most_steps(*_LBFGS_STEPS)
        end = minimise(Relaxation(state), LBFGS(), np.zeros(state.forces.size), tolerance * step.unit, limit)
        value = state.moved(end.point.x.reshape(state.forces.shape))
        return Solution(value, end.status, Stats("lbfgs", end.steps, residual=end.point.residual))

    return [
        Method("Newton", partial(by, "newton", None), step.accuracy, LEVELS, backend="qdldl"),
        Method("L-BFGS", by_lbfgs, step.accuracy, LEVELS),
        Method("FIRE", partial(by, "fire", step.most_steps(*_FIRE_STEPS)), step.accuracy, LEVELS),
    ]


def _lammps(step: StrainStep) -> list[Method]:
    if not representable(step.start):
        return []
    engine = Lammps(step.start) if installed("lammps") else None
    most_steps = step.most_steps(*_LAMMPS_STEPS)

    def run(style: str, options: str, tolerance: float) -> tuple[Array, Status, int]:
        assert engine is not None
        x, iterations, force = engine.relax(style, options, tolerance * step.unit, most_steps)
        short = Status.stalled if iterations < most_steps else Status.step_limit
        return x, Status.ok if force <= tolerance * step.unit else short, iterations

    return [
        Method(name, partial(run, style, options), step.peer_accuracy, LEVELS, "lammps")
        for name, (style, options) in _LAMMPS.items()
    ]


def _ase(step: StrainStep) -> list[Method]:
    def run(
        method: str, options: dict[str, Any], limits: tuple[int, int], tolerance: float
    ) -> tuple[Array, Status, int]:
        atoms = start.copy()
        atoms.calc = calculator
        optimizer = getattr(optimizers, method)(atoms, logfile=None, **options)
        done = optimizer.run(fmax=tolerance * step.unit, steps=step.most_steps(*limits))
        return atoms.positions[:, :2], Status.ok if done else Status.step_limit, optimizer.nsteps

    if installed("ase"):
        start, calculator, optimizers = atoms_of(step.start), ase_springs(step.start), peer("ase.optimize")
    small = step.start.network.n_vertices <= DENSE
    return [
        Method(name, partial(run, *choice), step.peer_accuracy, LEVELS, "ase")
        for name, choice in _ASE.items()
        if small or choice[0] != "BFGS"
    ]


def _methods(n_vertices: int, seed: int) -> list[Method]:
    step = StrainStep.of(n_vertices, seed)
    return [*_own(step), *_lammps(step), *_ase(step)]


TASKS = (
    Task(
        "strain_step",
        "a strain step, γ = 0.001",
        "largest error of a coordinate in mean edge lengths",
        SIZES,
        ("Newton", "L-BFGS", "FIRE", *_LAMMPS, *_ASE),
        "Newton",
        _methods,
        USEFUL,
    ),
)
