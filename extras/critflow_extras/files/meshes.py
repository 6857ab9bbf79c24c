"""Meshes through meshio: lines, polygons and cells in space."""

from __future__ import annotations

import io
from collections.abc import Sequence
from contextlib import redirect_stderr, redirect_stdout
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from critflow.checks import components
from critflow.result import EnvironmentFailure, InputError
from critflow_extras.files.data import (
    EDGE_VALUES,
    IntArray,
    NetworkData,
    bond_vectors_of,
    edge_values,
    optional,
    polygon_edges,
)

# Ends of curves within this part of the size of the drawing are one vertex: single precision has 1e-7.
_ROUNDING = 1e-6
# Corners of the sides of each kind of cell; those of higher order begin with the same corners.
_TRIANGLE, _QUAD = ((0, 1), (1, 2), (2, 0)), ((0, 1), (1, 2), (2, 3), (3, 0))
_PLANE = {"triangle": 3, "quad": 4}
_SPACE = {
    "tetra": (*_TRIANGLE, (0, 3), (1, 3), (2, 3)),
    "pyramid": (*_QUAD, (0, 4), (1, 4), (2, 4), (3, 4)),
    "wedge": (*_TRIANGLE, (3, 4), (4, 5), (5, 3), (0, 3), (1, 4), (2, 5)),
    "hexahedron": (*_QUAD, (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7)),
}


def from_mesh(mesh: Any, source: str = "mesh") -> NetworkData:
    """A meshio mesh: its lines, or the sides of its cells where it has no lines, or only lines along these sides."""
    # Lines of three or more points have their ends first, then the inner points.
    blocks = [np.asarray(block.data) for block in mesh.cells if block.type.startswith("line")]
    chains = [np.column_stack([a[:, :1], a[:, 2:], a[:, 1:2]]) for a in blocks]
    pairs = [a[:, [k, k + 1]] for a in chains for k in range(a.shape[1] - 1)]
    lines, (edges, sides) = np.concatenate([np.zeros((0, 2), int), *pairs]), _cell_sides(mesh)
    if not len(lines) and not len(edges):
        raise InputError(f"the {source} has neither lines nor cells: export its edges as line cells")
    data: dict[str, Any] = {}
    if len(lines) and not set(map(tuple, np.sort(lines).tolist())) <= set(map(tuple, edges.tolist())):
        edges, sides = lines, None
        if all(block.type.startswith("line") for block in mesh.cells):
            data = {name: np.concatenate(values) for name, values in mesh.cell_data.items()}
    fixed, volume = mesh.point_data.get("fixed"), mesh.point_data.get("volume")
    d = mesh.points.shape[1]
    offsets = [data[name] for name in (f"offset_{axis}" for axis in "xyz"[:d]) if name in data]
    values: dict[str, Any] = {name: data.get(written) for name, (written, *_) in EDGE_VALUES.items()}
    cell = mesh.point_data.get("cell_vectors")
    return NetworkData(
        edges=edges,
        positions=mesh.points,
        cell=None if cell is None else np.reshape(cell[0], (3, 3)),
        offsets=np.stack(offsets, axis=1) if len(offsets) == d else None,
        pins=() if fixed is None else tuple(np.flatnonzero(fixed).tolist()),
        sides=sides,
        volume=None if volume is None else float(volume[0]),
        source=source,
        **values,
    )


def _cell_sides(mesh: Any) -> tuple[IntArray, IntArray | None]:
    """Sides (n, 2) of all cells, each once, and the polygons on both sides of each in a mesh of polygons."""
    polygons, pairs = list[Sequence[int]](), [np.zeros((0, 2), int)]
    for block in mesh.cells:
        kind = block.type.rstrip("0123456789")
        if kind in _SPACE:
            pairs.append(np.asarray(block.data)[:, _SPACE[kind]].reshape(-1, 2))
        elif kind in _PLANE or kind == "polygon":
            polygons += [list(map(int, corners[: _PLANE.get(kind)])) for corners in block.data]
    edges, sides = polygon_edges(polygons)
    if len(pairs) == 1:
        return edges, sides
    return np.unique(np.sort(np.concatenate([edges, *pairs])), axis=0), None


def read_mesh(path: Path) -> NetworkData:
    """Any file of meshio."""
    meshio = optional("meshio")
    try:
        # meshio prints its reasons before it ends the program.
        with redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()) as reasons:
            mesh = meshio.read(path)
    except SystemExit:
        reason = " ".join(reasons.getvalue().split()).removeprefix("Error: ")
        raise InputError(f"{path} cannot be read as a mesh: {reason or 'its content is broken'}") from None
    except ModuleNotFoundError as missing:
        raise EnvironmentFailure(f"{path.suffix} files need {missing.name}: pip install {missing.name}") from None
    if path.suffix.lower() != ".obj":
        return from_mesh(mesh, f"mesh {path.name}")
    lines, curves = _obj_lines(path)
    points, note = mesh.points, []
    if curves:
        # Curves do not share the vertices at their ends.
        tolerance = _ROUNDING * float(np.ptp(points, axis=0).max())
        near = components(cKDTree(points).query_pairs(tolerance, output_type="ndarray").astype(np.int64), len(points))
        _, first, index = np.unique(near, return_index=True, return_inverse=True)
        note = [
            f"{curves:,} curves are lines, and {len(points):,} vertices that coincide were joined to {len(first):,}"
        ]
        points, lines = points[first], index[lines]
    cells = [*mesh.cells, ("line", lines)] if len(lines) else mesh.cells
    return from_mesh(meshio.Mesh(points, cells), f"mesh {path.name}").noting(*note)


def _obj_lines(path: Path) -> tuple[IntArray, int]:
    """The elements `l` of an OBJ file and its curves of degree 1 (n, 2), which meshio skips, and the number of curves.

    Chains of vertices from 1, or from the end by −1; a vertex may have a texture, 3/7.  Rhino writes lines as curves,
    with two parameters before the vertices.
    """
    n_vertices, curves, pairs = 0, 0, list[tuple[int, int]]()
    for line in path.read_text(encoding="utf-8").replace("\\\n", " ").splitlines():
        kind, *words = line.partition("#")[0].split() or [""]
        n_vertices += kind == "v"
        curves += kind == "curv"
        if kind == "deg" and words != ["1"]:
            raise InputError(f"its curves of degree {' '.join(words):.20} are no lines: export polylines")
        if kind in ("l", "curv"):
            numbers = [int(word.partition("/")[0]) for word in words[2 * (kind == "curv") :]]
            chain = [n - 1 if n > 0 else n_vertices + n for n in numbers]
            pairs += pairwise(chain)
    return np.array(pairs, np.int64).reshape(-1, 2), curves


def write_mesh(data: NetworkData, path: Path) -> None:
    """A mesh of lines (VTU or VTK) with stiffness, offsets and fixed vertices as data.

    Points are three-dimensional; offsets and the cell of a periodic network are data of lines and points.
    """
    meshio = optional("meshio")
    d = data.dimension
    points = np.zeros((data.n_vertices, 3))
    points[:, :d] = data.positions
    cell_data = {"length": [np.linalg.norm(bond_vectors_of(data), axis=1)]}
    cell_data |= {name: [np.asarray(values)] for name, values in edge_values(data).items()}
    point_data: dict[str, Any] = {"fixed": data.is_pin.astype(np.int64)}
    if data.cell is not None and data.offsets is not None:
        offsets = np.zeros((data.n_edges, 3), np.int64)
        offsets[:, :d] = data.offsets
        cell_data |= {f"offset_{axis}": [offsets[:, k].copy()] for k, axis in enumerate("xyz")}
        cell = np.zeros((3, 3))
        cell[:d, :d] = data.cell
        if d == 2:
            cell[2, 2] = float(np.linalg.norm(data.cell, axis=1).max())
        point_data["cell_vectors"] = np.tile(cell.ravel(), (data.n_vertices, 1))
    if data.volume is not None:
        point_data["volume"] = np.full(data.n_vertices, data.volume)
    mesh = meshio.Mesh(points, [("line", data.edges)], point_data=point_data, cell_data=cell_data)
    mesh.write(path)
