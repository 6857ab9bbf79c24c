"""Six populations of critical configurations of networks in three dimensions, strained past the transition.

The paper is about the plane; its theory is not.  Which of its findings on populations (`ResponseMetrics`) carry over to
periodic Voronoi networks in three dimensions, where four edges meet at every vertex?  Equal lengths often leave edges
slack there, so that the least length variance is not attained; the population then holds the cone program's
configuration, with equal lengths on all stressed edges.  The least tension variance is not attained either, edges
shrinking to zero length: what is stored for it belongs to a configuration on the way, with edges of a hundredth of the
mean length.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from critflow import CriticalManifold, critical_from_lengths, foam_network, optimize
from critflow.critical.objectives import OBJECTIVES
from critflow.mechanics.strain_path import check_strains
from critflow.networks.random_networks import FOAM_HARD_CORE
from critflow.workflow import Axis, Coordinate, Study, decimals, stable_rng

from ..ensemble.report import summary
from ..ensemble.verify import verify
from ..shared.checks import check_network, check_positive
from ..shared.measurements import measured, random_lengths, table
from .report import claims, response_figure

POPULATIONS = (*OBJECTIVES, "random_lengths", "random_stress")


@lru_cache(maxsize=2)
def prepared(n_vertices, seed, hard_core):
    """What the populations of one network share: the network and the symbolic analysis of its matrices."""
    return CriticalManifold(foam_network(n_vertices, seed, hard_core))


def configuration(manifold, parameters, seed, population):
    """One configuration of a population; the random ones draw numbers of their own for each network."""
    n_edges = manifold.network.n_edges
    if population in OBJECTIVES:
        method = "conic" if population == "length_variance" else "auto"
        return optimize(manifold, population, method, threshold=parameters["threshold"], throw=False)
    rng = stable_rng(seed, population)
    if population == "random_stress":
        return manifold.solve(np.abs(rng.standard_normal(n_edges)))
    return critical_from_lengths(manifold, random_lengths(rng, n_edges, parameters["spread"]), throw=False)


def case(parameters, *, seed, population, wanted):
    """A critical configuration, and its moduli at the transition and along the strain path."""
    manifold = prepared(parameters["n_vertices"], seed, parameters["hard_core"])
    network = manifold.network
    found = configuration(manifold, parameters, seed, population)
    shared = {"edges": network.edges, "offsets": network.offsets, "cell": network.cell, "status": found.status}
    if not np.isfinite(found.value.coordinates).all():
        return shared
    return {**shared, **measured(manifold, found, parameters, wanted)}


def check(parameters, axes):
    """Refuse settings that could only fail, before anything runs."""
    check_strains(parameters["strains"])
    check_positive(parameters, "threshold", "spread", "hard_core", "fit_window")
    check_network(foam_network, parameters["n_vertices"], axes["seed"][0], parameters["hard_core"])


study = Study(
    name="three_dimensions",
    version=2,
    title="Populations of critical configurations in three dimensions, strained past the rigidity transition",
    references="Hain, Santangelo and Manning, Optimizing properties on the critical rigidity manifold of "
    "underconstrained central-force networks (arXiv:2407.13939), whose networks are planar",
    axes=(
        Axis("seed", range(20), "seed of the network", noun="networks"),
        Axis("population", POPULATIONS, "population of critical configurations"),
    ),
    parameters={
        "n_vertices": 400,
        "hard_core": FOAM_HARD_CORE,
        "threshold": 0.1,
        "spread": 0.1,
        "strains": decimals("0.001:0.010:0.001"),
        "fit_window": 0.01,
    },
    coordinates=(Coordinate("strain", "strains", "volumetric strain past the transition"),),
    case=case,
    check=check,
    variables=tuple(table(planar=False)),
    figures={"response": response_figure},
    claims=claims,
    summary=summary,
    verify=verify,
)
