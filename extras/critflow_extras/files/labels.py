"""Label masks of segmented tissue: the whole numbers of a picture name its cells."""

from __future__ import annotations

from importlib import import_module  # at its use: a library of 0.2 s that only files of pictures need
from itertools import pairwise
from pathlib import Path

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from critflow.arguments import floats, of_kind
from critflow.checks import components
from critflow.result import InputError
from critflow_extras.files.data import Array, IntArray, NetworkData, counted

# Sides of pixels in a border inside a corner, at most.
_INSIDE = 8
# Part of the pixels of label 0 beside cells that lie between two of them; at an outline only its corners do.
_GAPS = 1 / 3
_TOUCHING_CELLS = "give a segmentation of touching cells, such as skimage.segmentation.expand_labels makes"
# Of four neighbours, since a diagonal line has gaps for eight.
_LABELLED_CELLS = (
    "label the cells first, as skimage.measure.label(interior, connectivity=1) does, then close the lines between "
    "labels with skimage.segmentation.expand_labels, whose distance is at least their width"
)
# Fewest sides of pixels between vertices on a border: their mean is that of the border within a fraction of a pixel.
_SPACING = 4


def read_labels(path: Path) -> NDArray:
    """The values of a picture (rows, columns), or of its pages (pages, rows, columns); also those of a file .npy."""
    if path.suffix.lower() == ".npy":
        return np.asarray(np.load(path, allow_pickle=False))
    with import_module("PIL.Image").open(path) as image:
        pages = np.stack([np.asarray(page) for page in import_module("PIL.ImageSequence").Iterator(image)])
    if pages.ndim == 4:
        # Grey values that are stored as equal colours, with or without opacity.
        if (pages[..., 1:3] != pages[..., :1]).any():
            raise InputError(f"{path} has colours: save its labels as whole numbers")
        pages = pages[..., 0]
    return pages[0] if len(pages) == 1 else pages


def from_labels(labels: ArrayLike, pixel: ArrayLike = 1.0, traced: int = 0) -> NetworkData:
    """The cell network of a label mask: vertices are corners at which three or more labels meet, edges join them.

    Label 0 is the outside, each other one a face.  Corners closer than 2.5 pixels, such as those of a four-fold one,
    are one vertex.

    traced  vertices of two edges on each border, which follow its curvature; fewer where it is short, and none at the
            edges of the picture
    """
    traced = of_kind(int, traced=traced)
    if traced < 0:
        raise InputError(f"traced must be a number of vertices on each border from 0, not {traced}")
    mask = np.asarray(labels)
    if mask.ndim != 2 or mask.dtype.kind not in "iub":
        raise InputError("a label mask is a two-dimensional array of whole numbers, 0 outside: give a page of it")
    size, padded = _pixel_sizes(pixel), np.pad(mask.astype(np.int64), 1)
    if (n := len(np.unique(mask))) <= 2:
        raise InputError(f"a picture of {counted(n, 'value')} shows outlines or no cells at all: {_LABELLED_CELLS}")
    _require_touching(padded)
    # Corners of pixels around which at least three labels meet.
    around = np.stack([padded[:-1, :-1], padded[:-1, 1:], padded[1:, :-1], padded[1:, 1:]], axis=-1)
    distinct = 1 + (np.diff(np.sort(around, axis=-1), axis=-1) != 0).sum(axis=-1)
    corners = np.asarray(np.argwhere(distinct >= 3) + 0.5)
    if not len(corners):
        raise InputError(f"no three labels meet anywhere in the mask: {_TOUCHING_CELLS}")
    points, vertex = _merged(corners, 2.5)
    edges, sides, closed, paths = _borders(padded, corners, vertex)
    if not len(edges):
        raise InputError(f"no two corners share a border of two labels: {_TOUCHING_CELLS}")
    at_edge = (corners == 0.5) | (corners == np.array(mask.shape) + 0.5)
    notes = [f"{len(points)} corners and {len(edges)} borders were found"]
    if traced:
        points, edges, sides = _along(paths, points, edges, sides, traced, mask.shape)
        notes.append(f"{len(edges)} edges follow them, with up to {counted(traced, 'vertex')} on each")
    if closed:
        notes.append(f"{counted(closed, 'border')} from a corner to itself or without any, left out")
    return NetworkData(
        edges=edges,
        positions=((points - 1) * size)[:, ::-1] * [1, -1],
        sides=sides,
        border=tuple(np.unique(vertex[at_edge.any(axis=1)]).tolist()),
        source="label mask",
        notes=tuple(notes),
    )


def _require_touching(mask: IntArray) -> None:
    """Raise `InputError` where lines of label 0 separate the cells."""
    mask, outside = np.abs(mask), mask == 0
    highest = scipy.ndimage.maximum_filter(mask, 3)[outside]
    lowest = scipy.ndimage.minimum_filter(np.where(outside, mask.max(), mask), 3)[outside]
    beside, between = int((highest > 0).sum()), int((lowest < highest).sum())
    if between > _GAPS * beside:
        raise InputError(f"lines of label 0, {between:,} pixels, separate the cells: {_TOUCHING_CELLS}")


def _pixel_sizes(pixel: ArrayLike) -> Array:
    """The size of a pixel along rows and columns (2,), from one number or two."""
    sizes = floats(pixel, "pixel")
    if sizes.shape not in ((), (2,)) or not ((sizes > 0) & (sizes < np.inf)).all():
        raise InputError(f"pixel must be a positive size, or 2 of them, not {pixel!r:.40}")
    return np.broadcast_to(sizes, 2)


def _borders(mask: IntArray, corners: Array, vertex: IntArray) -> tuple[IntArray, IntArray, int, list[Array]]:
    """The two vertices and labels of each border of two labels, the number of other borders, and the paths.

    A border is a chain of sides of pixels from one corner to the next; two labels may have several.
    """
    width = mask.shape[1] - 1
    r, c = np.nonzero(mask[:, :-1] != mask[:, 1:])
    across = np.column_stack([(r - 1) * width + c, r * width + c])
    labels = np.column_stack([mask[r, c], mask[r, c + 1]])
    r, c = np.nonzero(mask[:-1] != mask[1:])
    sides = np.concatenate([across, np.column_stack([r * width + c - 1, r * width + c])])
    labels = np.concatenate([labels, np.column_stack([mask[r, c], mask[r + 1, c]])])
    at = np.full((mask.shape[0] - 1) * width, -1)
    r, c = np.floor(corners).astype(int).T
    at[r * width + c] = vertex
    n = len(sides)
    side, end = np.nonzero(at[sides] < 0)
    chain = components(np.column_stack([side, n + sides[side, end]]), n + len(at))[:n]
    side, end = np.nonzero(at[sides] >= 0)
    touched = np.unique(np.column_stack([chain[side], at[sides[side, end]]]), axis=0)
    count = np.bincount(touched[:, 0], minlength=int(chain.max(initial=-1)) + 1)
    edges = touched[count[touched[:, 0]] == 2][:, 1].reshape(-1, 2)
    # All sides of a chain have the same two labels; the outside is none.
    first = np.unique(chain, return_index=True)[1]
    named = np.where(labels == 0, -1, labels)[first[count == 2]]
    long = np.bincount(chain, minlength=len(count)) > _INSIDE
    order = np.argsort(chain, kind="stable")
    pieces = np.split(order, np.cumsum(np.bincount(chain, minlength=len(count)))[:-1])
    paths = [_walked(sides[pieces[c]], at, int(edges[n, 0]), width) for n, c in enumerate(np.flatnonzero(count == 2))]
    return edges, named, int((long & (count != 2)).sum()), paths


def _walked(sides: IntArray, at: IntArray, start: int, width: int) -> Array:
    """Middles (n, 2) of the sides of pixels of one chain, in turn from a vertex."""
    around: dict[int, list[int]] = {}
    for side, ends in enumerate(sides.tolist()):
        for end in ends:
            around.setdefault(end, []).append(side)
    point = next(end for end in around if at[end] == start)
    left, turn = set(range(len(sides))), []
    while following := [side for side in around[point] if side in left]:
        left.remove(following[0])
        turn.append(following[0])
        a, b = sides[following[0]].tolist()
        point = a + b - point
    return np.asarray(np.stack(np.divmod(sides[turn], width), axis=-1).mean(axis=1) + 0.5)


def _along(
    paths: list[Array], points: Array, edges: IntArray, sides: IntArray, traced: int, shape: tuple[int, ...]
) -> tuple[Array, IntArray, IntArray]:
    """Points, edges and their labels with vertices on the borders, each the mean of the path around it."""
    places, owners = list(points), list[int]()
    chains = list[tuple[int, int]]()
    for number, path in enumerate(paths):
        ends = edges[number].tolist()
        at_edge = ((path == 0.5) | (path == np.array(shape) + 0.5)).any(axis=1)
        n = 0 if at_edge.all() else max(min(traced, len(path) // _SPACING - 1), 0)
        cuts = ((np.arange(n + 1) + 0.5) * len(path) / (n + 1)).astype(int)
        inner = [path[low:high].mean(axis=0) for low, high in pairwise(cuts)]
        walk = [ends[0], *range(len(places), len(places) + n), ends[1]]
        places += inner
        chains += pairwise(walk)
        owners += [number] * (n + 1)
    return np.array(places), np.array(chains), sides[owners]


def _merged(points: Array, distance: float) -> tuple[Array, IntArray]:
    """Points closer than a distance, joined to their mean; and the joined point of each."""
    group = components(scipy.spatial.KDTree(points).query_pairs(distance, output_type="ndarray"), len(points))
    sums = np.stack([np.bincount(group, points[:, k]) for k in range(points.shape[1])], axis=1)
    return np.asarray(sums / np.bincount(group)[:, None]), group
