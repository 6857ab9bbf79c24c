"""Networks of random points: their Voronoi and Delaunay tessellations in periodic cells of any shape.

Random points have a hard core: none is nearer to another than ρ in units of (V/n)^(1/d).  The standard network is the
Voronoi tessellation of n_cells = N_v/2 such points in the plane: three edges a vertex, N_b = 3 N_v/2, and V = N_v.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from itertools import combinations, product
from typing import Any

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from critflow.arguments import generator, of_kind
from critflow.calls import running
from critflow.checks import check_size, checked_cell
from critflow.networks import Array, IntArray, Network, periodic_network
from critflow.result import InputError

# Hard core of the standard networks.
STANDARD_HARD_CORE = 0.82
# Random sequential addition saturates at these ρ, which are coverages of 0.547 in the plane and 0.384 in space.
_SATURATED = {2: 0.834, 3: 0.902}
# No packing at all is denser than the hexagonal one of discs and the face-centred one of spheres.
_DENSEST = {2: np.sqrt(2 / np.sqrt(3)), 3: 2 ** (1 / 6)}
_MAX_RESTARTS = 1000
# Vertices of a network of random points where no number is given.
_N_VERTICES = 1000


# Cells


def short_cell(cell: Array) -> tuple[Array, IntArray]:
    """Short vectors that span the same lattice, (d, d), and their whole components in the vectors of the cell.

    Multiples of one vector are subtracted from another as long as this makes it shorter (Lagrange, Gauss).
    Raises `InputError` for a cell that has no volume within rounding.
    """
    rows = np.eye(len(cell), dtype=int)
    shortened = True
    while shortened:
        shortened = False
        for i, j in product(range(len(cell)), repeat=2):
            short = rows @ cell
            share = (short[i] @ short[j]) / (short[j] @ short[j])
            # At one half the vector would keep its length.
            if i != j and abs(share) > 0.5 + 1e-9:
                rows[i] -= int(np.round(share)) * rows[j]
                shortened = True
    short = rows @ cell
    if not abs(np.linalg.det(short)) > 1e-10 * np.prod(np.linalg.norm(short, axis=1)):
        raise InputError("the cell vectors are parallel within rounding: give vectors that span a volume")
    return short, rows


# Images of points beyond this number do not fit into memory.
_MOST_IMAGES = 20_000_000


def near_images(points: Array, cell: Array, margin: float) -> tuple[IntArray, IntArray]:
    """Periodic images, within `margin` of the cell, of points (n, d) in its units: point (m,) and image (m, d)."""
    widths = margin * np.linalg.norm(np.linalg.inv(cell), axis=0)
    if len(points) * np.prod(1 + 2 * widths) > _MOST_IMAGES:
        raise InputError(f"{len(points)} points are too few for so long a cell: use more points, or a shorter cell")
    ids, images = [], []
    for image in product(*(range(-layers, layers + 1) for layers in np.ceil(widths).astype(int))):
        shifted = points + image
        near = np.flatnonzero(((shifted > -widths) & (shifted < 1 + widths)).all(axis=1))
        ids.append(near)
        images.append(np.broadcast_to(image, (len(near), points.shape[1])))
    return np.concatenate(ids), np.concatenate(images)


# Random sequential addition


@running("random_sequential_addition")
def random_sequential_addition(n_points: int, distance: float, rng: np.random.Generator, dimension: int = 2) -> Array:
    """Points (n_points, d) in the periodic unit cube, placed one by one and no two closer than `distance`.

    Trials are drawn only from voxels that the points so far leave uncovered, which changes nothing of the
    distribution and makes the cost linear.  A packing that saturates early starts again.  The points are returned
    sorted by grid cell, so that neighbours lie near each other in memory.

    >>> from critflow.points import random_sequential_addition
    >>> import numpy as np
    >>> random_sequential_addition(10, 0.1, np.random.default_rng(0)).shape
    (10, 2)
    """
    n_points, dimension = of_kind(int, n_points=n_points, dimension=dimension)
    of_kind(float, distance=distance)
    rng = of_kind(np.random.Generator, rng=rng)
    check_addition(n_points, distance, dimension)
    return _added(n_points, distance, rng, dimension)


def points_in_cell(n_points: int, hard_core: float, rng: np.random.Generator, cell: Array | None = None) -> Array:
    """Random points (n_points, d) in units of the vectors of a cell (d, d), by default a square.

    hard_core  least distance of two points in units of (V/n_points)^(1/d); zero for independent points
    """
    dimension = 2 if cell is None else len(cell)
    check_size(n_points)
    if hard_core == 0:
        return rng.random((n_points, dimension))
    distance = hard_core / n_points ** (1 / dimension)
    if cell is None or np.array_equal(cell, cell[0, 0] * np.eye(dimension)):
        return random_sequential_addition(n_points, distance, rng, dimension)
    if not distance > 0:
        raise InputError(f"the hard core must be positive, or zero for independent points, not {hard_core}")
    short, rows = short_cell(cell)
    shape = short / abs(np.linalg.det(short)) ** (1 / dimension)
    if np.linalg.norm(shape, axis=1).min() < 2 * distance:
        raise InputError(f"{n_points} points are too few for so thin a cell: use more points, or a shorter cell")
    if hard_core > _DENSEST.get(dimension, np.inf):
        raise _no_space(n_points, distance, _MAX_RESTARTS, dimension)
    return (_added(n_points, distance, rng, dimension, shape) @ rows) % 1.0


def check_addition(n_points: int, distance: float, dimension: int) -> None:
    """Raise `InputError` for points that cannot be placed, without placing any."""
    if n_points < 1 or not distance > 0:
        raise InputError(
            f"random sequential addition needs points and a positive distance, not {n_points} and {distance}"
        )
    if dimension < 1:
        raise InputError(f"points need a dimension of at least 1, not {dimension}")
    check_size(n_points)
    if distance * n_points ** (1 / dimension) > _DENSEST.get(dimension, np.inf):
        raise _no_space(n_points, distance, "any number of", dimension)


def _no_space(n_points: int, distance: float, tries: int | str, dimension: int) -> InputError:
    return InputError(
        f"{n_points} points never fitted at a distance of {distance:.4g} in {tries} tries: lower the hard core "
        f"(ρ = {_SATURATED.get(dimension, 0.9)} is the limit in {dimension} dimensions)"
    )


# Voxels a point, at most: a number that is reached at ρ = 0.045 in the plane and 0.17 in space.
_MOST_VOXELS = 1000
# Number of trials from which those of an empty cell are tested in parts: the pairs of all of them are many more than
# those of each eighth that earlier ones leave uncovered.  Number of places in one vectorised step.
_MANY_TRIALS, _BLOCK = 1 << 12, 1 << 16
# Coordinate of the point of an empty grid cell: farther away than any hard core.
_NOWHERE = 1e3


def _added(
    n_points: int, distance: float, rng: np.random.Generator, dimension: int, shape: Array | None = None
) -> Array:
    """Points by random sequential addition, in units of the vectors of a short cell of volume 1; by default a cube."""
    # Voxels that follow a small hard core would be many more than the points.  Those of one point each are not tested
    # in a grid, whose cells hold one point at most.
    sparse = distance * (_MOST_VOXELS * n_points) ** (1 / dimension) < np.sqrt(dimension)
    reach = 2 * np.sqrt(dimension) / n_points ** (1 / dimension) if sparse else distance
    shape = np.eye(dimension) if sparse and shape is None else shape
    norms = np.ones(dimension) if shape is None else np.linalg.norm(shape, axis=1)
    # A voxel has half the side of a grid cell in an oblique cell, whose voxels are tested by the spheres around them.
    per_side: Any = _per_side(reach, dimension)
    if shape is not None:
        per_side = np.ceil(2 * np.sqrt(dimension) * norms / reach).astype(int)
    corners = np.array(list(product((0, 1), repeat=dimension)))
    for _ in range(_MAX_RESTARTS):
        voxels = np.indices(np.broadcast_to(per_side, dimension).tolist()).reshape(dimension, -1).T / per_side
        side, points = 1 / per_side, np.empty((0, dimension))
        covered: Any = None
        while len(points) < n_points and len(voxels):
            # As many trials as uncovered voxels is cheap and rarely places two in reach of each other.
            trials = voxels.take(rng.integers(len(voxels), size=len(voxels)), 0)
            trials += side * rng.random((len(voxels), dimension))
            trials -= trials >= 1.0
            n_before, in_parts = len(points), len(points) == 0 and len(trials) >= _MANY_TRIALS
            for part in np.array_split(trials, 8) if in_parts else [trials]:
                free = part if covered is None else part.take(_clear(covered, part, 0.0, distance, shape), 0)
                points = np.concatenate([points, free.take(_first_come(free, distance, shape), 0)])[:n_points]
                covered = _covered(points, distance, shape)
            if len(points) == n_points:
                cell = np.floor(points * norms * n_points ** (1 / dimension)).astype(int)
                return np.asarray(points[np.lexsort(cell.T)])
            # Halving the voxels follows the shrinking holes; while holes are large it would only cost.
            voxels = voxels.take(_clear(covered, voxels + side / 2, side / 2, distance, shape), 0)
            if len(points) - n_before < 0.2 * max(len(voxels), 1):
                side = side / 2
                voxels = (voxels[:, None] + side * corners).reshape(-1, dimension)
    raise _no_space(n_points, distance, _MAX_RESTARTS, dimension)


def _per_side(distance: float, dimension: int) -> int:
    """Cells a side of a grid whose cells have a diagonal of at most `distance`, and so hold one point at most."""
    return int(np.ceil(np.sqrt(dimension) / distance))


def _covered(points: Array, distance: float, shape: Array | None) -> Any:
    """Points for `_clear`: with the shape of a cell a tree of them and their images, else a grid in a cube, (m, d).

    The grid has two layers of periodic images around it.
    """
    if shape is not None:
        ids, images = near_images(points, shape, distance)
        return scipy.spatial.cKDTree((points[ids] + images) @ shape)
    dimension = points.shape[1]
    per_side = _per_side(distance, dimension)
    grid = np.full((per_side,) * dimension + (dimension,), _NOWHERE)
    grid[tuple(np.floor(points * per_side).astype(int).T)] = points
    padded = np.pad(grid, [(2, 2)] * dimension + [(0, 0)], mode="wrap")
    for axis in range(dimension):
        ends = np.moveaxis(padded[..., axis], axis, 0)
        ends[:2] -= 1.0
        ends[-2:] += 1.0
    return padded.reshape(-1, dimension)


def _clear(covered: Any, places: Array, half_width: Any, distance: float, shape: Array | None) -> IntArray:
    """The places, or voxels of that half width around them, whose even farthest corner is clear of all points."""
    dimension = places.shape[1]
    if shape is not None:
        gap = covered.query(places @ shape, distance_upper_bound=distance)[0]
        signs = np.array(list(product((-1, 1), repeat=dimension)))
        return np.flatnonzero(gap >= distance - np.linalg.norm(signs * half_width @ shape, axis=1).max())

    # Steps to the cells from which a point can cover a voxel that lies in one cell: the nearest first, which settles
    # most places at once; but the cell of a place itself is mostly empty.
    per_side = _per_side(distance, dimension)
    steps = np.array(list(product(range(-2, 3), repeat=dimension)))
    steps = steps[np.roll(np.argsort(np.sum(steps**2, axis=1), kind="stable"), -1)]
    away = np.abs(steps)
    gap = np.maximum(away - 1, 0) / per_side + np.where(away, 2, 1) * half_width
    strides = (per_side + 4) ** np.arange(dimension - 1, -1, -1)
    reach = (steps[np.sum(gap**2, axis=1) < (1 + 1e-9) * distance**2] + 2) @ strides

    clear = [np.zeros(0, int)]
    # Blocks stay in the cache of the processor, and shrink with every place that is covered.
    for start in range(0, len(places), _BLOCK):
        at = places[start : start + _BLOCK]
        cell = np.floor(at * per_side).astype(int) @ strides
        left = np.arange(start, start + len(at))
        for step in reach:
            apart = covered.take(cell + step, axis=0)
            np.subtract(at, apart, out=apart)
            np.abs(apart, out=apart)
            apart += half_width
            apart *= apart
            far = np.flatnonzero(sum(apart.T) >= distance**2)
            if len(far) < len(left):
                left, cell, at = left.take(far), cell.take(far), at.take(far, axis=0)
        clear.append(left)
    return np.concatenate(clear)


def _first_come(trials: Array, distance: float, shape: Array | None) -> IntArray:
    """The trials that remain when each, in order, must keep its distance to all that remain before it."""
    if shape is None:
        # A simple tree with small leaves is the fastest for one query.
        tree = scipy.spatial.cKDTree(trials, leafsize=8, boxsize=1.0, balanced_tree=False, compact_nodes=False)
        pairs = tree.query_pairs(distance, output_type="ndarray")
    else:
        ids, images = near_images(trials, shape, distance)
        tree = scipy.spatial.cKDTree((trials[ids] + images) @ shape)
        pairs = np.sort(ids[tree.query_pairs(distance, output_type="ndarray")], axis=1)
    earlier, later = np.ascontiguousarray(pairs.T)
    taken, refused = np.zeros((2, len(trials)), bool)
    while len(earlier):
        # A trial that waits for no earlier one is taken, and refuses the later ones in its reach.
        waiting = np.zeros(len(trials), bool)
        waiting[later] = True
        taken |= ~waiting & ~refused
        refused[later[taken[earlier]]] = True
        open_ = ~refused[earlier] & ~refused[later] & ~taken[earlier]
        earlier, later = earlier[open_], later[open_]
    return np.flatnonzero(~refused)


# Tessellations

Edges = Callable[[Array, Array], tuple[IntArray, IntArray, Array]]


def _tessellation(points: ArrayLike, cell: ArrayLike | None, edges_of: Edges) -> Network:
    """The periodic network that `edges_of` makes of points (n, d) in units of the cell vectors.

    cell   (d, d) vectors as rows; by default a cube of volume V = N_v

    Raises `InputError` when the points are too few or too regular to have one Delaunay tessellation.
    """
    given = np.asarray(points, dtype=float)
    if given.ndim != 2 or given.size == 0 or given.shape[1] < 2 or not np.isfinite(given).all():
        raise InputError(
            f"points must be finite and of shape (n, d) with d >= 2, not {given.shape}: "
            "give points in units of the cell vectors"
        )
    if (span := np.ptp(given, axis=0).max()) > 1 + 1e-9:
        raise InputError(
            f"the points span {span:.3g} cells, but are in units of the cell vectors: "
            "divide coordinates by the side of the cell, or take them modulo 1"
        )
    # In units of the short vectors, of a cell of volume 1.
    dimension = given.shape[1]
    vectors = None if cell is None else checked_cell(cell, dimension)
    short, rows = short_cell(np.eye(dimension) if vectors is None else vectors)
    shape = short / abs(np.linalg.det(short)) ** (1 / dimension)
    if np.linalg.norm(shape, axis=1).min() < (1 - 1e-9) / len(given) ** (1 / dimension):
        raise InputError(f"{len(given)} points are too few for so thin a cell: use more points, or a shorter cell")
    inside = given @ np.round(np.linalg.inv(rows))
    inside -= np.floor(inside)
    edges, offsets, positions = edges_of(inside, shape)
    if vectors is None:
        vectors = len(positions) ** (1 / dimension) * np.eye(dimension)
    return periodic_network(edges, offsets @ rows, vectors, positions @ (rows @ vectors))


def _voronoi_edges(points: Array, shape: Array) -> tuple[IntArray, IntArray, Array]:
    """Edges, offsets and positions of the Voronoi network: d + 1 edges a vertex.

    Vertices are the circumcentres of the Delaunay simplices of the points, edges join simplices that share a facet.
    """
    n_points, dimension = points.shape
    corners, centres = delaunay_simplices(points, shape)
    # A facet seen from its two simplices differs by a lattice shift, which is the image offset of the edge.
    keep = np.array([[k for k in range(dimension + 1) if k != opposite] for opposite in range(dimension + 1)])
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
    if not matched or (dimension == 2 and len(corners) != 2 * n_points):
        raise InputError(
            f"{n_points} points have no periodic Voronoi tessellation with simple vertices: "
            "they are too few or lie on a regular lattice; use more cells, or another seed"
        )
    tail, head = first // (dimension + 1), second // (dimension + 1)
    step = shift[first] - shift[second]
    # Circumcentres that coincide belong to more than d + 1 points on one sphere, which have several tessellations.
    gap = np.linalg.norm((centres[head] + step - centres[tail]) @ shape, axis=1)
    if gap.min() < 1e-9 * gap.max():
        raise InputError(f"some of the {n_points} points lie on a regular lattice, so vertices coincide: move them")
    wrap = np.floor(centres).astype(int)
    return np.stack([tail, head], axis=1), step + wrap[head] - wrap[tail], centres - wrap


def _delaunay_edges(points: Array, shape: Array) -> tuple[IntArray, IntArray, Array]:
    """Edges, offsets and positions of the Delaunay network, whose vertices are the points: N_b = 3 N_v in the plane."""
    n_points, dimension = points.shape
    corners, _ = delaunay_simplices(points, shape)
    first, second = np.array(list(combinations(range(dimension + 1), 2))).T
    tail, head = (corners[:, ends].reshape(-1, 1 + dimension) for ends in (first, second))
    # Corners are sorted by point and image, so that an edge is seen from the same end in all its simplices.
    rows = np.column_stack([tail[:, 0], head[:, 0], head[:, 1:] - tail[:, 1:]])
    rows = rows[_distinct(rows.T)]
    if dimension == 2 and len(rows) != 3 * n_points:
        raise InputError(
            f"{n_points} points have no unique periodic Delaunay tessellation: "
            "they are too few or lie on a regular lattice; use more points, or another seed"
        )
    return rows[:, :2], rows[:, 2:], points


# Layers of images around the cell, in units of the spacing of points: enough for independent points.
LAYERS = 4.0
# Centre of a simplex without volume: far outside of a cell of volume 1.
_FAR = 1e12


def delaunay_simplices(points: Array, cell: Array, layers: float = LAYERS) -> tuple[NDArray[np.int64], Array]:
    """Delaunay simplices of periodic points, once each: corners (n, d+1, 1+d) as point and image, centres (n, d).

    Points and centres are in units of the cell, which has volume 1 and short vectors.  Corners are sorted and shifted
    so that the first lies in image zero; the order of simplices follows from the corners, not from the library that
    finds them.

    layers  of images around the cell, in units of the spacing of points, that are laid out first
    """
    n_points, dimension = points.shape
    margin = min(1.0, layers / n_points ** (1 / dimension))
    while True:
        ids, images = near_images(points, cell, margin)
        coordinates = (points[ids] + images) @ cell
        simplices = scipy.spatial.Delaunay(coordinates).simplices
        centres, radii = _circumcentres(coordinates[simplices])
        centres = centres @ np.linalg.inv(cell)
        inside = ((centres > -1e-6) & (centres < 1 + 1e-6)).all(axis=1)
        # A simplex is one of the infinite tessellation if its circumsphere lies within the points laid out.
        if radii[inside].max(initial=np.inf if not inside.any() else 0.0) < margin:
            break
        if margin >= 3.0:
            raise InputError(f"{n_points} points are too few for a periodic tessellation of this cell: use more")
        margin = min(3.0, 2 * margin)
    simplices, centres = simplices[inside], centres[inside]
    corners = np.concatenate([ids[simplices][:, :, None], images[simplices]], axis=2)
    # Sorting by point, then image, makes the first corner independent of the image in which the simplex appears.
    code, reach = corners[:, :, 0], 1 + int(np.abs(corners[:, :, 1:]).max())
    for axis in range(dimension):
        code = code * (2 * reach) + corners[:, :, 1 + axis] + reach
    corners = np.take_along_axis(corners, np.argsort(code, axis=1)[:, :, None], axis=1)
    base = corners[:, 0, 1:].copy()
    corners[:, :, 1:] -= base[:, None]
    chosen = _distinct(corners.reshape(len(corners), -1).T)
    return corners[chosen], (centres - base)[chosen]


def _circumcentres(corners: Array) -> tuple[Array, Array]:
    """Centres (n, d) and radii (n,) of the spheres through simplices (n, d+1, d)."""
    sides = corners[:, 1:] - corners[:, :1]
    volume = np.abs(np.linalg.det(sides))
    thin = volume < 1e-12 * np.max(np.sum(sides**2, axis=2), axis=1)
    sides[thin] = np.eye(corners.shape[2])
    offset = np.linalg.solve(sides, 0.5 * np.sum(sides**2, axis=2)[:, :, None])[:, :, 0]
    # Slivers on the hull have no centre within reach; the caller looks only at those whose centre is inside.
    offset[thin] = _FAR
    return corners[:, 0] + offset, np.sqrt(np.sum(offset**2, axis=1))


def _distinct(columns: Iterable[NDArray[np.int64]]) -> IntArray:
    """Index of the first of all equal rows of columns of whole numbers, in lexicographic order of the rows."""
    keys = _packed(columns)
    order = np.lexsort(keys[::-1])
    new = np.zeros(len(order), bool)
    new[:1] = True
    for key in keys:
        new[1:] |= key[order[1:]] != key[order[:-1]]
    return np.asarray(order[new])


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


# Networks


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
    n_vertices, seed = _checked(n_vertices, seed, hard_core, cell, points)
    if points is not None:
        return _tessellation(points, cell, _voronoi_edges)
    check_voronoi(n_vertices, hard_core)
    shape = None if cell is None else checked_cell(cell, 2)
    points = points_in_cell(n_vertices // 2, hard_core, generator(seed), shape)
    scale = 1.0 if shape is None else np.sqrt(n_vertices / abs(np.linalg.det(shape)))
    return _tessellation(points, None if shape is None else shape * scale, _voronoi_edges)


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
    n_vertices, seed = _checked(n_vertices, seed, hard_core, cell, points)
    if points is not None:
        return _tessellation(points, cell, _delaunay_edges)
    if n_vertices < 4:
        raise InputError(f"n_vertices must be a whole number of at least 4, not {n_vertices}")
    shape = np.eye(2) if cell is None else checked_cell(cell)
    scale = (n_vertices / abs(np.linalg.det(shape))) ** (1 / len(shape))
    points = points_in_cell(n_vertices, hard_core, generator(seed), shape)
    return _tessellation(points, scale * shape, _delaunay_edges)


def _checked(
    n_vertices: int | None, seed: Any, hard_core: float, cell: ArrayLike | None, points: ArrayLike | None
) -> tuple[int, Any]:
    """Number of vertices and seed; `InputError` for arguments of other kinds, and for points and their number."""
    n_vertices = of_kind(int, None, n_vertices=n_vertices)
    seed = of_kind(int, np.random.Generator, seed=seed)
    of_kind(float, hard_core=hard_core)
    of_kind(np.ndarray, None, cell=cell, points=points)
    if points is not None and n_vertices is not None:
        raise InputError("the number of vertices follows from the points: give n_vertices or points")
    return _N_VERTICES if n_vertices is None else n_vertices, seed


def check_voronoi(n_vertices: int, hard_core: float = STANDARD_HARD_CORE) -> None:
    """Raise `InputError` for arguments without a `voronoi_network`, without making one."""
    if n_vertices < 4 or n_vertices % 2:
        raise InputError(
            f"n_vertices must be an even number of at least 4, not {n_vertices}: a Voronoi network has two a cell"
        )
    check_size(n_vertices)
    if hard_core != 0:
        check_addition(n_vertices // 2, hard_core / np.sqrt(n_vertices // 2), dimension=2)
