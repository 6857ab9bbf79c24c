"""Networks of random points: their Delaunay triangulation, in two and three dimensions."""

from __future__ import annotations

from itertools import combinations

import numpy as np
from numpy.typing import ArrayLike

from critflow.arguments import generator, of_kind
from critflow.calls import running
from critflow.generators.random_networks import N_VERTICES, STANDARD_HARD_CORE, check_alone
from critflow.generators.random_points import points_in_cell
from critflow.generators.tessellations import Tiling, distinct, periodic_delaunay
from critflow.networks.checks import checked_cell
from critflow.networks.network import Network
from critflow.result import InputError


@running("delaunay_network")
def delaunay_network(
    n_vertices: int | None = None,
    seed: int | np.random.Generator = 0,
    hard_core: float = STANDARD_HARD_CORE,
    cell: ArrayLike | None = None,
    points: ArrayLike | None = None,
) -> Network:
    """The Delaunay triangulation of random points: exactly n_vertices, N_b = 3 N_v, area V = n_vertices.

    The arguments are those of `voronoi_network`, except that the points are the vertices; in three dimensions, where
    `cell` is (3, 3), about 15 edges meet at a vertex.
    Raises `InputError` for too few vertices, for a hard core (ρ, in units of 1/n_vertices^(1/d)) that leaves too
    little space for all points, and for points that are too few or too regular.

    >>> import critflow as cf
    >>> cf.delaunay_network(n_vertices=20, seed=1)
    Network(20 vertices, 60 edges, 2 dimensions, periodic, z = 6)
    """
    n_vertices = of_kind(int, None, n_vertices=n_vertices)
    seed = of_kind(int, np.random.Generator, seed=seed)
    of_kind(float, hard_core=hard_core)
    of_kind(np.ndarray, None, cell=cell, points=points)
    if points is not None:
        check_alone(n_vertices)
        return delaunay_tessellation(points, cell)
    n_vertices = N_VERTICES if n_vertices is None else n_vertices
    if n_vertices < 4:
        raise InputError(f"n_vertices must be a whole number of at least 4, not {n_vertices}")
    shape = np.eye(2) if cell is None else checked_cell(cell)
    scale = (n_vertices / abs(np.linalg.det(shape))) ** (1 / len(shape))
    points = points_in_cell(n_vertices, hard_core, generator(seed), shape)
    return delaunay_tessellation(points, scale * shape)


def delaunay_tessellation(points: ArrayLike, cell: ArrayLike | None = None) -> Network:
    """The periodic Delaunay network of points (n, d) in units of the cell vectors: N_b = 3 N_v in the plane.

    The vertices are the points, in their order, and the cell is that of `voronoi_tessellation`.
    Raises `InputError` when the points are too few or too regular to have one Delaunay tessellation.
    """
    tiling = Tiling(points, cell)
    n_points, dimension = tiling.points.shape
    corners, _ = periodic_delaunay(tiling.points, tiling.shape)
    first, second = np.array(list(combinations(range(dimension + 1), 2))).T
    tail, head = (corners[:, ends].reshape(-1, 1 + dimension) for ends in (first, second))
    # Corners are sorted by point and image, so that an edge is seen from the same end in all its simplices.
    rows = np.column_stack([tail[:, 0], head[:, 0], head[:, 1:] - tail[:, 1:]])
    rows = rows[distinct(rows.T)]
    if dimension == 2 and len(rows) != 3 * n_points:
        raise InputError(
            f"{n_points} points have no unique periodic Delaunay tessellation: "
            "they are too few or lie on a regular lattice; use more points, or another seed"
        )
    return tiling.network(rows[:, :2], rows[:, 2:], tiling.points)
