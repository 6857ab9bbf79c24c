"""From a thousand to a million vertices: seconds, memory and exponent of every stage; times differ from run to run.

One case takes one standard network through all that is known in closed form: it is made, its matrices are analysed, a
random stress gets its configuration, plainly and with its error bound, and a gradient; then the optimum of B_0 with its
certificate, the moduli at the transition and the exact C_B and C_G.  Short stages are repeated and the median counts.
"""

from __future__ import annotations

import time

import numpy as np

from critflow import Status, StudyError, elasticity, optimize, random_sequential_addition, stiffening, voronoi_of
from critflow.critical.manifold import CriticalManifold, critical_configuration
from critflow.critical.quantity import LengthVariance
from critflow.generators.random_networks import STANDARD_HARD_CORE
from critflow.workflow import Axis, Coordinate, Study, Variable, stable_rng

from ...shared.checks import check_positive
from ..backends import Backend
from .memory import peak_memory, restart_peak
from .report import claims, scale_figure, summary

STAGES = (
    "points",
    "tessellation",
    "analysis",
    "configuration",
    "checked",
    "gradient",
    "optimum",
    "moduli",
    "coefficients",
)


class _Clock:
    """Times and memory of the stages, in their order."""

    def __init__(self, least):
        self._least = least
        self.seconds, self.processor, self.memory, self.error = (np.full(len(STAGES), np.nan) for _ in range(4))
        self.repeats = np.zeros(len(STAGES), int)
        self.status = np.full(len(STAGES), int(Status.missing))
        self.backend = np.zeros(len(STAGES), int)

    def __call__(self, stage, work, *arguments):
        """The result of the work, repeated until the least time is spent; the median of the times is kept."""
        n, times, busy = STAGES.index(stage), [], []
        restart_peak()
        while sum(times) < self._least or not times:
            # The result of an earlier repeat is deleted first, so that memory is that of one.
            result = None
            start, started = time.perf_counter(), time.process_time()
            result = work(*arguments)
            times.append(time.perf_counter() - start)
            busy.append(time.process_time() - started)
        self.memory[n], self.repeats[n] = peak_memory(), len(times)
        self.seconds[n], self.processor[n] = np.median(times), np.median(busy)
        self.status[n] = Status.ok
        return result

    def note(self, stage, error, backend="none", status=Status.ok):
        """The error that a stage finds in its result."""
        n = STAGES.index(stage)
        self.error[n], self.backend[n], self.status[n] = error, Backend[backend], status


def case(parameters, *, n_vertices, seed):
    """Every stage of one network."""
    clock = _Clock(parameters["least_time"])
    n_cells = n_vertices // 2
    points = clock("points", _points, n_cells, seed)
    network = clock("tessellation", voronoi_of, points, np.sqrt(n_vertices))
    del points

    manifold = clock("analysis", CriticalManifold, network)
    sigma = stable_rng(seed, "stress", str(n_vertices)).uniform(0.5, 1.5, network.n_edges)
    balance = clock("configuration", manifold.balance, sigma)
    backend = balance.factor.backend
    plain = critical_configuration(network, sigma, network.all_coordinates(balance.coordinates))
    clock.note("configuration", plain.residual, backend)
    gradient = clock("gradient", _gradient, balance)
    # The configuration knows no scale of the stress, so no objective changes along it.
    clock.note("gradient", abs(gradient @ sigma) / (np.abs(gradient) @ sigma), backend)
    solved = clock("checked", manifold.solve, sigma)
    clock.note("checked", solved.stats.residual, backend, solved.status)
    error = np.abs(solved.value.bond_vectors - balance.bond_vectors).max()
    bound = float(solved.stats.error_bound)
    del balance, plain, gradient, solved

    best = clock("optimum", _optimum, manifold)
    gap = best.gap
    clock.note("optimum", abs(gap), backend, best.status)
    moduli = clock("moduli", elasticity, best.value).value
    clock.note("moduli", abs(moduli.bulk / best.bound - 1))
    # The configurations' part is not needed any more.
    del manifold
    found, backend = clock("coefficients", _coefficients, network, best.value)
    clock.note("coefficients", found.stats.residual, backend, found.status)
    return {
        "status": Status.ok,
        "seconds": clock.seconds,
        "processor_seconds": clock.processor,
        "repeats": clock.repeats,
        "memory": clock.memory,
        "error": clock.error,
        "stage_status": clock.status,
        "backend": clock.backend,
        "change_by_refinement": error,
        "error_bound": bound,
        "gap": gap,
        "bulk_modulus": moduli.bulk,
        "shear_modulus": moduli.shear,
        "C_B": found.value.C_B,
        "C_G": found.value.C_G,
    }


def _points(n_cells, seed):
    return random_sequential_addition(n_cells, STANDARD_HARD_CORE / np.sqrt(n_cells), np.random.default_rng(seed))


def _gradient(balance):
    """dV_L/dσ, (N_b,), on the factor of the configuration."""
    return balance.pull_back(*LengthVariance().evaluate(balance.sigma, balance.bond_vectors)[1])[0]


def _optimum(manifold):
    """The optimum of B_0 in closed form; its certificate is the bound, in closed form too, that no stress exceeds."""
    return optimize(manifold, "bulk_modulus", throw=False)


def _coefficients(network, critical):
    """C_B and C_G from the analysis of their matrix on, and the solver behind."""
    manifold = CriticalManifold(network)
    return stiffening(critical, throw=False, manifold=manifold), manifold.system(critical.sigma).backend


def check(parameters, axes):
    """Refuse settings that could only fail, before anything runs."""
    check_positive(parameters, "least_time")
    if parameters["stages"] != STAGES:
        raise StudyError(f"the stages are always all of {', '.join(STAGES)}: leave them as they are")
    for n_vertices in axes["n_vertices"]:
        if n_vertices % 2 or n_vertices < 40:
            raise StudyError(f"n_vertices={n_vertices} must be even and at least 40: every Voronoi cell brings two")


EACH = ("seed", "n_vertices")
STAGE = (*EACH, "stage")

study = Study(
    name="scale",
    version=2,
    title="Time and memory of every stage from 1,000 to 1,000,000 vertices (times differ from run to run)",
    axes=(
        Axis("seed", range(1), "seed of the network", noun="networks"),
        Axis(
            "n_vertices", (1_000, 3_162, 10_000, 31_622, 100_000, 316_228, 1_000_000), "number of vertices",
            key="n_vertices",
        ),
    ),
    parameters={"stages": STAGES, "least_time": 0.3},
    coordinates=(Coordinate("stage", "stages", "stage, in the order of the work"),),
    case=case,
    check=check,
    workers=1,
    variables=(
        Variable("seconds", STAGE, "f8", long_name="wall time, median of its repeats", units="s", volatile=True),
        Variable("processor_seconds", STAGE, "f8", long_name="the same on the processor", units="s", volatile=True),
        Variable("repeats", STAGE, "i4", long_name="how often a stage was repeated", volatile=True),
        Variable("memory", STAGE, "f8", long_name="peak resident memory in a stage", units="MB", volatile=True),
        Variable("error", STAGE, "f8", long_name="what a stage finds wrong with its own answer, relative"),
        Variable("stage_status", STAGE, "i1", long_name="outcome of a stage", flags=Status),
        Variable("backend", STAGE, "i1", long_name="sparse solver behind a stage", flags=Backend),
        Variable("change_by_refinement", EACH, "f8", long_name="largest difference of bond vectors, plain and checked"),
        Variable("error_bound", EACH, "f8", long_name="claimed bound on the error of the checked coordinates"),
        Variable("gap", EACH, "f8", long_name="1 − B_0 of the optimum over its closed-form bound"),
        Variable("bulk_modulus", EACH, "f8", long_name="largest bulk modulus at the transition [k]"),
        Variable("shear_modulus", EACH, "f8", long_name="shear modulus there [k]"),
        Variable("C_B", EACH, "f8", long_name="change of the bulk modulus with strain, exact [k]"),
        Variable("C_G", EACH, "f8", long_name="change of the shear modulus with strain, exact [k]"),
        Variable("status", EACH, "i1", long_name="whether the case was computed", flags=Status),
    ),
    figures={"scale": scale_figure},
    claims=claims,
    summary=summary,
)  # fmt: skip
