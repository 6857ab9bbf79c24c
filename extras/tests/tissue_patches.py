"""Tables of a tissue, and tissues under pressure, for the tests of several extras."""

import numpy as np

from critflow import voronoi_network

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


def loaded(n_vertices=20, seed=1, size=0.1):
    """A network with random stresses and pressures."""
    network, rng = voronoi_network(n_vertices, seed), np.random.default_rng(seed)
    return (
        network,
        np.exp(0.3 * rng.standard_normal(network.n_edges)),
        size * rng.standard_normal(network.faces.n_faces),
    )
