"""Solids to print: STL and 3MF of round struts with balls at their ends, in millimetres, watertight bodies each."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import scipy

from critflow.exchange.data import Array, NetworkData
from critflow.exchange.drawings import clipped_segments, relative_sections
from critflow.exchange.packages import optional
from critflow.result import InputError

# STL has no field for units, and programs show its header of 80 bytes.
_HEADER = b"critflow network, lengths in millimetres".ljust(80)
# Sides of a strut; part of the radius by which struts end inside the balls.
_SIDES, _INSET = 12, 0.2


def write_solid(
    data: NetworkData, path: Path, size: float = 100.0, radius: float = 1.0, by_stiffness: bool = False
) -> None:
    """STL or 3MF of struts of a radius in mm; the longest extent of the network is `size` mm.

    by_stiffness  struts have k = E π r²/|L|: radii ∝ √(k|L|), whose mean cross section is that of `radius`

    Struts and balls are closed bodies that overlap; slicers join them.  A periodic network is cut at its cell.
    """
    if not radius > 0 or not size > 0:
        raise InputError("size and radius of a solid must be positive, in millimetres")
    segments, edges = clipped_segments(data)
    space = np.zeros((*segments.shape[:2], 3))
    space[..., : data.dimension] = segments
    ends = space.reshape(-1, 3)
    radii = radius * (np.sqrt(relative_sections(data))[edges] if by_stiffness else np.ones(len(edges)))
    mesh = struts((space - ends.min(axis=0)) * (size / float(np.ptp(ends, axis=0).max())), radii)
    if path.suffix.lower() == ".stl":
        path.write_bytes(_HEADER + mesh.export(file_type="stl")[80:])
    else:
        # The unit of trimesh's files is the millimetre.
        path.write_bytes(mesh.export(file_type="3mf"))


def struts(segments: Array, radii: Array) -> Any:
    """The trimesh of prisms of radii (n,) along segments (n, 2, 3) and of balls at their distinct ends."""
    trimesh = optional("trimesh")
    L = segments[:, 1] - segments[:, 0]
    length = np.linalg.norm(L, axis=1)
    axis = L / length[:, None]
    across = np.cross(axis, np.where(np.abs(axis[:, :1]) < 0.9, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]]))
    across = across / np.linalg.norm(across, axis=1)[:, None]
    # Prisms end inside the balls, so that those in one line share no vertex when a program joins equal ones.
    inset, wide = np.minimum(_INSET * radii, 0.25 * length), radii[:, None]
    frames = np.stack([wide * across, wide * np.cross(axis, across), axis * (length - 2 * inset)[:, None]], axis=1)
    prism = trimesh.creation.cylinder(radius=1.0, height=1.0, sections=_SIDES)
    ball = trimesh.creation.icosphere(subdivisions=1, radius=1.0)
    corners, sizes = _balls(segments.reshape(-1, 3), np.repeat(radii, 2))
    bodies = ((prism.vertices @ frames + segments.mean(axis=1)[:, None], prism.faces),
              (corners[:, None] + sizes[:, None, None] * ball.vertices, ball.faces))  # fmt: skip
    points, triangles, count = [], [], 0
    for places, faces in bodies:
        m, n = places.shape[:2]
        points.append(places.reshape(-1, 3))
        triangles.append((faces + (count + n * np.arange(m))[:, None, None]).reshape(-1, 3))
        count += m * n
    return trimesh.Trimesh(np.concatenate(points), np.concatenate(triangles), process=False)


def _balls(points: Array, radii: Array) -> tuple[Array, Array]:
    """Points of which no two are close, except in chains, and the largest radius (n,) of the struts that end there."""
    order = np.arange(len(points))
    pairs = scipy.spatial.KDTree(points).query_pairs(_INSET * float(radii.min()), output_type="ndarray")
    np.minimum.at(order, pairs.max(axis=1), pairs.min(axis=1))
    largest = radii.copy()
    np.maximum.at(largest, order, radii)
    own = order == np.arange(len(points))
    return points[own], largest[own]
