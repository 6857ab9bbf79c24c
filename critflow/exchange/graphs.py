"""networkx graphs and their attributes, GraphML and GML."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from critflow.exchange.data import Array, NetworkData, numbers, unread
from critflow.exchange.packages import optional
from critflow.result import InputError

_POSITIONS = ("pos", "position", "positions", "coordinates", "xyz", "coords")
_AXES = ("x", "y", "z")
_EDGE_VALUES = {
    "stiffness": ("stiffness", "k"),
    "rest_lengths": ("rest_length", "l0"),
    "force_densities": ("force_density", "sigma", "q"),
}


# Attributes of edges that are read, and the number that GraphML and GML give each edge.
_READ = {*(name for names in _EDGE_VALUES.values() for name in names), "offset", "bond_vector", "tail", "index", "id"}


def from_graph(graph: Any, positions: Mapping[Any, Any] | None = None) -> NetworkData:
    """A networkx graph or multigraph with positions as a node attribute (`pos`, or x, y, z) or in a mapping.

    An edge attribute `offset` or `bond_vector` points from `tail` to the other end, where the edge has an attribute
    `tail`, and from its first end otherwise; edges with an attribute `index` are sorted by it.  Graph attribute `cell`,
    node attribute `fixed`.
    """
    nodes = list(graph.nodes)
    index = {node: n for n, node in enumerate(nodes)}
    if not nodes or not graph.number_of_edges():
        raise InputError("the graph has no edges: give one with nodes and edges")
    places = [_position(graph, node, positions) for node in nodes]
    if len({np.shape(place) for place in places}) > 1:
        raise InputError("the positions of the nodes have different numbers of coordinates: give each the same")
    x = numbers(places, "positions of nodes")
    rows = sorted(graph.edges(data=True), key=lambda row: int(row[2].get("index", 0)))
    turned = [str(data.get("tail", a)) != str(a) for a, _, data in rows]
    edges = np.array(
        [[index[b], index[a]] if flip else [index[a], index[b]] for (a, b, _), flip in zip(rows, turned, strict=True)]
    )
    found = [data for _, _, data in rows]
    values = {name: _edge_values(found, names) for name, names in _EDGE_VALUES.items()}
    cell = graph.graph.get("cell")
    offsets, bonds = (_edge_vectors(found, name) for name in ("offset", "bond_vector"))
    return NetworkData(
        edges=edges,
        positions=x,
        cell=None if cell is None else np.array(_parsed(cell), dtype=float),
        offsets=None if offsets is None else np.round(offsets).astype(np.int64),
        bond_vectors=bonds,
        pins=tuple(n for n, node in enumerate(nodes) if _true(graph.nodes[node].get("fixed", False))),
        ids=tuple(map(str, nodes)),
        source="graph",
        notes=unread((name for row in found for name in row), _READ),
        stiffness=values["stiffness"],
        rest_lengths=values["rest_lengths"],
        force_densities=values["force_densities"],
    )


def node_attributes(data: NetworkData) -> Iterator[dict[str, Any]]:
    """Attributes of each vertex: pos, fixed."""
    fixed = set(data.pins)
    for n, x in enumerate(data.positions.tolist()):
        yield {"pos": tuple(x), "fixed": n in fixed}


def edge_attributes(data: NetworkData) -> Iterator[dict[str, Any]]:
    """Attributes of each edge: index and tail, since undirected graphs keep neither; offset, stiffness and so on."""
    values = {names[0]: getattr(data, name) for name, names in _EDGE_VALUES.items()}
    columns = {name: column.tolist() for name, column in values.items() if column is not None}
    offsets = None if data.offsets is None else data.offsets.tolist()
    for n, tail in enumerate(data.edges[:, 0].tolist()):
        attributes: dict[str, Any] = {"index": n, "tail": tail}
        if offsets is not None:
            attributes["offset"] = tuple(offsets[n])
        yield attributes | {name: column[n] for name, column in columns.items()}


def to_graph(data: NetworkData) -> Any:
    """A networkx multigraph with attributes pos, fixed; tail, offset, stiffness and so on; cell."""
    networkx = optional("networkx")
    graph = networkx.MultiGraph()
    if data.cell is not None:
        graph.graph["cell"] = data.cell.tolist()
    for n, attributes in enumerate(node_attributes(data)):
        graph.add_node(n, **attributes)
    for (tail, head), attributes in zip(data.edges.tolist(), edge_attributes(data), strict=True):
        graph.add_edge(tail, head, **attributes)
    return graph


def read_graph(path: Path) -> NetworkData:
    """GraphML or GML."""
    networkx = optional("networkx")
    try:
        if path.suffix.lower() == ".gml":
            graph = networkx.read_gml(path, label="id")
        else:
            graph = networkx.read_graphml(path)
    except (networkx.NetworkXException, ValueError, KeyError, SyntaxError) as error:
        raise InputError(f"{path} cannot be read as a graph: {error}") from None
    return replace(from_graph(graph), source=f"graph {path.name}")


def write_graph(data: NetworkData, path: Path) -> None:
    """GraphML or GML, with vectors as JSON text: they know numbers and text only."""
    networkx = optional("networkx")
    graph = to_graph(data)
    for attributes in (
        graph.graph,
        *(a for _, a in graph.nodes(data=True)),
        *(a for _, _, a in graph.edges(data=True)),
    ):
        for name, value in list(attributes.items()):
            if isinstance(value, list | tuple):
                attributes[name] = json.dumps(value)
            elif isinstance(value, bool):
                attributes[name] = int(value)
    if path.suffix.lower() == ".gml":
        networkx.write_gml(graph, path, stringizer=str)
    else:
        networkx.write_graphml(graph, path)


def _position(graph: Any, node: Any, positions: Mapping[Any, Any] | None) -> Any:
    if positions is not None:
        if node not in positions:
            raise InputError(f"no position is given for node {node!r}: complete the mapping")
        return positions[node]
    attributes = graph.nodes[node]
    for name in _POSITIONS:
        if name in attributes:
            return _parsed(attributes[name])
    axes = [float(attributes[axis]) for axis in _AXES if axis in attributes]
    if len(axes) >= 2:
        return axes
    raise InputError(f"node {node!r} has no position: give an attribute pos, or x and y, or positions={{node: ...}}")


def _edge_values(rows: list[Mapping[str, Any]], names: tuple[str, ...]) -> Array | None:
    name = next((name for name in names if all(name in row for row in rows)), None)
    return None if name is None else numbers([row[name] for row in rows], f"the edge attribute {name}")


def _edge_vectors(rows: list[Mapping[str, Any]], name: str) -> Array | None:
    if not all(name in row for row in rows):
        return None
    return np.array([_parsed(row[name]) for row in rows], dtype=float)


def _parsed(value: Any) -> Any:
    """A vector, also as text such as "(1.0, 2.0)"."""
    if not isinstance(value, str):
        return value
    try:
        return json.loads(value.replace("(", "[").replace(")", "]"))
    except ValueError:
        raise InputError(f"{value!r:.40} is no vector: write it as [1.0, 2.0]") from None


def _true(value: Any) -> bool:
    return value in (True, 1, "1", "true", "True")
