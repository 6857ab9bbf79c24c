"""Faces of planar networks as polygons, filled behind the edges."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.patches import Polygon
from numpy.typing import ArrayLike

from critflow.figures.plot import CORNERS
from critflow.networks.faces import Faces
from critflow.networks.network import Array, IntArray

SHADE = "#FBE3B5"


def face_polygons(faces: Faces, edges: ArrayLike, coordinates: ArrayLike, bond_vectors: ArrayLike) -> list[Array]:
    """The corners (n_sides, 2) of every face, each whole even where it crosses the border of the cell."""
    arrays = np.asarray(edges), np.asarray(coordinates), np.asarray(bond_vectors)
    return [face_polygon(faces, face, *arrays) for face in range(faces.n_faces)]


def face_polygon(faces: Faces, face: int, edges: IntArray, coordinates: Array, bond_vectors: Array) -> Array:
    """The corners (n_sides, 2) of one face."""
    sides = slice(faces.starts[face], faces.starts[face + 1])
    boundary, signs = faces.edges[sides], faces.signs[sides]
    steps = signs[:, None] * bond_vectors[boundary]
    first = edges[boundary[0], 0 if signs[0] > 0 else 1]
    return coordinates[first] + np.cumsum(steps, axis=0) - steps


def polygon_images(polygon: Array, cell: Array) -> list[Array]:
    """The corners (n, 2) of a polygon in all periodic images that touch the cell."""
    fraction = polygon @ np.linalg.inv(cell)
    low, high = np.ceil(-fraction.max(axis=0)), np.floor(1 - fraction.min(axis=0))
    shifts = product(*(range(int(a), int(b) + 1) for a, b in zip(low, high, strict=True)))
    return [polygon + np.array(shift) @ cell for shift in shifts]


def shade_faces(
    axes: Axes, polygons: Sequence[Array], cell: ArrayLike | None, colours: str | Array = SHADE
) -> PolyCollection:
    """Fill faces behind the edges, of a periodic network in all images that touch the cell and cut at its border.

    colours  one, or one a face (N_f, 4)
    """
    images = [[one] if cell is None else polygon_images(one, np.asarray(cell, dtype=float)) for one in polygons]
    if not isinstance(colours, str):
        colours = np.repeat(colours, [len(pieces) for pieces in images], axis=0)
    shading = PolyCollection([piece for pieces in images for piece in pieces], edgecolors="none", zorder=0)
    shading.set_facecolor(colours)  # type: ignore[arg-type]
    axes.add_collection(shading)
    if cell is not None:
        shading.set_clip_path(Polygon(CORNERS @ np.asarray(cell), closed=True, transform=axes.transData))
    return shading
