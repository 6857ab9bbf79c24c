"""JSON of COMPAS 1 and 2: a network or graph, which has nodes and edges, or a mesh, which has vertices and faces."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

import numpy as np

from critflow.arguments import floats
from critflow.result import InputError
from critflow_extras.files.data import EDGE_VALUES, NetworkData, counted, polygon_edges, unread

_FIXED = ("is_anchor", "is_support", "is_fixed")
_IS_EDGE = ("is_edge", "_is_edge")
# Attributes of all nodes and all edges, in both versions.
_OF_NODES = ("default_node_attributes", "default_vertex_attributes", "dna", "dva")
_OF_EDGES = ("default_edge_attributes", "dea")
# Attributes of edges that are read, or follow from the others.
_KNOWN = {*(name for names in EDGE_VALUES.values() for name in names), *_IS_EDGE, "f", "l", "r", "force", "length"}


def body_of(content: Any) -> Any:
    """The data of a network, graph or mesh in COMPAS 1 and 2, with or without its type; None for other JSON."""
    if not isinstance(content, Mapping):
        return None
    body = content.get("data", content.get("value")) if "dtype" in content else content
    return body if isinstance(body, Mapping) and ("node" in body or "vertex" in body) else None


def from_compas(body: Mapping[str, Any]) -> NetworkData:
    """Nodes with x, y, z and, where they are fixed, is_anchor, is_support or is_fixed; edges with q, l0 and so on."""
    nodes = {str(name): row for name, row in body.get("node", body.get("vertex")).items()}
    of_nodes: dict[str, Any] = next((body[name] for name in _OF_NODES if name in body), {})
    of_edges: dict[str, Any] = next((body[name] for name in _OF_EDGES if name in body), {})
    rows = [{**of_nodes, **(row or {})} for row in nodes.values()]
    x = floats([[row.get("x"), row.get("y"), row.get("z", 0.0)] for row in rows], "x, y, z of nodes")
    number = {name: n for n, name in enumerate(nodes)}
    if "node" in body:
        given = {(str(a), str(b)): row for a, ends in body.get("edge", {}).items() for b, row in ends.items()}
        pairs, sides = [(number[a], number[b]) for a, b in given], None
    else:
        cells = [[number[str(corner)] for corner in corners] for corners in body.get("face", {}).values()]
        edges, sides = polygon_edges(cells) if cells else (np.zeros((0, 2), np.int64), None)
        pairs = list(map(tuple, edges.tolist()))
        # Keys such as "(0, 1)" or "0-1".
        given = {tuple(re.findall(r"[^\s(),'-]+", key)): row for key, row in body.get("edgedata", {}).items()}
    if not pairs:
        raise InputError("it has neither edges nor faces: write a graph, or a mesh with faces")
    names = list(nodes)
    own = [given.get((names[a], names[b]), given.get((names[b], names[a]))) or {} for a, b in pairs]
    attributes = [{**of_edges, **row} for row in own]
    is_edge = np.array([all(row.get(name, True) for name in _IS_EDGE) for row in attributes])
    loaded = sum(any(row.get(axis) for axis in ("px", "py", "pz")) for row in rows)
    load = f"loads of {counted(loaded, 'vertex')} (px, py, pz) were not read: loaded(...) takes them"
    values: dict[str, Any] = {}
    for name, written in EDGE_VALUES.items():
        column = next((key for key in written if all(key in row for row in attributes)), None)
        numbers = (
            None if column is None else floats([row[column] for row in attributes], f"the edge attribute {column}")
        )
        # Zero is what COMPAS writes for a value that nobody gave.
        values[name] = numbers if numbers is not None and numbers.any() else None
    return NetworkData(
        edges=np.array(pairs),
        positions=x,
        pins=tuple(n for n, row in enumerate(rows) if any(row.get(name) for name in _FIXED)),
        sides=sides,
        ids=tuple(nodes),
        source="COMPAS",
        notes=(*((load,) if loaded else ()), *unread((name for row in own for name in row), _KNOWN)),
        **values,
    ).with_edges(is_edge)
