"""Surfaces in three dimensions: grids as quadrilaterals, clipped to a box, shaded and sorted by depth."""

from collections.abc import Sequence

import numpy as np
from matplotlib.colors import to_rgba
from mpl_toolkits.mplot3d import Axes3D
from mpl_toolkits.mplot3d.art3d import Poly3DCollection
from numpy.typing import ArrayLike

from critflow.networks import Array


def surface_quads(points: Array) -> Array:
    """The cells of a grid of points (n, m, 3) as quadrilaterals ((n − 1)(m − 1), 4, 3)."""
    corners = (points[:-1, :-1], points[1:, :-1], points[1:, 1:], points[:-1, 1:])
    return np.stack(corners, axis=2).reshape(-1, 4, points.shape[2])


def clipped_polygons(polygons: Sequence[Array], high: float) -> list[Array]:
    """The parts of convex polygons (n, 3) in which no coordinate exceeds `high`; empty parts are omitted."""
    kept = []
    for polygon in polygons:
        for axis in range(polygon.shape[1]):
            over = polygon[:, axis] - high
            corners = []
            for i, (here, there) in enumerate(zip(over, np.roll(over, -1), strict=True)):
                if here <= 0:
                    corners.append(polygon[i])
                if (here < 0 < there) or (there < 0 < here):
                    corners.append(polygon[i] + here / (here - there) * (polygon[(i + 1) % len(polygon)] - polygon[i]))
            polygon = np.array(corners).reshape(-1, polygon.shape[1])
        if len(polygon) > 2:
            kept.append(polygon)
    return kept


def draw_surfaces(
    axes: Axes3D, surfaces: Sequence[tuple[Sequence[Array], str, float]], light: ArrayLike = (0.3, 0.2, 1.0)
) -> Poly3DCollection:
    """Polygons with the colour and opacity of their surface, shaded, and hidden by those in front of them.

    All are one collection, since matplotlib sorts by depth within a collection only.
    """
    towards = np.asarray(light) / np.linalg.norm(light)
    faces, colours, edges = [], [], []
    for polygons, colour, alpha in surfaces:
        for polygon in polygons:
            normal = np.cross(polygon[2] - polygon[0], polygon[-1] - polygon[1])
            size = np.linalg.norm(normal)
            shade = 0.62 + 0.38 * abs(normal @ towards) / size if size > 0 else 1.0
            faces.append(polygon)
            colours.append((*(shade * np.array(to_rgba(colour)[:3])), alpha))
            # Outlines of opaque faces close the gaps between them.
            edges.append((*colours[-1][:3], float(alpha == 1)))
    # Of lists of different lengths matplotlib takes limits from memory that it does not fill.
    most = max(map(len, faces))
    faces = [np.concatenate([face, np.repeat(face[-1:], most - len(face), axis=0)]) for face in faces]
    collection = Poly3DCollection(np.array(faces), facecolors=colours, edgecolors=edges, linewidths=0.4)
    axes.add_collection3d(collection)
    return collection
