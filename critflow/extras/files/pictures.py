"""Networks in pictures: skeletons of fibres, in the plane or a stack, and label masks of segmented tissue."""

from __future__ import annotations

from importlib import import_module  # at their use: libraries of 0.2 s that only pictures need
from pathlib import Path
from warnings import catch_warnings

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from critflow.extras.files.data import Array, IntArray, NetworkData, counted, optional
from critflow.networks.blocks import components
from critflow.networks.checks import floats
from critflow.result import InputError

# Sides of pixels in a border inside a corner, at most.
_INSIDE = 8
# Spurs are at most this number of half widths long: the corners of a square end are √2 from its middle.
_SPUR = 1.5
# A fibre runs within this root mean square of the pixels of its skeleton, in pixels: a straight one moves by up to half
# a pixel from row to row.
_NOISE = 0.5
# Weight of the ends of a branch in the fit of its curve, which passes through its vertices.
_AT_ENDS = 100.0


def read_picture(path: Path) -> NDArray:
    """The values of a picture (rows, columns), or of a stack (pages, rows, columns); also those of a file .npy."""
    if path.suffix.lower() == ".npy":
        return np.asarray(np.load(path, allow_pickle=False))
    images = import_module("PIL.Image")
    with images.open(path) as image:
        pages = np.stack([np.asarray(page) for page in import_module("PIL.ImageSequence").Iterator(image)])
    if pages.ndim == 4:
        # Grey values that are stored as equal colours, with or without opacity.
        if (pages[..., 1:3] != pages[..., :1]).any():
            raise InputError(f"{path} has colours: save its fibres as black and white, or its labels as whole numbers")
        pages = pages[..., 0]
    return pages[0] if len(pages) == 1 else pages


def read_fibres(path: Path, pixel: ArrayLike = 1.0) -> NetworkData:
    """The network of the fibres in a picture file."""
    return from_skeleton(read_picture(path), pixel)


def pixel_sizes(pixel: ArrayLike, dimension: int) -> Array:
    """The size of a pixel along each axis of a picture (d,), from one number or d of them."""
    sizes = floats(pixel, "pixel")
    if sizes.shape not in ((), (dimension,)) or not ((sizes > 0) & (sizes < np.inf)).all():
        raise InputError(f"pixel must be a positive size, or {dimension} of them, not {pixel!r:.40}")
    return np.broadcast_to(sizes, dimension)


def from_skeleton(picture: ArrayLike, pixel: ArrayLike = 1.0) -> NetworkData:
    """The network of a binary picture or stack of fibres: skeletonised, branch points are vertices, branches edges.

    pixel  size of a pixel in the units of length, or one for each axis of the array

    Rest lengths are those of smooth curves along the branches, and never below the distance of their ends.
    """
    image = np.asarray(picture)
    if image.ndim not in (2, 3) or image.dtype.kind not in "biuf" or image.size == 0:
        raise InputError("a picture of fibres is an array of two or three dimensions that is true on the fibres")
    low, high = image.min(), image.max()
    if not ((image == low) | (image == high)).all():
        raise InputError(
            "a picture of fibres has two values, and this one has more: compare it with a threshold; or give labels= "
            "if its values number the cells of a tissue"
        )
    if low == high:
        raise InputError("the picture has one value only: give an array that is true on the fibres and false elsewhere")
    image, size = image == high, pixel_sizes(pixel, image.ndim)
    branches = optional("skan").Skeleton(optional("skimage.morphology").skeletonize(image))
    paths = [branches.path_coordinates(n) for n in range(branches.n_paths)]
    tips = np.array([[p[0], p[-1]] for p in paths])
    lengths = np.array([np.linalg.norm(np.diff(p, axis=0) * size, axis=1).sum() for p in paths])
    # Half the width of the fibre at each end.
    width = scipy.ndimage.distance_transform_edt(image, sampling=size.tolist())
    reach = width[tuple(tips.reshape(-1, image.ndim).astype(int).T)].reshape(-1, 2)
    # Pixels of one junction are one vertex: those closer than two pixels.
    points, inverse = _merged(tips.reshape(-1, image.ndim), 2.0)
    edges, places, kept, notes = _without_short(inverse.reshape(-1, 2), points, lengths, reach)
    ends = places[edges]
    curves = [_curve_length(paths[n], ends[k], reach[n], size) for k, n in enumerate(np.flatnonzero(kept))]
    thick = np.zeros(len(places))
    np.maximum.at(thick, edges, reach[kept])
    gap = np.minimum(places, np.array(image.shape) - 1 - places) * size
    return NetworkData(
        edges=edges,
        positions=_upwards(places * size),
        rest_lengths=np.array(curves),
        border=tuple(np.flatnonzero((gap <= thick[:, None] + size).any(axis=1)).tolist()),
        source="skeleton",
        notes=(f"the skeleton has {len(places)} junctions and ends and {len(edges)} branches", *notes),
    )


def _upwards(places: Array) -> Array:
    """Places (n, d) by pages, rows and columns as x to the right, y upwards, and z."""
    return np.column_stack([places[:, -1], -places[:, -2], places[:, :-2]])


def _curve_length(path: Array, ends: Array, reach: Array, size: Array) -> float:
    """Length of the smooth curve between two vertices through the pixels (n, d) that lie outside their junctions.

    It is the smoothing spline with the fewest knots whose root mean square distance from the pixels is that of pixels.
    """
    apart = np.linalg.norm((path[:, None] - ends) * size, axis=2)
    points = np.concatenate([ends[:1], path[(apart > np.maximum(reach, size.max())).all(axis=1)], ends[1:]])
    chord = float(np.linalg.norm((ends[1] - ends[0]) * size))
    if len(points) < 4:
        return chord
    weights = np.ones(len(points))
    weights[[0, -1]] = _AT_ENDS
    # Where the distance cannot be met to all digits, the curve is next to it, and SciPy warns.
    with catch_warnings(action="ignore", category=RuntimeWarning):
        curve = import_module("scipy.interpolate").make_splprep(points.T, w=weights, s=len(points) * _NOISE**2)[0]
    fine = curve(np.linspace(0, 1, 4 * len(points))).T
    return max(chord, float(np.linalg.norm(np.diff(fine, axis=0) * size, axis=1).sum()))


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
    spurs &= lengths <= _SPUR * np.where(degree[:, 0] >= 3, reach[:, 0], reach[:, 1])
    notes = []
    if (apart := int((edges[inside, 0] != edges[inside, 1]).sum())) > 0:
        notes.append(f"{counted(apart, 'pair')} of junctions nearer than the width of the fibres, joined")
    if spurs.any():
        notes.append(f"{counted(int(spurs.sum()), 'spur')} no longer than the fibre is wide, left out")
    group = components(edges[inside], len(points))
    places = _means(points, group)
    kept = ~inside & ~spurs
    used, ends = np.unique(group[edges[kept]], return_inverse=True)
    return ends.reshape(-1, 2), places[used], kept, tuple(notes)


def from_labels(labels: ArrayLike, pixel: ArrayLike = 1.0) -> NetworkData:
    """The cell network of a label mask: vertices are corners at which three or more labels meet, edges join them.

    Label 0 is the outside, each other one a face.  Corners closer than 2.5 pixels, such as those of a four-fold one,
    are one vertex.
    """
    mask = np.asarray(labels)
    if mask.ndim != 2 or mask.dtype.kind not in "iub":
        raise InputError("a label mask is a two-dimensional array of whole numbers, 0 outside: give a page of it")
    size, padded = pixel_sizes(pixel, 2), np.pad(mask.astype(np.int64), 1)
    # Corners of pixels around which at least three labels meet.
    around = np.stack([padded[:-1, :-1], padded[:-1, 1:], padded[1:, :-1], padded[1:, 1:]], axis=-1)
    distinct = 1 + (np.diff(np.sort(around, axis=-1), axis=-1) != 0).sum(axis=-1)
    corners = np.asarray(np.argwhere(distinct >= 3) + 0.5)
    if not len(corners):
        raise InputError("no three labels meet anywhere in the mask: give a segmentation of touching cells")
    points, vertex = _merged(corners, 2.5)
    edges, sides, closed = _borders(padded, corners, vertex)
    if not len(edges):
        raise InputError("no two corners share a border of two labels: give a segmentation of touching cells")
    at_edge = (corners == 0.5) | (corners == np.array(mask.shape) + 0.5)
    notes = [f"{len(points)} corners and {len(edges)} borders were found"]
    if closed:
        notes.append(f"{counted(closed, 'border')} from a corner to itself or without any, left out")
    return NetworkData(
        edges=edges,
        positions=_upwards((points - 1) * size),
        sides=sides,
        border=tuple(np.unique(vertex[at_edge.any(axis=1)]).tolist()),
        source="label mask",
        notes=tuple(notes),
    )


def _borders(mask: IntArray, corners: Array, vertex: IntArray) -> tuple[IntArray, IntArray, int]:
    """The two vertices and labels of each border of two labels, and the number of other borders longer than a corner.

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
    return edges, named, int((long & (count != 2)).sum())


def _merged(points: Array, distance: float) -> tuple[Array, IntArray]:
    """Points closer than a distance, joined to their mean; and the joined point of each."""
    group = components(scipy.spatial.KDTree(points).query_pairs(distance, output_type="ndarray"), len(points))
    return _means(points, group), group


def _means(points: Array, group: IntArray) -> Array:
    """Mean of the points of each group."""
    sums = np.stack([np.bincount(group, points[:, k]) for k in range(points.shape[1])], axis=1)
    return np.asarray(sums / np.bincount(group)[:, None])
