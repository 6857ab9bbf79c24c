"""Disordered networks in three dimensions, the Voronoi tessellations of random points with a hard core: foams.

Four edges meet at a vertex, so that N_b = 2 N_v, and the volume is V = N_v.
"""

from __future__ import annotations

import math

import numpy as np

from critflow.arguments import generator, of_kind
from critflow.calls import running
from critflow.checks import check_size
from critflow.networks import Array, Network
from critflow.points import LAYERS, check_addition, delaunay_simplices, random_sequential_addition, voronoi_network
from critflow.result import InputError

FOAM_HARD_CORE = 0.87
"""Hard core of the standard networks, in units of 1/n_cells^(1/3)."""

# Mean number of vertices of a cell of a foam at the standard hard core, each counted in the four cells that share it.
_VERTICES_A_CELL = 6.467
_FEWEST_CELLS, _MAX_DRAWS = 8, 3000
# Layers of images, in units of the spacing of points, which are enough for a hard core: spheres without a point then
# have radii up to 0.95, and a sixth of the images is laid out.
_FEW_LAYERS = 1.0


@running("foam_network")
def foam_network(
    n_vertices: int = 400, seed: int | np.random.Generator = 0, hard_core: float = FOAM_HARD_CORE
) -> Network:
    """The disordered network in three dimensions: exactly n_vertices, four edges a vertex, volume V = n_vertices.

    A cell has about 6.47 vertices, not a fixed number, so points are drawn until the number of vertices is n_vertices:
    about 13 draws for 400 vertices, and √10 times this number for ten times as many vertices.  The same seed gives the
    same network, always.  Raises `InputError` for too few vertices and for a hard core (ρ, in units of 1/n_cells^(1/3))
    that leaves too little space for all points.

    >>> import critflow as cf
    >>> import critflow_extras as ce
    >>> ce.foam_network(n_vertices=60, seed=1).dimension
    3
    """
    n_vertices = of_kind(int, n_vertices=n_vertices)
    seed = of_kind(int, np.random.Generator, seed=seed)
    of_kind(float, hard_core=hard_core)
    check_foam(n_vertices, hard_core)
    n_cells = round(n_vertices / _VERTICES_A_CELL)
    rng = generator(seed)
    for _ in range(_MAX_DRAWS):
        points = random_sequential_addition(n_cells, hard_core / n_cells ** (1 / 3), rng, dimension=3)
        if count_simplices(points) == n_vertices:
            return voronoi_network(points=points)
    raise InputError(
        f"{n_cells} cells never had {n_vertices} vertices in {_MAX_DRAWS} draws: hard_core={hard_core:g} is far from "
        f"its standard {FOAM_HARD_CORE}, so make the network by voronoi_network(points=...)"
    )


def check_foam(n_vertices: int, hard_core: float = FOAM_HARD_CORE) -> None:
    """Raise `InputError` for arguments without a `foam_network`, without making one."""
    if n_vertices < _FEWEST_CELLS * _VERTICES_A_CELL:
        raise InputError(
            f"n_vertices must be a whole number of at least {int(np.ceil(_FEWEST_CELLS * _VERTICES_A_CELL))}, "
            f"not {n_vertices}: a foam of fewer cells meets images of itself"
        )
    check_size(n_vertices)
    n_cells = round(n_vertices / _VERTICES_A_CELL)
    check_addition(n_cells, hard_core / n_cells ** (1 / 3), dimension=3)


def count_simplices(points: Array) -> int:
    """Number of Delaunay simplices of points (n, d) in the periodic unit cube, each a vertex of the Voronoi network."""
    dimension = points.shape[1]
    for layers in (_FEW_LAYERS, LAYERS):
        corners, _ = delaunay_simplices(points, np.eye(dimension), layers)
        places = points[corners[:, :, 0]] + corners[:, :, 1:]
        volume = np.abs(np.linalg.det(places[:, 1:] - places[:, :1])).sum() / math.factorial(dimension)
        # A hole wider than the layers would leave a part of the cell without simplices.
        if abs(volume - 1) < 1e-9:
            break
    return len(corners)
