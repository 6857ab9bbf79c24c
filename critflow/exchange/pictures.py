"""Networks in pictures: skeletons of fibres, and label masks of segmented tissue."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import distance_transform_edt
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from critflow.exchange.data import Array, IntArray, NetworkData, counted
from critflow.exchange.packages import optional
from critflow.result import InputError

# Sides of pixels in a border inside a corner, at most.
_INSIDE = 8


def from_skeleton(picture: ArrayLike, pixel: float = 1.0) -> NetworkData:
    """The network of a binary picture of fibres: skeletonised, branch points are vertices, branches are edges.

    pixel  size of a pixel in the units of length; rest lengths are the lengths of the branches along their pixels
    """
    image = np.asarray(picture)
    if image.ndim != 2 or not image.any():
        raise InputError(
            "a picture of fibres is a two-dimensional array that is true on the fibres: give such an array"
        )
    skeleton = optional("skimage.morphology").skeletonize(image.astype(bool))
    branches = optional("skan").Skeleton(skeleton, spacing=pixel)
    paths = [branches.path_coordinates(n) for n in range(branches.n_paths)]
    ends = np.array([[p[0], p[-1]] for p in paths])
    lengths = np.asarray(branches.path_lengths(), dtype=float)
    # Half the width of the fibre at each end.
    radius = distance_transform_edt(np.pad(image.astype(bool), 1))[1:-1, 1:-1]
    reach = pixel * radius[tuple(ends.reshape(-1, 2).astype(int).T)].reshape(-1, 2)
    # Pixels of one junction are one vertex: those closer than two pixels.
    points, inverse = _merged(ends.reshape(-1, 2), 2.0)
    edges, places, kept, notes = _without_short(inverse.reshape(-1, 2), points, lengths, reach)
    x = pixel * np.column_stack([places[:, 1], -places[:, 0]])
    return NetworkData(
        edges=edges,
        positions=x,
        rest_lengths=lengths[kept],
        source="skeleton",
        notes=(f"the skeleton has {len(places)} junctions and ends and {len(edges)} branches", *notes),
    )


def _without_short(
    edges: IntArray, points: Array, lengths: Array, reach: Array
) -> tuple[IntArray, Array, NDArray[np.bool_], tuple[str, ...]]:
    """Edges, points and kept branches without those inside the width of the fibres, and sentences on them.

    reach  (N_b, 2) half the width of the fibre at the ends of each branch

    Thick fibres that cross have two junctions, one for each pair of their arms, and their ends have spurs.
    """
    degree = np.bincount(edges.ravel(), minlength=len(points))[edges]
    inside = (degree >= 3).all(axis=1) & (lengths <= reach.sum(axis=1))
    spurs = ~inside & (degree.min(axis=1) == 1) & (degree.max(axis=1) >= 3)
    spurs &= lengths <= np.where(degree[:, 0] >= 3, reach[:, 0], reach[:, 1])
    notes = []
    if (apart := int((edges[inside, 0] != edges[inside, 1]).sum())) > 0:
        notes.append(f"{counted(apart, 'pair')} of junctions nearer than the width of the fibres, joined")
    if spurs.any():
        notes.append(f"{counted(int(spurs.sum()), 'spur')} shorter than half the width of the fibre, left out")
    group = _components(edges[inside], len(points))
    places = _means(points, group)
    kept = ~inside & ~spurs
    used, ends = np.unique(group[edges[kept]], return_inverse=True)
    return ends.reshape(-1, 2), places[used], kept, tuple(notes)


def from_labels(labels: ArrayLike, pixel: float = 1.0) -> NetworkData:
    """The cell network of a label mask: vertices are corners at which three or more labels meet, edges join them.

    Label 0 is the outside.  Corners closer than 2.5 pixels, such as those of a four-fold one, are one vertex.
    """
    mask = np.asarray(labels)
    if mask.ndim != 2 or mask.dtype.kind not in "iub":
        raise InputError("a label mask is a two-dimensional array of whole numbers, 0 outside: give such an array")
    padded = np.pad(mask.astype(np.int64), 1)
    corners = _corners(padded)
    if not len(corners):
        raise InputError("no three labels meet anywhere in the mask: give a segmentation of touching cells")
    points, vertex = _merged(corners, 2.5)
    edges, closed = _borders(padded, corners, vertex)
    if not len(edges):
        raise InputError("no two corners share a border of two labels: give a segmentation of touching cells")
    x = pixel * np.column_stack([points[:, 1] - 1, 1 - points[:, 0]])
    notes = [f"{len(points)} corners and {len(edges)} borders were found"]
    if closed:
        notes.append(f"{counted(closed, 'border')} from a corner to itself or without any, left out")
    return NetworkData(edges=edges, positions=x, source="label mask", notes=tuple(notes))


def _borders(mask: IntArray, corners: Array, vertex: IntArray) -> tuple[IntArray, int]:
    """The two vertices of each border between two labels, and the number of other borders longer than a corner.

    A border is a chain of sides of pixels from one corner to the next; two labels may have several.
    """
    width = mask.shape[1] - 1
    r, c = np.nonzero(mask[:, :-1] != mask[:, 1:])
    across = np.column_stack([(r - 1) * width + c, r * width + c])
    r, c = np.nonzero(mask[:-1] != mask[1:])
    sides = np.concatenate([across, np.column_stack([r * width + c - 1, r * width + c])])
    at = np.full((mask.shape[0] - 1) * width, -1)
    r, c = np.floor(corners).astype(int).T
    at[r * width + c] = vertex
    n = len(sides)
    side, end = np.nonzero(at[sides] < 0)
    chain = _components(np.column_stack([side, n + sides[side, end]]), n + len(at))[:n]
    side, end = np.nonzero(at[sides] >= 0)
    touched = np.unique(np.column_stack([chain[side], at[sides[side, end]]]), axis=0)
    count = np.bincount(touched[:, 0], minlength=int(chain.max(initial=-1)) + 1)
    edges = touched[count[touched[:, 0]] == 2][:, 1].reshape(-1, 2)
    long = np.bincount(chain, minlength=len(count)) > _INSIDE
    return edges, int((long & (count != 2)).sum())


def _corners(mask: IntArray) -> Array:
    """Corners of pixels around which at least three labels meet."""
    blocks = np.stack([mask[:-1, :-1], mask[:-1, 1:], mask[1:, :-1], mask[1:, 1:]], axis=-1)
    distinct = 1 + (np.diff(np.sort(blocks, axis=-1), axis=-1) != 0).sum(axis=-1)
    return np.asarray(np.argwhere(distinct >= 3) + 0.5)


def _merged(points: Array, distance: float) -> tuple[Array, IntArray]:
    """Points closer than a distance, joined to their mean; and the joined point of each."""
    group = _components(KDTree(points).query_pairs(distance, output_type="ndarray"), len(points))
    return _means(points, group), group


def _components(pairs: IntArray, n: int) -> IntArray:
    """The connected component of each of n things."""
    graph = sp.coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(n, n))
    return np.asarray(connected_components(graph, directed=False)[1])


def _means(points: Array, group: IntArray) -> Array:
    """Mean of the points of each group."""
    sums = np.stack([np.bincount(group, points[:, k]) for k in range(points.shape[1])], axis=1)
    return np.asarray(sums / np.bincount(group)[:, None])
