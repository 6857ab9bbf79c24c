"""Solids to print: STL and 3MF of round struts with balls at their ends, in millimetres, watertight bodies each."""

from __future__ import annotations

import zipfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from scipy.spatial import KDTree

from critflow.exchange.data import Array, NetworkData
from critflow.exchange.drawings import clipped_segments
from critflow.result import InputError

_HEADER = b"critflow network, lengths in millimetres"
_XML = '<?xml version="1.0" encoding="UTF-8"?>'
_OPC = "http://schemas.openxmlformats.org/package/2006"
_CORE = "http://schemas.microsoft.com/3dmanufacturing"
_CONTENT_TYPES = (
    f'{_XML}<Types xmlns="{_OPC}/content-types">'
    '<Default Extension="rels" ContentType="application/vnd.openxmlformats-package.relationships+xml"/>'
    '<Default Extension="model" ContentType="application/vnd.ms-package.3dmanufacturing-3dmodel+xml"/></Types>'
)
_RELATIONS = (
    f'{_XML}<Relationships xmlns="{_OPC}/relationships"><Relationship Target="/3D/3dmodel.model" Id="rel0" '
    f'Type="{_CORE}/2013/01/3dmodel"/></Relationships>'
)
_MODEL_START = (
    f'{_XML}<model unit="millimeter" xml:lang="en" xmlns="{_CORE}/core/2015/02"><resources>'
    '<object id="1" type="model"><mesh><vertices>\n'
)
_MODEL_END = '</triangles></mesh></object></resources><build><item objectid="1"/></build></model>\n'
# Rows of text that are formatted at once.
_BLOCK = 50_000
# Sides of a strut; part of the radius by which struts end inside the balls.
_SIDES, _INSET = 12, 0.2


def write_solid(data: NetworkData, path: Path, size: float = 100.0, radius: float = 1.0) -> None:
    """STL or 3MF of struts of a radius in mm; the longest extent of the network is `size` mm.

    Struts and balls are closed bodies that overlap; slicers join them.  A periodic network is cut at its cell.
    """
    if not radius > 0 or not size > 0:
        raise InputError("size and radius of a solid must be positive, in millimetres")
    segments = clipped_segments(data)
    space = np.zeros((*segments.shape[:2], 3))
    space[..., : data.dimension] = segments
    ends = space.reshape(-1, 3)
    space = (space - ends.min(axis=0)) * (size / float(np.ptp(ends, axis=0).max()))
    write = _write_stl if path.suffix.lower() == ".stl" else _write_3mf
    write(*struts(space, radius), path)


def _write_stl(points: Array, triangles: Array, path: Path) -> None:
    """Binary STL; it has no field for units, and programs show its header of 80 bytes."""
    records = np.zeros(len(triangles), [("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attributes", "<u2")])
    corners = points[triangles]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    records["normal"] = normal / np.maximum(np.linalg.norm(normal, axis=1), np.finfo(float).tiny)[:, None]
    records["corners"] = corners
    path.write_bytes(_HEADER.ljust(80) + np.uint32(len(triangles)).astype("<u4").tobytes() + records.tobytes())


def _write_3mf(points: Array, triangles: Array, path: Path) -> None:
    """The 3D Manufacturing Format: a zip archive with one model in XML."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        archive.writestr("[Content_Types].xml", _CONTENT_TYPES)
        archive.writestr("_rels/.rels", _RELATIONS)
        with archive.open("3D/3dmodel.model", "w", force_zip64=True) as model:
            model.write(_MODEL_START.encode())
            for rows in _blocks(points):
                model.write(
                    ('<vertex x="%.7g" y="%.7g" z="%.7g"/>\n' * len(rows) % tuple(rows.ravel().tolist())).encode()
                )
            model.write(b"</vertices><triangles>\n")
            for rows in _blocks(triangles):
                line = '<triangle v1="%d" v2="%d" v3="%d"/>\n'
                model.write((line * len(rows) % tuple(rows.ravel().tolist())).encode())
            model.write(_MODEL_END.encode())


def _blocks(rows: Array) -> Iterator[Array]:
    return (rows[start : start + _BLOCK] for start in range(0, len(rows), _BLOCK))


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
