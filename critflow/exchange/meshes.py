"""Meshes: lines and polygons through meshio, and VTU files."""

from __future__ import annotations

import io
from contextlib import redirect_stderr
from pathlib import Path
from typing import Any

import numpy as np

from critflow.exchange.data import EDGE_VALUES, NetworkData, bond_vectors_of, edge_values, polygon_edges
from critflow.exchange.packages import optional
from critflow.result import EnvironmentFailure, InputError

_POLYGONS = ("triangle", "quad", "polygon")


def from_mesh(mesh: Any, source: str = "mesh") -> NetworkData:
    """A meshio mesh: its lines, or the sides of its polygons (cells of a tissue) where it has no lines."""
    lines = [np.asarray(block.data) for block in mesh.cells if block.type.startswith("line")]
    polygons = [p for block in mesh.cells if block.type.startswith(_POLYGONS) for p in map(list, block.data)]
    if lines:
        # Lines of three or more points are chains through all of them; the ends come first, then the inner points.
        lines = [np.column_stack([a[:, :1], a[:, 2:], a[:, 1:2]]) for a in lines]
        edges = np.concatenate([np.stack([a[:, :-1].ravel(), a[:, 1:].ravel()], axis=1) for a in lines])
    elif polygons:
        edges = polygon_edges(polygons)
    else:
        raise InputError(f"the {source} has neither lines nor polygons: export its edges as line cells")
    values: dict[str, Any] = {
        name: np.concatenate([np.ravel(a) for a in mesh.cell_data[written]])
        for name, (written, *_) in EDGE_VALUES.items()
        if lines and len(lines) == len(mesh.cells) and written in mesh.cell_data
    }
    fixed = mesh.point_data.get("fixed")
    d = mesh.points.shape[1]
    offsets = None
    if lines and all(f"offset_{axis}" in mesh.cell_data for axis in "xyz"[:d]):
        columns = [np.concatenate(mesh.cell_data[f"offset_{axis}"]) for axis in "xyz"[:d]]
        offsets = np.stack(columns, axis=1).astype(np.int64)
    cell = mesh.field_data.get("cell") if hasattr(mesh, "field_data") else None
    if cell is None and "cell_vectors" in mesh.point_data:
        cell = np.asarray(mesh.point_data["cell_vectors"])[:1].reshape(3, 3)
    return NetworkData(
        edges=edges.astype(np.int64),
        positions=np.asarray(mesh.points, dtype=float),
        cell=None if cell is None else np.asarray(cell, dtype=float).reshape(d, d),
        offsets=offsets,
        pins=() if fixed is None else tuple(np.flatnonzero(fixed).tolist()),
        source=source,
        **values,
    )


def read_mesh(path: Path) -> NetworkData:
    """Any file of meshio with line cells or polygons."""
    meshio = optional("meshio")
    try:
        # meshio prints its reasons before it ends the program.
        with redirect_stderr(io.StringIO()) as reasons:
            mesh = meshio.read(path)
    except SystemExit:
        reason = " ".join(reasons.getvalue().split()).removeprefix("Error: ")
        raise InputError(f"{path} cannot be read as a mesh: {reason or 'its content is broken'}") from None
    except ModuleNotFoundError as missing:
        raise EnvironmentFailure(
            f"{path.suffix} files need the package {missing.name}, which is not installed: pip install {missing.name}"
        ) from None
    return from_mesh(mesh, f"mesh {path.name}")


def write_mesh(data: NetworkData, path: Path) -> None:
    """A mesh of lines (VTU or VTK) with stiffness, offsets and fixed vertices as data.

    Points are three-dimensional; offsets and the cell of a periodic network are data of lines and points.
    """
    meshio = optional("meshio")
    d = data.dimension
    points = np.zeros((data.n_vertices, 3))
    points[:, :d] = data.positions
    fixed = data.is_pin.astype(np.int64)
    cell_data = {"length": [np.linalg.norm(bond_vectors_of(data), axis=1)]}
    cell_data |= {name: [np.asarray(values)] for name, values in edge_values(data).items()}
    point_data = {"fixed": fixed}
    if data.cell is not None and data.offsets is not None:
        offsets = np.zeros((data.n_edges, 3), np.int64)
        offsets[:, :d] = data.offsets
        cell_data |= {f"offset_{axis}": [offsets[:, k].copy()] for k, axis in enumerate("xyz")}
        cell = np.zeros((3, 3))
        cell[:d, :d] = data.cell
        if d == 2:
            cell[2, 2] = float(np.linalg.norm(data.cell, axis=1).max())
        point_data["cell_vectors"] = np.tile(cell.ravel(), (data.n_vertices, 1))
    mesh = meshio.Mesh(points, [("line", data.edges)], point_data=point_data, cell_data=cell_data)
    mesh.write(path)


def from_polygons(points: Any, polygons: Any) -> NetworkData:
    """Cells of a tissue: points (N_v, 2) and the vertices of each cell in order."""
    try:
        cells = tuple(tuple(int(i) for i in p) for p in polygons)
    except (TypeError, ValueError):
        raise InputError("polygons must be lists of vertices: give the vertices of each cell in order") from None
    few = [n for n, cell in enumerate(cells) if len(cell) < 3]
    if few:
        raise InputError(f"polygon {few[0]} has fewer than three vertices: correct it")
    return NetworkData(edges=polygon_edges(cells), positions=np.asarray(points, dtype=float), source="polygons")
