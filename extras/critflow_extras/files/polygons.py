"""Cells of a tissue as polygons: corners that cells share, or outlines with corners of their own, as in GeoJSON.

Outlines are welded: corners within a distance of each other become one vertex, at their mean.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from critflow.arguments import finite_rows, floats, is_number
from critflow.checks import components
from critflow.result import InputError
from critflow_extras.files.data import Array, NetworkData, counted, polygon_edges, vertices_on_edges

# Corners of different polygons within this part of the size of all of them are one that was written twice: single
# precision has 1e-7.
_ROUNDING = 1e-6
# Of the distance of corners of different polygons, that in the advice.
_WIDER = 1.5


def from_polygons(positions: Any, polygons: Any, weld: Any = None) -> NetworkData:
    """Cells of a tissue: positions (N_v, 2) of corners, and the corners of each cell in order.

    weld  distance within which corners are one; None: rounding, and only where no two polygons share a side
    """
    try:
        cells = [tuple(int(i) for i in p) for p in polygons]
    except (TypeError, ValueError):
        raise InputError("polygons must be lists of vertices: give the vertices of each cell in order") from None
    few = [n for n, cell in enumerate(cells) if len(cell) < 3]
    if few:
        raise InputError(f"polygon {few[0]} has fewer than three vertices: correct it")
    if not cells:
        raise InputError("there are no polygons: give the vertices of each cell in order")
    x, names, notes = floats(positions, "positions"), tuple[str, ...](), tuple[str, ...]()
    corners = np.concatenate([np.array(cell) for cell in cells])
    if x.ndim == 2 and corners.min() >= 0 and corners.max() < len(x):
        finite_rows(x, "positions", x.shape)
        tolerance = _tolerance(x, cells, weld)
        if tolerance:
            x, cells, names, notes = _welded(x, cells, tolerance)
            cells, joined = _with_junctions(x, cells, tolerance)
            notes += joined
        notes = (*notes, *_apart(x, cells))
    edges, sides = polygon_edges(cells)
    read = NetworkData(edges=edges, positions=x, sides=sides, ids=names, source="polygons")
    return read.noting(*notes)


def from_outlines(outlines: Any, weld: Any = None) -> NetworkData:
    """Cells with corners of their own: arrays (n, 2) of points in order, GeoJSON, objects of shapely or geopandas."""
    outlines = getattr(outlines, "__geo_interface__", outlines)
    listed = [outlines] if isinstance(outlines, Mapping) else list(outlines)
    rings, other = list[Array](), dict[str, int]()
    for outline in listed:
        outline = getattr(outline, "__geo_interface__", outline)
        if isinstance(outline, Mapping):
            _collect(outline, rings, other)
        elif len(outline) and all(map(is_number, outline)):
            raise InputError("polygons= of numbers of vertices needs positions=, one row for each vertex")
        else:
            rings.append(_ring(outline, len(rings)))
    if not rings:
        raise InputError(f"there are no polygons{f', only {_kinds(other)}' if other else ''}: give outlines of cells")
    starts = np.cumsum([0, *map(len, rings)])
    cells = [range(first, last) for first, last in pairwise(starts.tolist())]
    read = from_polygons(np.concatenate(rings), cells, weld)
    return read.noting(f"{_kinds(other)} of the source, which are no polygons, were not read") if other else read


def read_geojson(path: Path, weld: Any = None) -> NetworkData:
    """Polygons of a GeoJSON file."""
    content = json.loads(path.read_text(encoding="utf-8"))
    if not isinstance(content, Mapping):
        raise InputError("GeoJSON is one object with a type, such as FeatureCollection: write it so")
    return from_outlines(content, weld)


def _collect(geometry: Mapping[str, Any], rings: list[Array], other: dict[str, int]) -> None:
    """Append the polygons of a GeoJSON object, and count what is no polygon by its type."""
    kind = geometry.get("type")
    members = geometry.get(
        "features", geometry.get("geometries", [geometry["geometry"]] if kind == "Feature" else None)
    )
    if members is not None:
        for member in members:
            _collect(member or {}, rings, other)
    elif kind in ("Polygon", "MultiPolygon"):
        parts = geometry["coordinates"] if kind == "MultiPolygon" else [geometry["coordinates"]]
        for outer, *holes in parts:
            if holes:
                raise InputError(
                    f"polygon {len(rings)} has a hole, which no cell of a tissue has: fill it, or make it a polygon"
                )
            rings.append(_ring(outer, len(rings)))
    else:
        other[str(kind)] = other.get(str(kind), 0) + 1


def _kinds(other: Mapping[str, int]) -> str:
    return ", ".join(f"{number} of type {kind}" for kind, number in other.items())


def _ring(outline: Any, number: int) -> Array:
    """Corners (n, 2) of an outline, whose last one may repeat the first; heights are left out."""
    corners = floats(outline, f"polygon {number}")
    if corners.ndim != 2 or corners.shape[1] not in (2, 3):
        raise InputError(f"polygon {number} must be points (n, 2) in order, not of the shape {corners.shape}")
    corners = corners[:, :2]
    return corners[:-1] if (corners[0] == corners[-1]).all() else corners


def _tolerance(x: Array, cells: Sequence[Sequence[int]], weld: Any) -> float:
    """The distance within which corners are one; 0: as the polygons name them."""
    if weld is not None:
        if not is_number(weld) or not 0 <= weld < np.inf:
            raise InputError(f"weld must be zero or a distance, not {weld!r:.40}")
        return float(weld)
    shared = (polygon_edges(cells)[1][:, 1] >= 0).any()
    return 0.0 if shared or len(cells) == 1 else _ROUNDING * float(np.ptp(x, axis=0).max())


def _welded(
    x: Array, cells: Sequence[Sequence[int]], tolerance: float
) -> tuple[Array, list[tuple[int, ...]], tuple[str, ...], tuple[str, ...]]:
    """Positions and polygons of the welded corners, the number of the first corner of each, and a sentence."""
    near = components(cKDTree(x).query_pairs(tolerance, output_type="ndarray").astype(np.int64), len(x))
    _, first, index = np.unique(near, return_index=True, return_inverse=True)
    if len(first) == len(x):
        return x, list(map(tuple, cells)), (), ()
    at = np.column_stack([np.bincount(index, axis) for axis in x.T]) / np.bincount(index)[:, None]
    joined = []
    for number, cell in enumerate(cells):
        corners = index[list(cell)]
        left = tuple(corners[corners != np.roll(corners, 1)].tolist())
        if len(left) < 3 or len({*left}) < len(left):
            raise InputError(
                f"weld={tolerance:.3g} joins corners across polygon {number}, or it has a corner twice: give a smaller "
                "distance, or correct it"
            )
        joined.append(left)
    moved = float(np.linalg.norm(x - at[index], axis=1).max())
    welded = f"{len(x):,} corners were welded to {len(first):,} within weld={tolerance:.3g}"
    note = f"{welded}; the farthest moved by {moved:.2g}"
    return at, joined, tuple(map(str, first.tolist())), (note,)


def _with_junctions(
    x: Array, cells: Sequence[tuple[int, ...]], tolerance: float
) -> tuple[list[tuple[int, ...]], tuple[str, ...]]:
    """Polygons that have the corners of others on their sides as corners too, and a sentence."""
    edges = polygon_edges(cells)[0]
    inner = dict[tuple[int, int], list[int]]()
    for edge, vertex in vertices_on_edges(x, edges, tolerance).tolist():
        a, b = edges[edge].tolist()
        inner.setdefault((a, b), []).append(vertex)
        inner.setdefault((b, a), []).insert(0, vertex)
    if not inner:
        return list(cells), ()
    joined = []
    for number, cell in enumerate(cells):
        corners = [v for a, b in zip(cell, (*cell[1:], cell[0]), strict=True) for v in (a, *inner.get((a, b), ()))]
        if len({*corners}) < len(corners):
            raise InputError(f"weld={tolerance:.3g} joins corners across polygon {number}: give a smaller distance")
        joined.append(tuple(corners))
    n = len({vertex for between in inner.values() for vertex in between})
    return joined, (f"{counted(n, 'corner', 'is')} on sides of other polygons, which have them as corners too",)


def _apart(x: Array, cells: Sequence[Sequence[int]]) -> tuple[str, ...]:
    """A sentence on polygons that share no side with another, and how far their corners are from other ones."""
    sides = polygon_edges(cells)[1]
    alone = np.setdiff1d(np.arange(len(cells)), sides[sides[:, 1] >= 0])
    if len(cells) == 1 or not len(alone):
        return ()
    owner = np.repeat(np.arange(len(cells)), [len(cell) for cell in cells])
    corners = np.concatenate([np.array(cell) for cell in cells])
    gaps = []
    for number in alone:
        own = owner == number
        gaps.append(cKDTree(x[corners[~own]]).query(x[corners[own]])[0])
    gap = float(np.median(np.concatenate(gaps)))
    return (
        f"{len(alone)} of {counted(len(cells), 'polygon')} share no side with another; their corners are {gap:.3g} "
        f"from those of others (median), and weld={_WIDER * gap:.2g} would join such corners",
    )
