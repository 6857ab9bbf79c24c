"""One standard network of up to a million vertices through all that is known in closed form: seconds and memory.

It is made, the matrix of its configurations is analysed, a random stress gets its configuration, plainly and with its
error bound, and a gradient; then the optimum of B_0 with its certificate, the moduli at the transition and the exact
C_B and C_G.  Short stages are repeated.  The error of a stage is what it finds wrong with its own answer: no reference
is as fast.
"""

import contextlib
import resource
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from critflow import Network, Status, optimize, stiffening
from critflow.elastic import elasticity
from critflow.engine import stable_rng
from critflow.manifold import CriticalConfiguration, CriticalManifold, critical_configuration
from critflow.points import STANDARD_HARD_CORE, random_sequential_addition, voronoi_network
from critflow.quantities import LengthVariance

from ..timing import Method, Timing, stopwatch

WORD = "stages"
SIZES = (1_000, 10_000, 100_000, 1_000_000)
STAGES = (
    *("points", "tessellation", "analysis", "configuration", "checked", "gradient"),
    *("optimum", "moduli", "coefficients"),
)
_PROCESS = Path("/proc/self")


class _Stages:
    """Timings of the stages, in their order, each repeated until `least` seconds are spent."""

    def __init__(self, least: float):
        self.least = least
        self.timings: list[Timing] = []

    def __call__(self, name: str, work: Callable[..., Any], *arguments: Any) -> Any:
        """The result of the work."""
        timing = Timing(Method(name, lambda: work, abs), 0, Status.ok)
        # The peak is reset where the system allows it, as Linux does; else it is that of the process so far.
        with contextlib.suppress(OSError):
            (_PROCESS / "clear_refs").write_text("5", encoding="ascii")
        while sum(timing.wall) < self.least or not timing.wall:
            # The result of an earlier repeat is deleted first, so that memory is that of one.
            result = None
            result, *spent = stopwatch(work, *arguments)
            timing = timing.repeated(*spent)
        self.timings.append(replace(timing, memory=_peak_memory()))
        return result

    def note(self, error: float, backend: str = "", status: Status = Status.ok) -> None:
        """The error, solver and status of the last stage."""
        last = self.timings[-1]
        method = replace(last.method, backend=backend)
        self.timings[-1] = replace(last, method=method, error=error, status=status)


def _peak_memory() -> float:
    """Peak resident memory of the process in MB."""
    with contextlib.suppress(OSError):
        for line in (_PROCESS / "status").read_text(encoding="ascii").splitlines():
            if line.startswith("VmHWM"):
                return int(line.split()[1]) / 1e3 * 1.024
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / 1e6 if sys.platform == "darwin" else peak * 1.024 / 1e3


def measured(n_vertices: int, seed: int, least: float) -> list[Timing]:
    """Timings of every stage of one network."""
    stage, n_cells = _Stages(least), n_vertices // 2
    points = stage("points", _points, n_cells, seed)
    network = stage("tessellation", _tessellated, points)
    del points
    manifold = stage("analysis", _analysed, network)
    sigma = stable_rng(seed, "stress", str(n_vertices)).uniform(0.5, 1.5, network.n_edges)
    balance = stage("configuration", manifold.balance, sigma)
    backend = manifold.prestress.backend
    plain = critical_configuration(network, sigma, network.all_coordinates(balance.coordinates))
    stage.note(plain.residual, backend)
    gradient = stage("gradient", _gradient, balance)
    # The configuration knows no scale of the stress, so no objective changes along it.
    stage.note(abs(gradient @ sigma) / (np.abs(gradient) @ sigma), backend)
    solved = stage("checked", manifold.solve, sigma)
    stage.note(solved.stats.residual, backend, solved.status)
    del balance, plain, gradient, solved

    best = stage("optimum", _optimum, manifold)
    stage.note(abs(best.gap), backend, best.status)
    moduli = stage("moduli", elasticity, best.value)
    stage.note(abs(moduli.value.bulk / best.bound - 1))
    # The configurations' part is not needed any more.
    del manifold
    exact, backend = stage("coefficients", _coefficients, network, best.value)
    stage.note(exact.stats.residual, backend, exact.status)
    return stage.timings


def _tessellated(points: np.ndarray) -> Network:
    return voronoi_network(points=points)


def _points(n_cells: int, seed: int) -> np.ndarray:
    return random_sequential_addition(n_cells, STANDARD_HARD_CORE / np.sqrt(n_cells), np.random.default_rng(seed))


def _analysed(network: Network) -> CriticalManifold:
    """The manifold after the symbolic analysis: with it a first configuration takes several times as long as a next."""
    manifold = CriticalManifold(network)
    manifold.prestress.analyse()
    return manifold


def _gradient(balance: Any) -> np.ndarray:
    """dV_L/dσ, (N_b,), on the factor of the configuration."""
    return balance.pull_back(*LengthVariance().evaluate(balance)[1])[0]


def _optimum(manifold: CriticalManifold) -> Any:
    """The optimum of B_0 in closed form; its certificate is the bound, in closed form too, that no stress exceeds."""
    return optimize(manifold, "B_0", throw=False)


def _coefficients(network: Network, critical: CriticalConfiguration) -> tuple[Any, str]:
    """C_B and C_G from the analysis of their matrix on, and the solver behind."""
    manifold = CriticalManifold(network)
    return stiffening(critical, throw=False), manifold.saddle.pattern.backend
