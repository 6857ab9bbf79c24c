"""Periodic cells of any shape: short vectors of a lattice, and images of points near and of lines in a cell."""

from __future__ import annotations

from functools import reduce
from itertools import product

import numpy as np

from critflow.networks.checks import Array, IntArray
from critflow.result import InputError

# Cells thinner than this, relative to the lengths of their short vectors, have no volume within rounding.
FLAT = 1e-10
# Images of points beyond this number do not fit into memory.
MOST_IMAGES = 20_000_000
# Lines nearer to a border, in units of the cell, lie along it.
BORDER = 1e-12


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
    if not abs(np.linalg.det(short)) > FLAT * np.prod(np.linalg.norm(short, axis=1)):
        raise InputError("the cell vectors are parallel within rounding: give vectors that span a volume")
    return short, rows


def near_images(points: Array, cell: Array, margin: float) -> tuple[IntArray, IntArray]:
    """Periodic images, within `margin` of the cell, of points (n, d) in its units: point (m,) and image (m, d)."""
    widths = margin * np.linalg.norm(np.linalg.inv(cell), axis=0)
    if len(points) * np.prod(1 + 2 * widths) > MOST_IMAGES:
        raise InputError(f"{len(points)} points are too few for so long a cell: use more points, or a shorter cell")
    ids, images = [], []
    for image in product(*(range(-layers, layers + 1) for layers in np.ceil(widths).astype(int))):
        shifted = points + image
        near = np.flatnonzero(((shifted > -widths) & (shifted < 1 + widths)).all(axis=1))
        ids.append(near)
        images.append(np.broadcast_to(image, (len(near), points.shape[1])))
    return np.concatenate(ids), np.concatenate(images)


def images_in_cell(ends: Array) -> tuple[Array, IntArray]:
    """Images that touch the cell of lines, ends (n, 2, d) in its units: ends (m, 2, d), and the line of each (m,)."""
    ends = ends - np.floor(ends[:, :1])
    # Along each axis the whole shifts and the lines that they move to the cell: one test for all images of a shift.
    shifts = []
    for low, high in zip(np.minimum(ends[:, 0], ends[:, 1]).T, np.maximum(ends[:, 0], ends[:, 1]).T, strict=True):
        whole = range(-int(np.floor(high.max() + BORDER)), 1 - int(np.floor(low.min())))
        # A line along a border is drawn at the lower one of both.
        shifts.append([(n, (low + n < 1 - BORDER) & ((high + n > BORDER) | (low + n > -BORDER))) for n in whole])
    pieces, lines = [], []
    for image in product(*shifts):
        lines.append(np.flatnonzero(reduce(np.logical_and, [within for _, within in image])))
        pieces.append(ends[lines[-1]] + [n for n, _ in image])
    return np.concatenate(pieces), np.concatenate(lines)
