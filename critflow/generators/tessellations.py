"""Periodic Voronoi tessellations of points in a cell of any shape, in two and three dimensions, by their simplices."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from critflow.networks.checks import checked_cell
from critflow.networks.network import Array, IntArray, Network, periodic_network
from critflow.networks.periodic_cell import near_images, short_cell
from critflow.result import InputError


def voronoi_tessellation(points: ArrayLike, cell: ArrayLike | None = None) -> Network:
    """The periodic Voronoi network of points (n_cells, d) in units of the cell vectors; d + 1 edges a vertex.

    cell   (d, d) vectors as rows; by default a cube of volume V = N_v

    Vertices are the circumcentres of the Delaunay simplices of the points, edges join simplices that share a facet.
    Raises `InputError` when the points are too few or too regular to have one Delaunay tessellation.
    """
    tiling = Tiling(points, cell)
    n_points, dimension = tiling.points.shape
    corners, centres = periodic_delaunay(tiling.points, tiling.shape)
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
    if not matched or (dimension == 2 and n_vertices != 2 * n_points):
        raise InputError(
            f"{n_points} points have no periodic Voronoi tessellation with simple vertices: "
            "they are too few or lie on a regular lattice; use more cells, or another seed"
        )
    tail, head = first // (dimension + 1), second // (dimension + 1)
    step = shift[first] - shift[second]
    # Circumcentres that coincide belong to more than d + 1 points on one sphere, which have several tessellations.
    gap = np.linalg.norm((centres[head] + step - centres[tail]) @ tiling.shape, axis=1)
    if gap.min() < 1e-9 * gap.max():
        raise InputError(f"some of the {n_points} points lie on a regular lattice, so vertices coincide: move them")
    wrap = np.floor(centres).astype(int)
    offsets = step + wrap[head] - wrap[tail]
    return tiling.network(np.stack([tail, head], axis=1), offsets, centres - wrap)


class Tiling:
    """Points in units of short vectors of their lattice, and the return to the cell in which they were given.

    points  (n, d) in units of the short vectors, in their cell
    shape   (d, d) short vectors as rows, of volume 1
    """

    def __init__(self, points: ArrayLike, cell: ArrayLike | None):
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
        dimension = given.shape[1]
        self._cell = None if cell is None else checked_cell(cell, dimension)
        short, self._rows = short_cell(np.eye(dimension) if self._cell is None else self._cell)
        self.shape = short / abs(np.linalg.det(short)) ** (1 / dimension)
        if np.linalg.norm(self.shape, axis=1).min() < (1 - 1e-9) / len(given) ** (1 / dimension):
            raise InputError(f"{len(given)} points are too few for so thin a cell: use more points, or a shorter cell")
        self.points = given @ np.round(np.linalg.inv(self._rows))
        self.points -= np.floor(self.points)

    def network(self, edges: IntArray, offsets: IntArray, positions: Array) -> Network:
        """The network with offsets and positions in units of the short vectors, in the cell given."""
        n_vertices, dimension = positions.shape
        cell = n_vertices ** (1 / dimension) * np.eye(dimension) if self._cell is None else self._cell
        return periodic_network(edges, offsets @ self._rows, cell, positions @ (self._rows @ cell))


# Layers of images around the cell in units of the spacing of points: enough for any.
LAYERS = 4.0


def periodic_delaunay(points: Array, cell: Array, layers: float = LAYERS) -> tuple[NDArray[np.int64], Array]:
    """Delaunay simplices of periodic points, once each: corners (n, d+1, 1+d) as point and image, centres (n, d).

    Points and centres are in units of the cell, which has volume 1 and short vectors.  Corners are sorted and shifted
    so that the first lies in image zero; the order of simplices follows from the corners, not from the library that
    finds them.

    layers  of images around the cell, in units of the spacing of points, that are laid out first
    """
    n_points, dimension = points.shape
    margin = min(1.0, layers / n_points ** (1 / dimension))
    to_cell = np.linalg.inv(cell)
    while True:
        ids, images = near_images(points, cell, margin)
        coordinates = (points[ids] + images) @ cell
        simplices = scipy.spatial.Delaunay(coordinates).simplices
        centres, radii = _circumcentres(coordinates[simplices])
        centres = centres @ to_cell
        inside = ((centres > -1e-6) & (centres < 1 + 1e-6)).all(axis=1)
        # A simplex is one of the infinite tessellation if its circumsphere lies within the points laid out.
        if radii[inside].max(initial=np.inf if not inside.any() else 0.0) < margin:
            break
        if margin >= 3.0:
            raise InputError(f"{n_points} points are too few for a periodic tessellation of this cell: use more")
        margin = min(3.0, 2 * margin)
    simplices, centres = simplices[inside], centres[inside]
    corners = np.concatenate([ids[simplices][:, :, None], images[simplices]], axis=2)
    # Sorting by point, then image, makes the first corner independent of the image that the simplex was found in.
    code, reach = corners[:, :, 0], 1 + int(np.abs(corners[:, :, 1:]).max())
    for axis in range(dimension):
        code = code * (2 * reach) + corners[:, :, 1 + axis] + reach
    corners = np.take_along_axis(corners, np.argsort(code, axis=1)[:, :, None], axis=1)
    base = corners[:, 0, 1:].copy()
    corners[:, :, 1:] -= base[:, None]
    chosen = distinct(corners.reshape(len(corners), -1).T)
    return corners[chosen], (centres - base)[chosen]


def distinct(columns: Iterable[NDArray[np.int64]]) -> IntArray:
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


# Centre of a simplex without volume: far outside of a cell of volume 1.
_FAR = 1e12


def _circumcentres(corners: ArrayLike) -> tuple[Array, Array]:
    """Centres (n, d) and radii (n,) of the spheres through simplices (n, d+1, d)."""
    corners = np.asarray(corners)
    sides = corners[:, 1:] - corners[:, :1]
    volume = np.abs(np.linalg.det(sides))
    thin = volume < 1e-12 * np.max(np.sum(sides**2, axis=2), axis=1)
    sides[thin] = np.eye(corners.shape[2])
    offset = np.linalg.solve(sides, 0.5 * np.sum(sides**2, axis=2)[:, :, None])[:, :, 0]
    # Slivers on the hull have no centre within reach; the caller looks only at those whose centre is inside.
    offset[thin] = _FAR
    return corners[:, 0] + offset, np.sqrt(np.sum(offset**2, axis=1))
