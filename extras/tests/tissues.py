"""Tissues at their transition."""

from functools import lru_cache

import numpy as np

from critflow import Status, voronoi_network
from critflow_extras import critical_from_perimeters


@lru_cache
def disordered_tissue(seed=1, n_vertices=100, varied=False):
    """Faces of equal perimeters, or of random ones, and their transition."""
    rng, n_faces = np.random.default_rng(seed), n_vertices // 2
    perimeters = 1 + 0.03 * rng.standard_normal(n_faces) if varied else np.ones(n_faces)
    stiffness = rng.uniform(0.5, 2.0, n_faces) if varied else 1.0
    solution = critical_from_perimeters(voronoi_network(n_vertices, seed=seed), perimeters, stiffness=stiffness)
    assert solution.status is Status.ok
    return perimeters, solution
