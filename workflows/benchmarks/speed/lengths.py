"""Task rest lengths → critical configuration: the box is expanded until the network is rigid, or a cone program solved.

All edges are stressed, so there is one answer.  The strain protocol of the paper stops at the first step past the
transition that has the energy of a threshold, and its error is its distance past it: its levels are strain steps, with
thresholds of half a step's energy.
"""

from collections.abc import Callable
from functools import partial

import numpy as np

from critflow import CriticalManifold, Status, critical_from_lengths, voronoi_network
from critflow.lengths.boundary import Expansion
from critflow.lengths.cone import fit_lengths
from critflow.lengths.taut_edges import OnsetState, newton_taut
from critflow.precision.double_double import Extended
from critflow.workflow import stable_rng

from ...shared.populations import random_lengths
from ...shared.strain_protocol import critical_by_strain
from ..timing import Answer, Method, Task
from . import references

SIZES = (100, 1_000, 10_000)
# Spreads of the rest lengths, the first one taken for which all edges are stressed.
SPREADS = (0.1, 0.05, 0.02)
# FIRE needs 10⁴ steps and more a strain step.
FIRE_SIZE = 200
STRAIN_STEPS = (1e-2, 1e-3, 1e-4, 1e-5)
CONE = (1e-4, 1e-6, 1e-8, 1e-10, 1e-12)


def error_of_stress(best: Extended) -> Callable[[np.ndarray], float]:
    """Largest error of a stress over the mean stress; scales are compared by their projection."""

    def error(sigma: np.ndarray) -> float:
        scaled = sigma * ((sigma @ best.high) / (sigma @ sigma))
        return float(np.abs((scaled - best.high) - best.low).max() / best.high.mean())

    return error


def _problem(n_vertices: int, seed: int) -> tuple[CriticalManifold, np.ndarray, Extended]:
    manifold = CriticalManifold(voronoi_network(n_vertices, seed))
    noise = stable_rng(seed, "contest", "lengths")
    for spread in SPREADS:
        lengths = random_lengths(noise, manifold.network.n_edges, spread)
        best = references.stress_of_lengths(manifold, lengths)
        if best is not None:
            return manifold, lengths, best
    raise ValueError("some edges are slack at every spread of the rest lengths")


def _methods(n_vertices: int, seed: int) -> list[Method]:
    manifold, lengths, best = _problem(n_vertices, seed)
    network, error = manifold.network, error_of_stress(best)
    path = Expansion(manifold)

    def auto(level: float) -> Answer:
        solution = critical_from_lengths(manifold, lengths, throw=False)
        return Answer(solution.value.sigma, solution.status, solution.stats.steps + solution.polish_steps)

    def cone(level: float) -> Answer:
        fit = fit_lengths(network.free_incidence, network.boundary_vectors, lengths, level)
        return Answer(fit.sigma, Status.ok if fit.solved else Status.stalled, fit.steps)

    def polished(level: float) -> Answer:
        fit = fit_lengths(network.free_incidence, network.boundary_vectors, lengths, level)
        start = OnsetState(0.0, np.zeros(0), fit.coordinates, fit.sigma, np.ones(network.n_edges, bool))
        end = newton_taut(path, fit.ratio * lengths, start)
        status = Status.ok if fit.solved and (end.sigma > 0).all() else Status.stalled
        return Answer(end.sigma, status, fit.steps + end.steps)

    def strain(level: float, relaxation: str) -> Answer:
        # An energy of springs stretched by half a step beyond the transition.
        threshold = 0.5 * float(np.sum((0.5 * level * lengths) ** 2))
        solution = critical_by_strain(manifold, lengths, relaxation, level, threshold)
        return Answer(solution.value.sigma, solution.status, solution.stats.steps)

    methods = [
        Method("auto", auto, error),
        Method("cone + Newton", polished, error, CONE),
        Method("cone", cone, error, CONE),
        Method("strain Newton", partial(strain, relaxation="newton"), error, STRAIN_STEPS),
    ]
    if n_vertices <= FIRE_SIZE:
        methods.append(Method("strain FIRE", partial(strain, relaxation="fire"), error, STRAIN_STEPS[:2]))
    return methods


TASKS = (
    Task(
        "rest_lengths",
        "rest lengths → critical configuration",
        "largest error of a stress over the mean stress",
        SIZES,
        ("auto", "cone + Newton", "cone", "strain Newton", "strain FIRE"),
        "auto",
        _methods,
    ),
)
