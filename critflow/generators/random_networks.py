"""The standard disordered network: the Voronoi tessellation of random points.

The standard network is the periodic Voronoi tessellation of n_cells = N_v/2 points placed by random sequential
addition with hard-core distance ρ/√n_cells, scaled to the area V = N_v.  Every vertex has three edges, N_b = 3 N_v/2.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from critflow.arguments import generator, of_kind
from critflow.calls import running
from critflow.generators.random_points import check_addition, points_in_cell
from critflow.generators.tessellations import voronoi_tessellation
from critflow.networks.checks import check_size, checked_cell
from critflow.networks.network import Network
from critflow.result import InputError

# Random sequential addition of discs stops near ρ = 0.834; above, the points do not fit.
STANDARD_HARD_CORE = 0.82
# Vertices of a network of random points where no number is given.
N_VERTICES = 1000


@running("voronoi_network")
def voronoi_network(
    n_vertices: int | None = None,
    seed: int | np.random.Generator = 0,
    hard_core: float = STANDARD_HARD_CORE,
    cell: ArrayLike | None = None,
    points: ArrayLike | None = None,
) -> Network:
    """The standard disordered network: exactly n_vertices, three edges a vertex, area V = n_vertices.

    n_vertices  an even number; 1000 by default
    hard_core   least distance ρ of two points in units of the mean spacing 1/√n_cells; 0 places them independently
    cell        (2, 2) vectors as rows, the shape of the cell; a square by default
    points      (n_cells, d) in units of the cell vectors, in place of random ones: then `cell` (d, d) is the cell
                itself, and d + 1 edges meet at a vertex

    The same seed gives the same network, always.  Raises `InputError` for an odd or too small n_vertices, for a hard
    core that leaves too little space for all points, and for points that are too few or too regular.

    >>> import critflow as cf
    >>> import numpy as np
    >>> cf.voronoi_network(n_vertices=20, seed=1)
    Network(20 vertices, 30 edges, 2 dimensions, periodic, z = 3)
    >>> cf.voronoi_network(points=np.random.default_rng(0).random((12, 2)))
    Network(24 vertices, 36 edges, 2 dimensions, periodic, z = 3)
    """
    n_vertices = of_kind(int, None, n_vertices=n_vertices)
    seed = of_kind(int, np.random.Generator, seed=seed)
    of_kind(float, hard_core=hard_core)
    of_kind(np.ndarray, None, cell=cell, points=points)
    if points is not None:
        check_alone(n_vertices)
        return voronoi_tessellation(points, cell)
    n_vertices = N_VERTICES if n_vertices is None else n_vertices
    check_voronoi(n_vertices, hard_core)
    shape = None if cell is None else checked_cell(cell, 2)
    points = points_in_cell(n_vertices // 2, hard_core, generator(seed), shape)
    scale = 1.0 if shape is None else np.sqrt(n_vertices / abs(np.linalg.det(shape)))
    return voronoi_tessellation(points, None if shape is None else shape * scale)


def check_alone(n_vertices: int | None) -> None:
    """Raise `InputError` for a number of vertices in addition to points."""
    if n_vertices is not None:
        raise InputError("the number of vertices follows from the points: give n_vertices or points")


def check_voronoi(n_vertices: int, hard_core: float = STANDARD_HARD_CORE) -> None:
    """Raise `InputError` for arguments without a `voronoi_network`, without making one."""
    if n_vertices < 4 or n_vertices % 2:
        raise InputError(
            f"n_vertices must be an even number of at least 4, not {n_vertices}: a Voronoi network has two a cell"
        )
    check_size(n_vertices)
    if hard_core != 0:
        check_addition(n_vertices // 2, hard_core / np.sqrt(n_vertices // 2), dimension=2)
