"""Networks of random points: Voronoi and Delaunay tessellations, random regular networks, and the three-bar linkage.

The standard network is the periodic Voronoi tessellation of n_cells = N_v/2 points placed by random sequential
addition with hard-core distance ρ/√n_cells, scaled to the area V = N_v.  Every vertex has three edges, N_b = 3 N_v/2.
In three dimensions the distance is ρ/n_cells^(1/3), every vertex has four edges, N_b = 2 N_v, and V = N_v again.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from critflow.arguments import generator, of_kind
from critflow.calls import running
from critflow.generators.random_points import check_addition, points_in_cell, random_sequential_addition
from critflow.generators.tessellations import (
    count_simplices,
    delaunay_tessellation,
    voronoi_tessellation,
)
from critflow.networks.checks import check_size, checked_cell
from critflow.networks.network import Network
from critflow.result import InputError

# Random sequential addition of discs stops near ρ = 0.834; above, the points do not fit.
STANDARD_HARD_CORE = 0.82
# Of spheres it stops at 0.384 of the volume, which is ρ = 0.902.
FOAM_HARD_CORE = 0.87
# Vertices of a network of random points where no number is given.
_VERTICES = 1000


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
        _check_alone(n_vertices)
        return voronoi_tessellation(points, cell)
    n_vertices = _VERTICES if n_vertices is None else n_vertices
    check_voronoi(n_vertices, hard_core)
    shape = None if cell is None else checked_cell(cell, 2)
    points = points_in_cell(n_vertices // 2, hard_core, generator(seed), shape)
    scale = 1.0 if shape is None else np.sqrt(n_vertices / abs(np.linalg.det(shape)))
    return voronoi_tessellation(points, None if shape is None else shape * scale)


def _check_alone(n_vertices: int | None) -> None:
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
        _check_alone(n_vertices)
        return delaunay_tessellation(points, cell)
    n_vertices = _VERTICES if n_vertices is None else n_vertices
    if n_vertices < 4:
        raise InputError(f"n_vertices must be a whole number of at least 4, not {n_vertices}")
    shape = np.eye(2) if cell is None else checked_cell(cell)
    scale = (n_vertices / abs(np.linalg.det(shape))) ** (1 / len(shape))
    points = points_in_cell(n_vertices, hard_core, generator(seed), shape)
    return delaunay_tessellation(points, scale * shape)


@running("foam_network")
def foam_network(
    n_vertices: int = 400, seed: int | np.random.Generator = 0, hard_core: float = FOAM_HARD_CORE
) -> Network:
    """The disordered network in three dimensions: exactly n_vertices, four edges a vertex, volume V = n_vertices.

    A cell has about 6.45 vertices, not a fixed number, so points are drawn until the number of vertices is n_vertices:
    about 11 draws for 400 vertices, and √10 times this number for ten times as many vertices.  The same seed gives the
    same network, always.  Raises `InputError` for too few vertices and for a hard core (ρ, in units of 1/n_cells^(1/3))
    that leaves too little space for all points.

    >>> import critflow as cf
    >>> cf.foam_network(n_vertices=60, seed=1).dimension
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
            return voronoi_tessellation(points)
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


# Mean number of vertices of a cell at the standard hard core, each counted in the four cells that share it.
_VERTICES_A_CELL = 6.45
_FEWEST_CELLS = 8
_MAX_DRAWS = 3000


def three_bar_linkage(span: float = 3.0) -> Network:
    """Three edges in a row between two fixed points `span` apart (`3-barlinkage`): lengths ∝ 1/σ_α on a line.

    >>> import critflow as cf
    >>> cf.three_bar_linkage()
    Network(4 vertices, 3 edges, 2 dimensions, 2 pins, z = 1.5)
    """
    of_kind(float, span=span)
    return Network(
        np.array([[0, 1], [1, 2], [2, 3]]),
        pins={0: np.zeros(2), 3: np.array([span, 0.0])},
        positions=np.array([[0.0, 0.0], [span / 3, 0.3], [2 * span / 3, -0.3], [span, 0.0]]),
    )
