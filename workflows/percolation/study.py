"""Percolation of stress: slack edges against the spread of the rest lengths and the size of the network.

Rest lengths of one network are the same random numbers for every spread, scaled.  The paper prints a spread of 0.3 for
populations in which every edge is stressed.
"""

from __future__ import annotations

import numpy as np

from critflow import CriticalManifold, Status, critical_from_lengths, voronoi_network
from critflow.generators.random_networks import check_voronoi
from critflow.onset.from_lengths import stressed_fraction
from critflow.workflow import Axis, Coordinate, Study, Variable, stable_rng

from ..shared.checks import check_network
from ..shared.populations import random_lengths
from ..shared.reports import PAPER
from .report import claims, percolation_figure, summary


def case(parameters, *, seed, n_vertices):
    """The part of the edges of one network that is stressed, at every spread."""
    manifold, statuses, stressed = CriticalManifold(voronoi_network(n_vertices, seed)), [], []
    for spread in parameters["spreads"]:
        lengths = random_lengths(stable_rng(seed, "percolation", str(n_vertices)), manifold.network.n_edges, spread)
        solution = critical_from_lengths(manifold, lengths, throw=False)
        solved = solution.status in (Status.ok, Status.slack_edges)
        statuses.append(solution.status)
        stressed.append(stressed_fraction(solution.value.sigma) if solved else np.nan)
    return {"status": Status.ok, "solve_status": statuses, "stressed_fraction": stressed}


def check(parameters, axes):
    """Refuse sizes without a network, before anything runs."""
    for n_vertices in axes["n_vertices"]:
        check_network(check_voronoi, n_vertices)


EACH = ("seed", "n_vertices")

study = Study(
    name="percolation",
    title="Percolation of stress against the spread of the rest lengths and the size of the network",
    references=PAPER,
    axes=(
        Axis("seed", range(80), "seed of the network", noun="networks"),
        Axis("n_vertices", (50, 100, 200, 400, 1000), "number of vertices", key="n_vertices"),
    ),
    parameters={"spreads": (0.02, 0.04, 0.06, 0.08, 0.1, 0.12, 0.14, 0.16, 0.18, 0.2, 0.25, 0.3, 0.4, 0.5)},
    coordinates=(Coordinate("spread", "spreads", "spread s of the rest lengths"),),
    case=case,
    check=check,
    variables=(
        Variable("stressed_fraction", (*EACH, "spread"), "f8", long_name="part of the edges under tension"),
        Variable("solve_status", (*EACH, "spread"), "i1", long_name="outcome by spread", flags=Status),
        Variable("status", EACH, "i1", long_name="whether the case was computed", flags=Status),
    ),
    figures={"percolation": percolation_figure},
    claims=claims,
    summary=summary,
)
