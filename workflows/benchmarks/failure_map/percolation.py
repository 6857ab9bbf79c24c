"""Percolation of stress: slack edges against the spread of the rest lengths and the size."""

from __future__ import annotations

import numpy as np

from critflow import CriticalManifold, Status, critical_from_lengths, voronoi_network
from critflow.onset.from_lengths import stressed_fraction
from critflow.workflow import stable_rng

from ...shared.populations import random_lengths


def percolation(sizes, spreads, networks, seed):
    """Arrays (size, spread): networks solved, the part of them with every edge stressed, the mean part of such edges.

    Rest lengths of one network are the same numbers for every spread, scaled.
    """
    solved = np.zeros((len(sizes), len(spreads)), int)
    full, part = np.zeros(solved.shape), np.zeros(solved.shape)
    for row, (size, count) in enumerate(zip(sizes, networks, strict=True)):
        for member in range(seed * count, (seed + 1) * count):
            manifold = CriticalManifold(voronoi_network(size, member))
            for column, spread in enumerate(spreads):
                rng = stable_rng(member, "percolation", str(size))
                lengths = random_lengths(rng, manifold.network.n_edges, spread)
                found = critical_from_lengths(manifold, lengths, throw=False)
                if found.status in (Status.ok, Status.slack_edges):
                    solved[row, column] += 1
                    full[row, column] += found.ok
                    part[row, column] += stressed_fraction(found.value.sigma)
    known = np.where(solved > 0, solved, np.nan)
    return solved, full / known, part / known
