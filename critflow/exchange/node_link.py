"""Graphs as JSON in the node-link form of networkx, read and written without it."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from critflow.exchange.data import NetworkData
from critflow.exchange.graphs import edge_attributes, from_graph, node_attributes
from critflow.exchange.packages import optional
from critflow.result import InputError


@dataclass(frozen=True)
class NodeLink:
    """The part of a networkx graph that `from_graph` reads; each edge keeps its order and its ends."""

    graph: Mapping[str, Any]
    nodes: Mapping[Any, Mapping[str, Any]]
    links: list[tuple[Any, Any, Mapping[str, Any]]]

    def number_of_edges(self) -> int:
        return len(self.links)

    def edges(self, data: bool = True) -> Iterator[tuple[Any, Any, Mapping[str, Any]]]:
        return iter(self.links)


def read_node_link(path: Path) -> NetworkData:
    """JSON in node-link form, with its edges under `edges` or `links`; in adjacency form by networkx."""
    content = json.loads(path.read_text(encoding="utf-8"))
    if isinstance(content, dict) and "adjacency" in content:
        graph = optional("networkx").adjacency_graph(content)
    else:
        graph = _graph(content)
    return replace(from_graph(graph), source=f"graph {path.name}")


def write_node_link(data: NetworkData, path: Path) -> None:
    """Write the file that `networkx.node_link_graph(..., edges="edges")` reads as a multigraph."""
    nodes = [attributes | {"id": n} for n, attributes in enumerate(node_attributes(data))]
    repeats = Counter[tuple[int, int]]()
    edges = []
    for (tail, head), attributes in zip(data.edges.tolist(), edge_attributes(data), strict=True):
        ends = min(tail, head), max(tail, head)
        edges.append(attributes | {"source": tail, "target": head, "key": repeats[ends]})
        repeats[ends] += 1
    cell = {} if data.cell is None else {"cell": data.cell.tolist()}
    content = {"directed": False, "multigraph": True, "graph": cell, "nodes": nodes, "edges": edges}
    path.write_text(json.dumps(content), encoding="utf-8")


def _graph(content: Any) -> NodeLink:
    links = content.get("edges", content.get("links")) if isinstance(content, dict) else None
    nodes = content.get("nodes") if isinstance(content, dict) else None
    if not (isinstance(nodes, list) and isinstance(links, list)):
        raise InputError(
            "the JSON file is no graph: it needs nodes and edges (or links), as networkx.node_link_data writes them"
        )
    if not all(isinstance(row, dict) for row in [*nodes, *links]):
        raise InputError('the nodes and edges of a graph in JSON must be objects, such as {"id": 0, "pos": [0, 0]}')
    if not all("source" in row and "target" in row for row in links):
        raise InputError("every edge of a graph in JSON needs a source and a target: complete them")
    named = {_name(row.get("id", n)): row for n, row in enumerate(nodes)}
    if len(named) < len(nodes):
        raise InputError("two nodes of the graph have the same id: give each its own")
    ends = [(_name(row["source"]), _name(row["target"]), row) for row in links]
    for tail, head, _ in ends:
        for end in (tail, head):
            if end not in named:
                raise InputError(f"an edge ends at the node {end!r}, which the file lacks: add it to the nodes")
    return NodeLink(content.get("graph", {}), named, [(a, b, _without_ends(row)) for a, b, row in ends])


def _name(value: Any) -> Any:
    """A name of a node; lists, such as the places of a grid, as tuples."""
    return tuple(map(_name, value)) if isinstance(value, list) else value


def _without_ends(row: Mapping[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in row.items() if name not in ("source", "target", "key")}
