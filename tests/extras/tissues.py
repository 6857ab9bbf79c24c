"""Tissues, and tables of one, for the tests of several extras."""

from functools import lru_cache

import numpy as np

from critflow import Status, critical_from_perimeters, voronoi_network

VORONOI = voronoi_network(n_vertices=40, seed=1)


def tissue(tmp_path, noise):
    """Tables of a patch of a tessellation: with the vertices of two edges held it is critical, up to the noise."""
    inner = (VORONOI.offsets == 0).all(axis=1)
    edges = VORONOI.edges[inner]
    while (hanging := (np.bincount(edges.ravel(), minlength=40)[edges] == 1).any(axis=1)).any():
        edges = edges[~hanging]
    x = VORONOI.positions + noise * np.random.default_rng(0).normal(size=(40, 2))
    vertices = "".join(f"{v},{x[v, 0]:.15g},{x[v, 1]:.15g}\n" for v in np.unique(edges))
    (tmp_path / "t_vertices.csv").write_text(f"id,x,y\n{vertices}")
    (tmp_path / "t_edges.csv").write_text("tail,head\n" + "".join(f"{a},{b}\n" for a, b in edges))
    return tmp_path / "t.csv"


@lru_cache
def disordered_tissue(seed=1, n_vertices=100, varied=False):
    """Faces of equal perimeters, or of random ones, and their transition."""
    rng, n_faces = np.random.default_rng(seed), n_vertices // 2
    perimeters = 1 + 0.03 * rng.standard_normal(n_faces) if varied else np.ones(n_faces)
    stiffness = rng.uniform(0.5, 2.0, n_faces) if varied else 1.0
    solution = critical_from_perimeters(voronoi_network(n_vertices, seed=seed), perimeters, stiffness=stiffness)
    assert solution.status is Status.ok
    return perimeters, solution
