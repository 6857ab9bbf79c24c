"""Meshes: lines and polygons through meshio, VTU files, and COMPAS graphs with force densities and supports."""

from __future__ import annotations

import io
from contextlib import redirect_stderr
from pathlib import Path
from typing import Any

import numpy as np

from critflow.exchange.data import NetworkData, bond_vectors_of, polygon_edges
from critflow.exchange.packages import optional
from critflow.result import EnvironmentFailure, InputError

_EDGE_VALUES = (
    ("stiffness", "stiffness"),
    ("rest_lengths", "rest_length"),
    ("force_densities", "force_density"),
)
_SUPPORTS = ("is_support", "is_anchor", "is_fixed")
_POLYGONS = ("triangle", "quad", "polygon")


def from_mesh(mesh: Any, source: str = "mesh") -> NetworkData:
    """A meshio mesh: its lines, or the sides of its polygons (cells of a tissue) where it has no lines."""
    lines = [np.asarray(block.data) for block in mesh.cells if block.type.startswith("line")]
    polygons = [p for block in mesh.cells if block.type.startswith(_POLYGONS) for p in map(list, block.data)]
    if lines:
        # Lines of three or more points are chains through all of them; the ends come first, then the inner points.
        lines = [np.column_stack([a[:, :1], a[:, 2:], a[:, 1:2]]) for a in lines]
        edges = np.concatenate([np.stack([a[:, :-1].ravel(), a[:, 1:].ravel()], axis=1) for a in lines])
        chosen: tuple[tuple[int, ...], ...] = ()
    elif polygons:
        edges, chosen = polygon_edges(polygons), tuple(tuple(map(int, p)) for p in polygons)
    else:
        raise InputError(f"the {source} has neither lines nor polygons: export its edges as line cells")
    values = {
        name: np.concatenate([np.ravel(a) for a in mesh.cell_data[key]])
        for name, key in (
            ("stiffness", "stiffness"),
            ("rest_lengths", "rest_length"),
            ("force_densities", "force_density"),
        )
        if lines and len(lines) == len(mesh.cells) and key in mesh.cell_data
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
        polygons=chosen,
        source=source,
        stiffness=values.get("stiffness"),
        rest_lengths=values.get("rest_lengths"),
        force_densities=values.get("force_densities"),
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
    except (meshio.ReadError, OSError, ValueError, KeyError) as error:
        raise InputError(f"{path} cannot be read as a mesh: {error}") from None
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
    fixed = np.zeros(data.n_vertices, np.int64)
    fixed[list(data.pins)] = 1
    cell_data = {"length": [np.linalg.norm(bond_vectors_of(data), axis=1)]}
    named = (("stiffness", data.stiffness), ("rest_length", data.rest_lengths), ("force_density", data.force_densities))
    cell_data |= {name: [np.asarray(values)] for name, values in named if values is not None}
    point_data = {"fixed": fixed}
    if data.cell is not None and data.offsets is not None:
        offsets = np.zeros((data.n_edges, 3), np.int64)
        offsets[:, :d] = data.offsets
        cell_data |= {f"offset_{axis}": [offsets[:, k].copy()] for k, axis in enumerate("xyz")}
        cell = np.diag([0.0, 0.0, 0.0])
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
    return NetworkData(
        edges=polygon_edges(cells), positions=np.asarray(points, dtype=float), polygons=cells, source="polygons"
    )


def from_compas(graph: Any) -> NetworkData:
    """A COMPAS graph or network: attributes x, y, z; q (force density) of edges; is_support (or is_anchor) of nodes."""
    nodes = list(graph.nodes())
    index = {node: n for n, node in enumerate(nodes)}
    pairs = sorted(graph.edges(), key=lambda pair: graph.edge_attribute(pair, "index") or 0)
    turned = [graph.edge_attribute(pair, "tail") == pair[1] for pair in pairs]
    edges = [(index[b], index[a]) if flip else (index[a], index[b]) for (a, b), flip in zip(pairs, turned, strict=True)]
    positions = np.array([graph.node_attributes(node, "xyz") for node in nodes], dtype=float)
    supports = [
        n
        for n, node in enumerate(nodes)
        for name in ("is_support", "is_anchor", "is_fixed")
        if graph.node_attribute(node, name)
    ]
    q = [graph.edge_attribute(edge, "q") for edge in pairs]
    known = all(isinstance(value, int | float) for value in q)
    return NetworkData(
        edges=np.array(edges, dtype=np.int64).reshape(-1, 2),
        positions=positions,
        pins=tuple(sorted(set(supports))),
        force_densities=np.array(q, dtype=float) if known and q else None,
        ids=tuple(map(str, nodes)),
        source="COMPAS graph",
    )


def read_compas(path: Path) -> NetworkData:
    """A COMPAS JSON file of a graph."""
    datastructures = optional("compas.datastructures")
    try:
        graph = datastructures.Graph.from_json(str(path))
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise InputError(f"{path} cannot be read as a COMPAS graph: {error}") from None
    return from_compas(graph)


def require_no_cell(data: NetworkData) -> None:
    """Raise `InputError` for a periodic network."""
    if data.cell is not None:
        raise InputError("COMPAS has no periodic cell: fix vertices, or write another format")


def write_compas(data: NetworkData, path: Path) -> None:
    """A COMPAS graph as JSON with q and is_support; periodic networks have no such form."""
    require_no_cell(data)
    graph = optional("compas.datastructures").Graph()
    fixed = set(data.pins)
    for n, x in enumerate(data.positions):
        x3 = [*map(float, x), 0.0][:3]
        graph.add_node(n, x=x3[0], y=x3[1], z=x3[2], is_support=n in fixed)
    for n, (i, j) in enumerate(data.edges.tolist()):
        attributes = {} if data.force_densities is None else {"q": float(data.force_densities[n])}
        graph.add_edge(i, j, index=n, tail=i, **attributes)
    graph.to_json(str(path))
