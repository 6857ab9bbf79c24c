"""The populations of critical configurations that several studies compare."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from critflow import CriticalConfiguration, CriticalManifold, Solution, critical_from_lengths, optimize, voronoi_network
from critflow.critical.objectives import OBJECTIVES
from critflow.workflow import stable_rng

from .measurements import random_lengths

POPULATIONS = (*OBJECTIVES, "random_lengths", "random_stress", "random_lengths_wide")
LABELS = {
    "length_variance": "min $V_L$",
    "tension_variance": "min $V_\\tau$",
    "bulk_modulus": "max $B_0$",
    "shear_modulus": "max $G_0$",
    "random_lengths": "random $\\ell$",
    "random_stress": "random $\\sigma$",
    "random_lengths_wide": "random $\\ell$, wide",
}


@lru_cache(maxsize=2)
def prepared(n_vertices, seed, hard_core):
    """What the populations of one network share: the network and the symbolic analysis of its matrices."""
    return CriticalManifold(voronoi_network(n_vertices, seed, hard_core))


def configuration(manifold, parameters, seed, population) -> Solution[CriticalConfiguration]:
    """One configuration of a population; the random ones draw numbers of their own for each network."""
    n_edges = manifold.network.n_edges
    if population in OBJECTIVES:
        return optimize(manifold, population, threshold=parameters["threshold"], throw=False)
    rng = stable_rng(seed, population)
    if population == "random_stress":
        return manifold.solve(np.abs(rng.standard_normal(n_edges)))
    spread = parameters["spread_wide" if population == "random_lengths_wide" else "spread"]
    lengths = random_lengths(rng, n_edges, spread)
    return critical_from_lengths(manifold, lengths, parameters["protocol"], throw=False)
