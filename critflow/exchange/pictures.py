"""Networks in pictures: skeletons of fibres, and label masks of segmented tissue."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from critflow.exchange.data import Array, IntArray, NetworkData, counted
from critflow.exchange.packages import optional
from critflow.result import InputError


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
    ends = np.array([[p[0], p[-1]] for p in paths]) * pixel
    # Pixels of one junction are one vertex: those closer than two pixels.
    points, inverse = _merged(ends.reshape(-1, 2), 2.0 * pixel)
    edges = inverse.reshape(-1, 2)
    x = np.column_stack([points[:, 1], -points[:, 0]])
    return NetworkData(
        edges=edges,
        positions=x,
        rest_lengths=np.asarray(branches.path_lengths(), dtype=float),
        source="skeleton",
        notes=(f"the skeleton has {len(points)} junctions and ends and {len(edges)} branches",),
    )


def from_labels(labels: ArrayLike, pixel: float = 1.0) -> NetworkData:
    """The cell network of a label mask: vertices are corners at which three or more labels meet, edges join them.

    Label 0 is the outside.  Corners of which several pairs share two labels, such as four-fold ones, are one vertex.
    """
    mask = np.asarray(labels)
    if mask.ndim != 2 or mask.dtype.kind not in "iub":
        raise InputError("a label mask is a two-dimensional array of whole numbers, 0 outside: give such an array")
    padded = np.pad(mask.astype(np.int64), 1)
    corners, meeting = _corners(padded)
    if not len(corners):
        raise InputError("no three labels meet anywhere in the mask: give a segmentation of touching cells")
    points, inverse = _merged(corners.astype(float), 2.5)
    around: list[set[int]] = [set() for _ in points]
    for n, here in zip(inverse, meeting, strict=True):
        around[n] |= here
    pairs: dict[tuple[int, int], list[int]] = {}
    for n, here in enumerate(around):
        members = sorted(here)
        for i, a in enumerate(members):
            for b in members[i + 1 :]:
                pairs.setdefault((a, b), []).append(n)
    edges = [ends for ends in pairs.values() if len(ends) == 2]
    if not edges:
        raise InputError("no two corners share a border of two labels: give a segmentation of touching cells")
    x = pixel * np.column_stack([points[:, 1] - 1, 1 - points[:, 0]])
    several = sum(len(ends) > 2 for ends in pairs.values())
    notes = [f"{len(points)} corners and {len(edges)} borders were found"]
    if several:
        notes.append(f"{counted(several, 'pair')} of labels with borders in several places, which were left out")
    return NetworkData(edges=np.array(edges), positions=x, source="label mask", notes=tuple(notes))


def _corners(mask: IntArray) -> tuple[Array, list[set[int]]]:
    """Corners of pixels around which at least three labels meet, and these labels."""
    blocks = np.stack([mask[:-1, :-1], mask[:-1, 1:], mask[1:, :-1], mask[1:, 1:]], axis=-1)
    ordered = np.sort(blocks, axis=-1)
    distinct = 1 + (np.diff(ordered, axis=-1) != 0).sum(axis=-1)
    corners = np.argwhere(distinct >= 3)
    return np.asarray(corners + 0.5), [set(map(int, blocks[tuple(c)])) for c in corners]


def _merged(points: Array, distance: float) -> tuple[Array, IntArray]:
    """Points closer than a distance, joined to their mean; and the joined point of each."""
    pairs = KDTree(points).query_pairs(distance, output_type="ndarray")
    n = len(points)
    graph = sp.coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(n, n))
    count, group = connected_components(graph, directed=False)
    sums = np.stack([np.bincount(group, points[:, k], minlength=count) for k in range(points.shape[1])], axis=1)
    return sums / np.bincount(group, minlength=count)[:, None], group
