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
from scipy.spatial import Delaunay, cKDTree

from critflow.networks.lattices import periodic_network
from critflow.networks.network import Array, Network
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
    # Circumcentres that coincide belong to more than d + 1 points on one sphere, which can be joined in several ways.
    gap = np.linalg.norm(centres[head] + step - centres[tail], axis=1)
    if gap.min() < 1e-9 * gap.max():
        raise InputError(f"some of the {len(points)} points lie on a regular lattice, so vertices coincide: move them")
    wrap = np.floor(centres).astype(int)
    edges = np.stack([tail, head], axis=1)
    offsets = step + wrap[head] - wrap[tail]
    scale = n_vertices ** (1 / dimension) if side is None else side
    return periodic_network(edges, offsets, scale * np.eye(dimension), scale * (centres - wrap))


def _add_until_saturated(n_points: int, distance: float, rng: np.random.Generator, dimension: int) -> Array:
    # Grid cells of diagonal <= distance hold one point at most, so the neighbours of a trial are found by index.
    per_side = int(np.ceil(np.sqrt(dimension) / distance))
    grid = np.full((per_side,) * dimension + (dimension,), _NOWHERE)
    points = np.empty((n_points, dimension))
    n_placed = 0

    voxels = np.indices(grid.shape[:-1]).reshape(dimension, -1).T / per_side
    side = 1.0 / per_side
    uncovered = _Uncovered(grid, distance)
    while n_placed < n_points and len(voxels):
        # As many trials as uncovered voxels is cheap and rarely places two in reach of each other.
        trials = voxels[rng.integers(len(voxels), size=len(voxels))] + side * rng.random((len(voxels), dimension))
        trials -= trials >= 1.0
        if n_placed:
            trials = trials[uncovered(trials, 0.0)]
        placed = trials[_first_come(trials, distance)][: n_points - n_placed]
        points[n_placed : n_placed + len(placed)] = placed
        n_placed += len(placed)
        if n_placed == n_points:
            break
        grid[tuple(np.floor(placed * per_side).astype(int).T)] = placed
        uncovered = _Uncovered(grid, distance)

        voxels = voxels[uncovered(voxels + side / 2, side / 2)]
        # Halving the voxels follows the shrinking holes; while holes are large it would only cost.
        if len(placed) < 0.2 * max(len(voxels), 1):
            side /= 2
            voxels = (voxels[:, None, :] + side * np.array(list(product((0, 1), repeat=dimension)))).reshape(
                -1, dimension
            )
    return points[:n_placed]


class _Uncovered:
    """Which places keep their distance to all points of a grid (…, d) of cells with one point each at most."""

    def __init__(self, grid: Array, distance: float):
        dimension, self._per_side, self._distance = grid.shape[-1], len(grid), distance
        self._padded = _periodic_padding(grid)
        self._strides = (len(grid) + 4) ** np.arange(dimension - 1, -1, -1)
        # The nearest cells first, which settles most places at once; but the cell of a place itself is mostly empty.
        steps = np.array(list(product(range(-2, 3), repeat=dimension)))
        order = np.argsort(np.sum(steps**2, axis=1), kind="stable")
        self._steps = steps[np.roll(order, -1)]

    def _reach(self, half_width: float) -> NDArray[np.int64]:
        """Steps in the padded grid to the cells from which a point can cover a cube that lies in one cell."""
        away = np.abs(self._steps)
        gap = np.maximum(away - 1, 0) / self._per_side + np.where(away, 2, 1) * half_width
        able = np.sum(gap**2, axis=1) < (1 + 1e-9) * self._distance**2
        return np.asarray((self._steps[able] + 2) @ self._strides)

    def __call__(self, places: Array, half_width: float) -> NDArray[np.bool_]:
        """For points or cubes of that half width around places (n, d): whether even the farthest corner is clear."""
        clear, reach = np.zeros(len(places), bool), self._reach(half_width)
        # Blocks stay in the cache of the processor, and shrink as their places are found to be covered.
        for start in range(0, len(places), _BLOCK):
            at = np.ascontiguousarray(places[start : start + _BLOCK].T)
            cell = self._strides @ np.floor(at * self._per_side).astype(int)
            left = np.arange(start, start + at.shape[1])
            for step in reach:
                near, squared = cell + step, np.zeros(len(cell))
                for x, padded in zip(at, self._padded, strict=True):
                    away = padded[near]
                    np.subtract(x, away, out=away)
                    np.abs(away, out=away)
                    away += half_width
                    away *= away
                    squared += away
                far = squared >= self._distance**2
                if not far.all():
                    left, cell, at = left[far], cell[far], at[:, far]
            clear[left] = True
        return clear


# Places looked at together.
_BLOCK = 1 << 15


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
    tree = cKDTree(trials, boxsize=1.0, balanced_tree=False)
    earlier, later = np.ascontiguousarray(tree.query_pairs(distance, output_type="ndarray").T)
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
    keys = _packed(corners.reshape(len(corners), -1).T)
    order = np.lexsort(keys[::-1])
    new = np.zeros(len(order), bool)
    new[:1] = True
    for key in keys:
        new[1:] |= key[order[1:]] != key[order[:-1]]
    chosen = order[new]
    return corners[chosen], (centres - base)[chosen]


def _packed(columns: Iterable[NDArray[np.int64]]) -> list[NDArray[np.int64]]:
    """Columns of whole numbers as few keys in the same lexicographic order: as many to a key as its bits hold."""
    keys: list[NDArray[np.int64]] = []
    room = 0
    for column in columns:
        least, most = (int(column.min()), int(column.max())) if len(column) else (0, 0)
        bits = (most - least).bit_length()
        if not keys or bits > room:
            keys.append(column - least)
            room = 63 - bits
        else:
            keys[-1] = (keys[-1] << bits) | (column - least)
            room -= bits
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
