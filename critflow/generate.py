"""Making networks: Voronoi tessellations of random points in two and three dimensions, and the three-bar linkage.

The standard network is the periodic Voronoi tessellation of n_cells = N_v/2 points placed by random sequential
addition with hard-core distance ρ/√n_cells, scaled to the area V = N_v.  Every vertex has three edges, N_b = 3 N_v/2.
In three dimensions the distance is ρ/n_cells^(1/3), every vertex has four edges, N_b = 2 N_v, and V = N_v again.
"""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import Delaunay, cKDTree

from critflow.lattices import periodic_network
from critflow.network import Array, Network
from critflow.result import InputError

# Random sequential addition of discs stops near ρ = 0.834; above, the points asked for do not fit.
STANDARD_HARD_CORE = 0.82
# Of spheres it stops at 0.384 of the volume, which is ρ = 0.902.
FOAM_HARD_CORE = 0.87
_SATURATED = {2: 0.834, 3: 0.902}
# No packing at all is denser than the hexagonal one of discs and the face-centred one of spheres.
_DENSEST = {2: np.sqrt(2 / np.sqrt(3)), 3: 2 ** (1 / 6)}


def voronoi_network(
    n_vertices: int = 1000, seed: int | np.random.Generator = 0, hard_core: float = STANDARD_HARD_CORE
) -> Network:
    """The standard disordered network: exactly n_vertices, three edges a vertex, area V = n_vertices.

    The same seed gives the same network, always.  Raises `InputError` for an odd or too small n_vertices and for a
    hard core (ρ, in units of the mean spacing 1/√n_cells) that does not leave room for all points.
    """
    if int(n_vertices) != n_vertices or n_vertices < 4 or n_vertices % 2:
        raise InputError(
            f"n_vertices must be an even number of at least 4, not {n_vertices}: every Voronoi cell brings two"
        )
    n_cells = int(n_vertices) // 2
    rng = np.random.default_rng(seed)
    points = random_sequential_addition(n_cells, hard_core / np.sqrt(n_cells), rng)
    return voronoi_of(points, side=np.sqrt(n_vertices))


def foam_network(
    n_vertices: int = 400, seed: int | np.random.Generator = 0, hard_core: float = FOAM_HARD_CORE
) -> Network:
    """The disordered network in three dimensions: exactly n_vertices, four edges a vertex, volume V = n_vertices.

    A cell has about 6.45 vertices, no fixed number, so the points are drawn anew until the vertices are n_vertices:
    about 11 times for 400 vertices and √10 times as often for ten times as many.  The same seed gives the same network,
    always.  Raises `InputError` for too few vertices and for a hard core (ρ, in units of 1/n_cells^(1/3)) that does not
    leave room for all points.
    """
    if int(n_vertices) != n_vertices or n_vertices < _FEWEST_CELLS * _VERTICES_A_CELL:
        raise InputError(
            f"n_vertices must be a whole number of at least {int(np.ceil(_FEWEST_CELLS * _VERTICES_A_CELL))}, "
            f"not {n_vertices}: a foam of fewer cells meets its own images"
        )
    n_cells = round(n_vertices / _VERTICES_A_CELL)
    rng = np.random.default_rng(seed)
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


def three_bar_linkage(span: float = 3.0) -> Network:
    """Three edges in a row between two fixed points `span` apart (`3-barlinkage`): lengths ∝ 1/σ_α on a line."""
    return Network(
        np.array([[0, 1], [1, 2], [2, 3]]),
        pins={0: np.zeros(2), 3: np.array([span, 0.0])},
        positions=np.array([[0.0, 0.0], [span / 3, 0.3], [2 * span / 3, -0.3], [span, 0.0]]),
    )


def random_sequential_addition(
    n_points: int, distance: float, rng: np.random.Generator, dimension: int = 2, max_restarts: int = 1000
) -> Array:
    """Points (n_points, d) in the periodic unit cube, placed one by one and no two closer than `distance`.

    Trials are drawn only from voxels that the points so far leave uncovered, which changes nothing of the
    distribution and makes the cost linear.  A packing that saturates early starts again.  The points are returned
    sorted by grid cell, so that neighbours lie near each other in memory.
    """
    if n_points < 1 or not distance > 0:
        raise InputError(
            f"random sequential addition needs points and a positive distance, not {n_points} and {distance}"
        )
    if dimension < 1:
        raise InputError(f"points need a dimension of at least 1, not {dimension}")
    crowded = distance * n_points ** (1 / dimension) > _DENSEST.get(dimension, np.inf)
    for _ in range(0 if crowded else max_restarts):
        points = _add_until_saturated(n_points, distance, rng, dimension)
        if len(points) == n_points:
            cell = np.floor(points * n_points ** (1 / dimension)).astype(int)
            return points[np.lexsort(cell.T)]
    raise InputError(
        f"{n_points} points never fitted at a distance of {distance:.4g} in {max_restarts} tries: lower the hard core "
        f"(ρ = {_SATURATED.get(dimension, 0.9)} is the limit in {dimension} dimensions)"
    )


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
    ids, images = corners[:, :, 0], corners[:, :, 1:]
    keep = np.array([[k for k in range(dimension + 1) if k != left_out] for left_out in range(dimension + 1)])
    facet_ids = ids[:, keep].reshape(-1, dimension)
    facet_images = images[:, keep].reshape(-1, dimension, dimension)
    shift = facet_images[:, 0]
    key = np.concatenate([facet_ids, (facet_images - shift[:, None]).reshape(len(shift), -1)], axis=1)
    order = np.lexsort(key.T[::-1])
    first, second = order[0::2], order[1::2]
    matched = len(order) % 2 == 0 and np.array_equal(key[first], key[second])
    if not matched or (dimension == 2 and n_vertices != 2 * len(points)):
        raise InputError(
            f"{len(points)} points have no periodic Voronoi tessellation with simple vertices: "
            "they are too few or lie on a regular lattice; use more cells, or another seed"
        )
    owner = np.repeat(np.arange(n_vertices), dimension + 1)
    # Circumcentres that coincide belong to more than d + 1 points on one sphere, which can be joined in several ways.
    gap = np.linalg.norm(centres[owner[second]] + shift[first] - shift[second] - centres[owner[first]], axis=1)
    if gap.min() < 1e-9 * gap.max():
        raise InputError(f"some of the {len(points)} points lie on a regular lattice, so vertices coincide: move them")
    wrap = np.floor(centres).astype(int)
    edges = np.stack([owner[first], owner[second]], axis=1)
    offsets = shift[first] - shift[second] + wrap[owner[second]] - wrap[owner[first]]
    scale = n_vertices ** (1 / dimension) if side is None else side
    return periodic_network(edges, offsets, scale * np.eye(dimension), scale * (centres - wrap))


def _add_until_saturated(n_points: int, distance: float, rng: np.random.Generator, dimension: int) -> Array:
    # Grid cells of diagonal <= distance hold one point at most, so the neighbours of a trial are found by index.
    per_side = int(np.ceil(np.sqrt(dimension) / distance))
    grid = np.full((per_side,) * dimension + (dimension,), _NOWHERE)
    padded_shape = (per_side + 4,) * dimension
    reach = np.array([np.ravel_multi_index(step, padded_shape) for step in product(range(5), repeat=dimension)])
    points = np.empty((n_points, dimension))
    n_placed = 0

    def closest(places: Array, half_width: float, padded: list[Array]) -> Array:
        """Least squared distance (n,) from points to cubes of that half width, counted to the farthest corner."""
        corner = np.floor(places * per_side).astype(int)
        near = np.ravel_multi_index(tuple(corner.T), padded_shape)[:, None] + reach
        squared = np.zeros(near.shape)
        for axis in range(dimension):
            squared += (np.abs(places[:, axis, None] - padded[axis][near]) + half_width) ** 2
        return squared.min(axis=1)

    voxels = np.array(list(np.ndindex(grid.shape[:-1]))) / per_side
    side = 1.0 / per_side
    padded = _periodic_padding(grid)
    while n_placed < n_points and len(voxels):
        # As many trials as uncovered voxels is cheap and rarely places two in reach of each other.
        trials = (
            voxels[rng.integers(len(voxels), size=len(voxels))] + side * rng.random((len(voxels), dimension))
        ) % 1.0
        trials = trials[closest(trials, 0.0, padded) >= distance**2]
        placed = trials[_first_come(trials, distance)][: n_points - n_placed]
        points[n_placed : n_placed + len(placed)] = placed
        n_placed += len(placed)
        grid[tuple(np.floor(placed * per_side).astype(int).T)] = placed
        padded = _periodic_padding(grid)

        voxels = voxels[closest(voxels + side / 2, side / 2, padded) >= distance**2]
        # Halving the voxels follows the shrinking holes; while holes are large it would only cost.
        if len(placed) < 0.2 * max(len(voxels), 1):
            side /= 2
            voxels = (voxels[:, None, :] + side * np.array(list(product((0, 1), repeat=dimension)))).reshape(
                -1, dimension
            )
    return points[:n_placed]


# Coordinate of the point of an empty grid cell: farther away than any distance asked for.
_NOWHERE = 1e3


def _periodic_padding(grid: Array) -> list[Array]:
    """Each coordinate of the points in a grid of cells, flat, with two layers of periodic images around it."""
    dimension = grid.shape[-1]
    padded = np.pad(grid, [(2, 2)] * dimension + [(0, 0)], mode="wrap")
    for axis in range(dimension):
        ends = np.moveaxis(padded[..., axis], axis, 0)
        ends[:2] -= 1.0
        ends[-2:] += 1.0
    return [padded[..., axis].ravel() for axis in range(dimension)]


def _first_come(trials: Array, distance: float) -> NDArray[np.bool_]:
    """Which trials stand when they are taken in order and each must keep its distance to all taken before."""
    taken = np.zeros(len(trials), bool)
    if len(trials) == 0:
        return taken
    earlier, later = np.sort(cKDTree(trials, boxsize=1.0).query_pairs(distance, output_type="ndarray"), axis=1).T
    refused = np.zeros(len(trials), bool)
    while len(earlier):
        # A trial that waits for no earlier one is taken, and refuses the later ones in its reach.
        waiting = np.zeros(len(trials), bool)
        waiting[later] = True
        taken |= ~waiting & ~refused
        refused[later[taken[earlier]]] = True
        open_ = ~refused[earlier] & ~refused[later] & ~taken[earlier]
        earlier, later = earlier[open_], later[open_]
    return ~refused


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
    flat = corners.reshape(len(corners), -1)
    order = np.lexsort(flat.T[::-1])
    new = np.ones(len(order), bool)
    new[1:] = (flat[order[1:]] != flat[order[:-1]]).any(axis=1)
    chosen = order[new]
    return corners[chosen], (centres - base)[chosen]


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
