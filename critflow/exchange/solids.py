"""Solids to print: STL and 3MF of round struts with balls at their ends, in millimetres, watertight bodies each."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.spatial import KDTree

from critflow.exchange.data import Array, NetworkData
from critflow.exchange.drawings import clipped_segments
from critflow.exchange.packages import optional
from critflow.result import InputError

_HEADER = b"critflow network, lengths in millimetres"
# Sides of a strut; part of the radius by which struts end inside the balls.
_SIDES, _INSET = 12, 0.2


def write_solid(data: NetworkData, path: Path, size: float = 100.0, radius: float = 1.0) -> None:
    """STL or 3MF of struts of a radius in mm; the longest extent of the network is `size` mm.

    Struts and balls are closed bodies that overlap; slicers join them.  A periodic network is cut at its cell.
    """
    trimesh = optional("trimesh")
    if not radius > 0 or not size > 0:
        raise InputError("size and radius of a solid must be positive, in millimetres")
    segments = clipped_segments(data)
    space = np.zeros((*segments.shape[:2], 3))
    space[..., : data.dimension] = segments
    ends = space.reshape(-1, 3)
    space = (space - ends.min(axis=0)) * (size / float(np.ptp(ends, axis=0).max()))
    body = trimesh.Trimesh(*struts(space, radius), process=False)
    body.units = "mm"
    if path.suffix.lower() == ".stl":
        # STL has no field for units; programs show its header of 80 bytes.
        path.write_bytes(_HEADER.ljust(80) + body.export(file_type="stl")[80:])
    else:
        body.export(path)


def struts(segments: Array, radius: float) -> tuple[Array, Array]:
    """Vertices and triangles of prisms along segments (n, 2, 3) and of balls at their distinct ends."""
    axis = segments[:, 1] - segments[:, 0]
    axis = axis / np.linalg.norm(axis, axis=1)[:, None]
    helper = np.where(np.abs(axis[:, :1]) < 0.9, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])
    u = np.cross(axis, helper)
    u = u / np.linalg.norm(u, axis=1)[:, None]
    v = np.cross(axis, u)
    angle = 2 * np.pi * np.arange(_SIDES) / _SIDES
    ring = radius * (np.cos(angle)[:, None] * u[:, None] + np.sin(angle)[:, None] * v[:, None])
    # Prisms end inside the balls, so that those in one line share no vertex when a program joins equal ones.
    length = np.linalg.norm(segments[:, 1] - segments[:, 0], axis=1)
    inset = np.minimum(_INSET * radius, 0.25 * length)[:, None, None] * axis[:, None]
    tubes = np.concatenate([segments[:, :1] + inset + ring, segments[:, 1:] - inset + ring], axis=1)
    k = np.arange(_SIDES)
    n = (k + 1) % _SIDES
    side = [np.stack([k, n, k + _SIDES], 1), np.stack([n, n + _SIDES, k + _SIDES], 1)]
    fan = np.stack([np.zeros(_SIDES - 2, int), k[2:], k[1:-1]], 1)
    tube = np.concatenate([*side, fan, fan[:, ::-1] + _SIDES])
    points, faces = _copies(tubes, tube)
    corners = _distinct(segments.reshape(-1, 3), _INSET * radius)
    ball = _octahedral_ball()
    balls, ball_faces = _copies(corners[:, None] + radius * ball[0][None], ball[1])
    return np.concatenate([points, balls]), np.concatenate([faces, ball_faces + len(points)])


def _distinct(points: Array, distance: float) -> Array:
    """Points of which no two are closer than a distance, except in chains."""
    order = np.arange(len(points))
    pairs = KDTree(points).query_pairs(distance, output_type="ndarray")
    np.minimum.at(order, pairs.max(axis=1), pairs.min(axis=1))
    return points[order == np.arange(len(points))]


def _copies(points: Array, triangles: Array) -> tuple[Array, Array]:
    """All points (m, n, 3) in one array, and the triangles of one body for each of them."""
    m, n = points.shape[:2]
    return points.reshape(-1, 3), (triangles[None] + n * np.arange(m)[:, None, None]).reshape(-1, 3)


def _octahedral_ball() -> tuple[Array, Array]:
    """A closed ball of 32 triangles: an octahedron divided once."""
    points = [np.array(p, float) for p in ((1, 0, 0), (0, 1, 0), (0, 0, 1), (-1, 0, 0), (0, -1, 0), (0, 0, -1))]
    faces = [(0, 1, 2), (1, 3, 2), (3, 4, 2), (4, 0, 2), (1, 0, 5), (3, 1, 5), (4, 3, 5), (0, 4, 5)]
    middle: dict[tuple[int, int], int] = {}

    def between(a: int, b: int) -> int:
        key = (min(a, b), max(a, b))
        if key not in middle:
            centre = points[a] + points[b]
            points.append(centre / np.linalg.norm(centre))
            middle[key] = len(points) - 1
        return middle[key]

    fine = []
    for a, b, c in faces:
        ab, bc, ca = between(a, b), between(b, c), between(c, a)
        fine += [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    return np.array(points), np.array(fine)
