"""Making networks: Voronoi tessellations of random points in two and three dimensions, and the three-bar linkage.

The standard network is the periodic Voronoi tessellation of n_cells = N_v/2 points placed by random sequential
addition with hard-core distance ρ/√n_cells, scaled to the area V = N_v.  Every vertex has three edges, N_b = 3 N_v/2.
In three dimensions the distance is ρ/n_cells^(1/3), every vertex has four edges, N_b = 2 N_v, and V = N_v again.
"""

from __future__ import annotations

from collections.abc import Iterable
from itertools import product

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import Delaunay

from critflow.arguments import checked, generator
from critflow.networks.lattices import periodic_network
from critflow.networks.network import Array, Network
from critflow.networks.random_points import random_sequential_addition
from critflow.result import InputError

# Random sequential addition of discs stops near ρ = 0.834; above, the points do not fit.
STANDARD_HARD_CORE = 0.82
# Of spheres it stops at 0.384 of the volume, which is ρ = 0.902.
FOAM_HARD_CORE = 0.87


@checked
def voronoi_network(
    n_vertices: int = 1000, seed: int | np.random.Generator = 0, hard_core: float = STANDARD_HARD_CORE
) -> Network:
    """The standard disordered network: exactly n_vertices, three edges a vertex, area V = n_vertices.

    The same seed gives the same network, always.  Raises `InputError` for an odd or too small n_vertices and for a
    hard core (ρ, in units of the mean spacing 1/√n_cells) that leaves too little space for all points.
    """
    if int(n_vertices) != n_vertices or n_vertices < 4 or n_vertices % 2:
        raise InputError(
            f"n_vertices must be an even number of at least 4, not {n_vertices}: a Voronoi network has two a cell"
        )
    n_cells = int(n_vertices) // 2
    rng = generator(seed)
    points = random_sequential_addition(n_cells, hard_core / np.sqrt(n_cells), rng)
    return voronoi_of(points, side=np.sqrt(n_vertices))


@checked
def foam_network(
    n_vertices: int = 400, seed: int | np.random.Generator = 0, hard_core: float = FOAM_HARD_CORE
) -> Network:
    """The disordered network in three dimensions: exactly n_vertices, four edges a vertex, volume V = n_vertices.

    A cell has about 6.45 vertices, not a fixed number, so points are drawn until the number of vertices is n_vertices:
    about 11 draws for 400 vertices, and √10 times this number for ten times as many vertices.  The same seed gives the
    same network, always.  Raises `InputError` for too few vertices and for a hard core (ρ, in units of 1/n_cells^(1/3))
    that leaves too little space for all points.
    """
    if int(n_vertices) != n_vertices or n_vertices < _FEWEST_CELLS * _VERTICES_A_CELL:
        raise InputError(
            f"n_vertices must be a whole number of at least {int(np.ceil(_FEWEST_CELLS * _VERTICES_A_CELL))}, "
            f"not {n_vertices}: a foam of fewer cells meets its own images"
        )
    n_cells = round(n_vertices / _VERTICES_A_CELL)
    rng = generator(seed)
    for _ in range(_MAX_DRAWS):
        points = random_sequential_addition(n_cells, hard_core / n_cells ** (1 / 3), rng, dimension=3)
        if len(_periodic_delaunay(points)[0]) == n_vertices:
            return voronoi_of(points)
    raise InputError(
        f"{n_cells} cells never had {n_vertices} vertices in {_MAX_DRAWS} draws: hard_core={hard_core:g} is far from "
        f"its standard {FOAM_HARD_CORE}, so make the network by voronoi_of(points)"
    )


# Mean number of vertices of a cell at the standard hard core, each counted in the four cells that share it.
_VERTICES_A_CELL = 6.45
_FEWEST_CELLS = 8
_MAX_DRAWS = 3000


@checked
def three_bar_linkage(span: float = 3.0) -> Network:
    """Three edges in a row between two fixed points `span` apart (`3-barlinkage`): lengths ∝ 1/σ_α on a line."""
    return Network(
        np.array([[0, 1], [1, 2], [2, 3]]),
        pins={0: np.zeros(2), 3: np.array([span, 0.0])},
        positions=np.array([[0.0, 0.0], [span / 3, 0.3], [2 * span / 3, -0.3], [span, 0.0]]),
    )


@checked
def voronoi_of(points: Array, side: float | None = None) -> Network:
    """The periodic Voronoi network of points (n_cells, d) in the unit cube; d + 1 edges a vertex.

    The cube is scaled to `side`, by default so that V = N_v.  Vertices are the circumcentres of the Delaunay
    simplices of the points, edges join simplices that share a facet.  Raises `InputError` when the points are too few
    or too regular to have one Delaunay tessellation.
    """
    points = np.asarray(points, dtype=float)
    if points.ndim != 2 or points.size == 0 or points.shape[1] < 2 or not np.isfinite(points).all():
        raise InputError(f"points must be finite and of shape (n_cells, d) with d >= 2, not {points.shape}: give cells")
    dimension = points.shape[1]
    corners, centres = _periodic_delaunay(points)
    n_vertices = len(corners)
    # A facet seen from its two simplices differs by a lattice shift, which is the image offset of the edge.
    keep = np.array([[k for k in range(dimension + 1) if k != left_out] for left_out in range(dimension + 1)])
    ids, images = corners[:, :, 0], corners[:, :, 1:]
    shift = images[:, keep[:, 0]]
    later = [images[:, keep[:, k]] - shift for k in range(1, dimension)]
    keys = _packed([
        *(ids[:, keep[:, k]].ravel() for k in range(dimension)),
        *(seen[:, :, axis].ravel() for seen in later for axis in range(dimension)),
    ])  # fmt: skip
    shift = shift.reshape(-1, dimension)
    order = np.lexsort(keys[::-1])
    first, second = order[0::2], order[1::2]
    matched = len(order) % 2 == 0 and all(np.array_equal(key[first], key[second]) for key in keys)
    if not matched or (dimension == 2 and n_vertices != 2 * len(points)):
        raise InputError(
            f"{len(points)} points have no periodic Voronoi tessellation with simple vertices: "
            "they are too few or lie on a regular lattice; use more cells, or another seed"
        )
    tail, head = first // (dimension + 1), second // (dimension + 1)
    step = shift[first] - shift[second]
    # Circumcentres that coincide belong to more than d + 1 points on one sphere, which have several tessellations.
    gap = np.linalg.norm(centres[head] + step - centres[tail], axis=1)
    if gap.min() < 1e-9 * gap.max():
        raise InputError(f"some of the {len(points)} points lie on a regular lattice, so vertices coincide: move them")
    wrap = np.floor(centres).astype(int)
    edges = np.stack([tail, head], axis=1)
    offsets = step + wrap[head] - wrap[tail]
    scale = n_vertices ** (1 / dimension) if side is None else side
    return periodic_network(edges, offsets, scale * np.eye(dimension), scale * (centres - wrap))


def _periodic_delaunay(points: Array) -> tuple[NDArray[np.int64], Array]:
    """Delaunay simplices of periodic points, once each: corners (n, d+1, 1+d) as point and image, centres (n, d).

    Corners are sorted and shifted so that the first lies in image zero; the order of simplices follows from the
    corners, not from the library that finds them.
    """
    n_points, dimension = points.shape
    margin = min(1.0, 4.0 / n_points ** (1 / dimension))
    while True:
        ids, images = _with_images(points, margin)
        coordinates = points[ids] + images
        simplices = Delaunay(coordinates).simplices
        centres, radii = _circumcentres(coordinates[simplices])
        inside = ((centres > -1e-6) & (centres < 1 + 1e-6)).all(axis=1)
        # A simplex is one of the infinite tessellation if its circumsphere lies within the points laid out.
        if radii[inside].max(initial=np.inf if not inside.any() else 0.0) < margin:
            break
        if margin >= 3.0:
            raise InputError(f"{n_points} points are too few for a periodic Voronoi tessellation: use more cells")
        margin = min(3.0, 2 * margin)
    simplices, centres = simplices[inside], centres[inside]
    corners = np.concatenate([ids[simplices][:, :, None], images[simplices]], axis=2)
    # Sorting by point, then image, makes the first corner independent of the image that the simplex was found in.
    code = corners[:, :, 0]
    for axis in range(dimension):
        code = code * 16 + corners[:, :, 1 + axis] + 8
    corners = np.take_along_axis(corners, np.argsort(code, axis=1)[:, :, None], axis=1)
    base = corners[:, 0, 1:].copy()
    corners[:, :, 1:] -= base[:, None]
    keys = _packed(corners.reshape(len(corners), -1).T)
    order = np.lexsort(keys[::-1])
    new = np.zeros(len(order), bool)
    new[:1] = True
    for key in keys:
        new[1:] |= key[order[1:]] != key[order[:-1]]
    chosen = order[new]
    return corners[chosen], (centres - base)[chosen]


def _packed(columns: Iterable[NDArray[np.int64]]) -> list[NDArray[np.int64]]:
    """Columns of whole numbers as few keys in the same lexicographic order: each key packs the bits of several."""
    keys: list[NDArray[np.int64]] = []
    free_bits = 0
    for column in columns:
        least, most = (int(column.min()), int(column.max())) if len(column) else (0, 0)
        bits = (most - least).bit_length()
        if not keys or bits > free_bits:
            keys.append(column - least)
            free_bits = 63 - bits
        else:
            keys[-1] = (keys[-1] << bits) | (column - least)
            free_bits -= bits
    return keys


def _with_images(points: Array, margin: float) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """All periodic images of the points within `margin` of the unit cube: point index (n,) and image (n, d)."""
    dimension = points.shape[1]
    layers = int(np.ceil(margin))
    ids, images = [], []
    for image in product(range(-layers, layers + 1), repeat=dimension):
        shifted = points + image
        near = np.flatnonzero(((shifted > -margin) & (shifted < 1 + margin)).all(axis=1))
        ids.append(near)
        images.append(np.broadcast_to(image, (len(near), dimension)))
    return np.concatenate(ids), np.concatenate(images)


def _circumcentres(corners: ArrayLike) -> tuple[Array, Array]:
    """Centres (n, d) and radii (n,) of the spheres through simplices (n, d+1, d)."""
    corners = np.asarray(corners)
    sides = corners[:, 1:] - corners[:, :1]
    volume = np.abs(np.linalg.det(sides))
    thin = volume < 1e-12 * np.max(np.sum(sides**2, axis=2), axis=1)
    sides[thin] = np.eye(corners.shape[2])
    offset = np.linalg.solve(sides, 0.5 * np.sum(sides**2, axis=2)[:, :, None])[:, :, 0]
    # Slivers on the hull have no centre within reach; the caller looks only at those whose centre is inside.
    offset[thin] = np.inf
    return corners[:, 0] + offset, np.sqrt(np.sum(offset**2, axis=1))
