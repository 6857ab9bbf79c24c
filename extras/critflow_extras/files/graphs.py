"""networkx graphs and their attributes, and their files: GraphML, GML and JSON in node-link form."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from critflow.arguments import floats
from critflow.network_files import graph_of
from critflow.result import InputError
from critflow_extras.files.compas import body_of, from_compas
from critflow_extras.files.data import EDGE_VALUES, Array, NetworkData, optional, unread
from critflow_extras.files.tables import frames

_POSITIONS = ("pos", "position", "positions", "coordinates", "xyz", "coords")
_AXES = ("x", "y", "z")
_YES = (True, "1", "true", "True")
# Attributes of edges that are read, and the number that GraphML and GML give each edge.
_READ = {*(name for names in EDGE_VALUES.values() for name in names), "offset", "bond_vector", "tail", "index", "id"}


def from_graph(graph: Any, positions: Any = None) -> NetworkData:
    """A networkx graph or multigraph with positions as a node attribute (`pos`, or x, y, z), in a mapping, or in rows.

    An edge attribute `offset` or `bond_vector` points from `tail` to the other end, where the edge has an attribute
    `tail`, and from its first end otherwise; edges with an attribute `index` are sorted by it.  Graph attributes
    `cell` and `volume`, node attribute `fixed`.
    """
    nodes = list(graph.nodes)
    index = {node: n for n, node in enumerate(nodes)}
    if not nodes or not graph.number_of_edges():
        raise InputError("the graph has no edges: give one with nodes and edges")
    if positions is not None and not isinstance(positions, Mapping):
        if len(positions) != len(nodes):
            raise InputError(f"positions must have one row for each of the {len(nodes)} nodes")
        positions = dict(zip(nodes, positions, strict=True))
    places = [_position(graph, node, positions) for node in nodes]
    if len({np.shape(place) for place in places}) > 1:
        raise InputError("the positions of the nodes have different numbers of coordinates: give each the same")
    x = floats(places, "positions of nodes")
    rows = sorted(graph.edges(data=True), key=lambda row: int(row[2].get("index", 0)))
    turned = [str(data.get("tail", a)) != str(a) for a, _, data in rows]
    edges = np.array(
        [[index[b], index[a]] if flip else [index[a], index[b]] for (a, b, _), flip in zip(rows, turned, strict=True)]
    )
    attributes = [data for _, _, data in rows]
    values: dict[str, Any] = {name: _column(attributes, names) for name, names in EDGE_VALUES.items()}
    cell, volume = graph.graph.get("cell"), graph.graph.get("volume")
    offsets = _column(attributes, ("offset",))
    return NetworkData(
        edges=edges,
        positions=x,
        cell=None if cell is None else floats(_parsed(cell), "the cell"),
        offsets=offsets,  # type: ignore[arg-type]
        volume=None if volume is None else float(_parsed(volume)),
        bond_vectors=_column(attributes, ("bond_vector",)),
        pins=tuple(n for n, node in enumerate(nodes) if graph.nodes[node].get("fixed") in _YES),
        ids=tuple(map(str, nodes)),
        source="graph",
        notes=unread((name for row in attributes for name in row), _READ),
        **values,
    )


def read_graph(path: Path) -> NetworkData:
    """GraphML, GML, or JSON: of COMPAS, or in node-link or adjacency form."""
    ending = path.suffix.lower()
    if ending == ".json":
        content = json.loads(path.read_text(encoding="utf-8"))
        if (body := body_of(content)) is not None:
            return replace(from_compas(body), source=f"COMPAS {path.name}")
        graph = _from_json(content)
    else:
        networkx = optional("networkx")
        graph = networkx.read_gml(path, label="id") if ending == ".gml" else networkx.read_graphml(path)
    return replace(from_graph(graph), source=f"graph {path.name}")


def _from_json(content: Any) -> Any:
    """The graph of networkx.node_link_data, with its edges under `edges` or `links`, or of networkx.adjacency_data."""
    networkx = optional("networkx")
    if isinstance(content, dict) and "adjacency" in content:
        return networkx.adjacency_graph(content)
    content = content if isinstance(content, dict) else {}
    if str(content.get("type", "")).startswith(("Feature", "Geometry", "Polygon", "MultiPolygon")):
        raise InputError("this JSON is GeoJSON: give it the ending .geojson")
    nodes, edges = content.get("nodes", ()), content.get("edges", content.get("links", ()))
    objects = bool(nodes) and all(isinstance(row, dict) for row in (*nodes, *edges))
    if not objects or not all({"source", "target"} <= {*edge} for edge in edges):
        raise ValueError('it needs nodes such as {"id": 0, "pos": [0, 0]} and edges such as {"source": 0, "target": 1}')
    for number, edge in enumerate(edges):
        edge.setdefault("index", number)
        edge.pop("key", None)
    # As a directed graph it keeps the direction of edges without a tail.
    content = {**content, "edges": edges, "directed": True, "multigraph": True}
    graph = networkx.node_link_graph(content, edges="edges")
    if len({*map(str, graph)}) != len(nodes):
        raise ValueError("the ids of its nodes must differ, and its edges must end at nodes that it has: correct them")
    return graph


def write_graph(data: NetworkData, path: Path) -> None:
    """GraphML, GML or JSON of a multigraph: nodes with pos and fixed; edges with stiffness and so on; the cell.

    Undirected graphs keep neither the order nor the direction of edges: these have an attribute index and one tail.
    GraphML and GML know numbers and text only, and have vectors as JSON text.
    """
    networkx, graph = optional("networkx"), graph_of(*frames(data))
    if path.suffix.lower() == ".json":
        path.write_text(json.dumps(networkx.node_link_data(graph, edges="edges")), encoding="utf-8")
        return
    owners = (graph.graph, *dict(graph.nodes(data=True)).values(), *(row[2] for row in graph.edges(data=True)))
    for attributes in owners:
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
    axes = [_parsed(attributes[axis]) for axis in _AXES if axis in attributes]
    if len(axes) >= 2:
        return axes
    raise InputError(f"node {node!r} has no position: give an attribute pos, or x and y, or positions={{node: ...}}")


def _column(rows: list[Mapping[str, Any]], names: tuple[str, ...]) -> Array | None:
    """The first of these attributes that all edges have."""
    name = next((name for name in names if all(name in row for row in rows)), None)
    return None if name is None else floats([_parsed(row[name]) for row in rows], f"the edge attribute {name}")


def _parsed(value: Any) -> Any:
    """A vector, also as text such as "(1.0, 2.0)"."""
    if not isinstance(value, str):
        return value
    try:
        return json.loads(value.replace("(", "[").replace(")", "]"))
    except ValueError:
        raise InputError(f"{value!r:.40} is neither a number nor a vector such as [1.0, 2.0]: correct it") from None
