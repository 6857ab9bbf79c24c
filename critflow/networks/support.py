"""Whether the boundary supports a network: every edge has a length under almost every positive stress."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from critflow.networks.blocks import blocks, components, opened_edges
from critflow.result import NetworkError

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]

# Most vertices of a network that is made from a number alone, which may be a typing error: 1 kB a vertex is 20 GB.
MOST_VERTICES = 20_000_000


def check_size(n_vertices: float) -> None:
    """Raise `NetworkError` before a network of this size is made if it is out of reach."""
    if not n_vertices <= MOST_VERTICES:
        raise NetworkError(
            f"a network of {n_vertices:,} vertices needs about {n_vertices / 1e6:,.0f} GB to make: choose at most "
            f"{MOST_VERTICES:,} vertices"
        )


def check_support(
    edges: IntArray, offsets: IntArray, cell: Array | None, pins: Mapping[int, Array], n_vertices: int
) -> None:
    """Raise `NetworkError` unless every edge has a length under almost every positive stress.

    Without a cell, a piece of several edges that hangs on one vertex may be a tensegrity, kept open by stresses of both
    signs: only bridges are refused, and `check_opened` refuses the rest where stresses must be positive.
    """
    _check_degrees(edges, pins, n_vertices)
    if len(pins) == n_vertices or n_vertices == 1:
        raise NetworkError("no vertex is free to move, so there is nothing to find: add vertices or remove pins")
    # All pins belong to one support, so they count as joined.
    anchors = np.fromiter(pins, int, len(pins))
    part = components(np.concatenate([edges, np.column_stack([anchors[:-1], anchors[1:]])]), n_vertices)
    if (n_parts := int(part.max()) + 1) > 1:
        stray = int(np.flatnonzero(part != part[0])[0])
        raise NetworkError(
            f"the network falls into {n_parts} parts that no edge joins (vertices 0 and {stray} are in two of them): "
            "keep one part (pruned(...) keeps the largest), or make a network of each"
        )
    block, cycle_gain = blocks(edges, offsets, cell, pins, n_vertices)
    collapsing = ~opened_edges(block, cycle_gain)
    if cell is None:
        collapsing &= np.bincount(block)[block] == 1
    _refuse(edges, collapsing, "use pruned(...), or correct its offsets")


def check_opened(
    edges: IntArray, offsets: IntArray, cell: Array | None, pins: Mapping[int, Array], n_vertices: int
) -> None:
    """Raise `NetworkError` if an edge has no length under any positive stress."""
    collapsing = ~opened_edges(*blocks(edges, offsets, cell, pins, n_vertices))
    _refuse(edges, collapsing, "pin more vertices, or use signed_stress for stresses of both signs")


def _refuse(edges: IntArray, collapsing: NDArray[np.bool_], advice: str) -> None:
    """Raise `NetworkError` if there are collapsing edges (N_b,)."""
    number = np.flatnonzero(collapsing)
    if len(number):
        first, second = edges[number[0]]
        also = f" and {len(number) - 1} more have" if len(number) > 1 else " has"
        raise NetworkError(
            f"edge {number[0]} between vertices {first} and {second}{also} no length under any positive stress, "
            f"because that part of the network hangs on a single vertex and wraps around nothing: {advice}"
        )


def _check_degrees(edges: IntArray, pins: Mapping[int, Array], n_vertices: int) -> None:
    """Raise `NetworkError` for free vertices with fewer than two edges."""
    # Before any array of n_vertices is made, whose number may be a typing error.
    if n_vertices - len(pins) > len(edges):
        used = np.union1d(edges, np.fromiter(pins, np.int64, len(pins)))
        unused = np.flatnonzero(used != np.arange(len(used)))
        lone = int(unused[0]) if len(unused) else len(used)
        if lone < n_vertices:
            raise NetworkError(
                f"vertex {lone} hangs on no edge: {n_vertices:,} vertices need two edges each, and there are "
                f"{len(edges):,} edges; remove it, or number the vertices without gaps"
            )
    degree = np.bincount(edges.ravel(), minlength=n_vertices)
    degree[list(pins)] = 2
    loose = np.flatnonzero(degree <= 1)
    if len(loose):
        support = "no edge" if degree[loose[0]] == 0 else "a single edge, which cannot carry tension"
        raise NetworkError(f"vertex {loose[0]} hangs on {support}: remove it, or use pruned(...)")
