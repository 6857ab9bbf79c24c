"""The part of a network that can carry tension.

Cut at a vertex or at a single edge, a network falls into blocks: the biconnected components of its graph, in which any
two edges lie on a common cycle.  Forces balance on each block alone.  A block of which no cycle winds around the cell,
or joins pins at different positions, therefore carries no tension: bridges and dangling ends, which are blocks of one
edge, and closed pieces that hang on one vertex.  In any other block every edge lies on a winding cycle, and almost all
positive stresses give it a length.  A piece of springs that hangs on one vertex may still have a self-stress of both
signs; it does not change the moduli, and is removed too.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike, NDArray
from scipy.sparse.csgraph import breadth_first_order, connected_components

from critflow.networks.faces import PlanarFaces
from critflow.networks.network import Array, IntArray, Network
from critflow.result import NetworkError

Mask = NDArray[np.bool_]


class Pruned(NamedTuple):
    """A network that can carry tension on every edge; `network.note` is a sentence about the edges removed.

    edges     (N_b,) index that each edge had before
    vertices  (N_v,) index that each vertex had before
    """

    network: Network
    edges: IntArray
    vertices: IntArray


def prune(network: Network, kept: ArrayLike | None = None) -> Pruned:
    """Remove the edges that cannot carry tension, of the whole network or of the edges in the mask `kept` (N_b,).

    Raises `NetworkError` if nothing remains.
    """
    mask = np.ones(network.n_edges, bool) if kept is None else np.asarray(kept)
    if mask.dtype != bool or mask.shape != (network.n_edges,):
        raise NetworkError(f"kept must be a mask with one boolean per edge, shape ({network.n_edges},)")
    number = np.flatnonzero(mask)
    part = carrying_part(network.edges[number], network.offsets[number], network.pins, network.n_vertices)
    return part_of(network, number[part.edges], part.sentence)


def pruned_network(
    edges: ArrayLike,
    offsets: ArrayLike | None = None,
    cell: ArrayLike | None = None,
    stiffness: ArrayLike = 1.0,
    pins: Mapping[int, ArrayLike] | None = None,
    positions: ArrayLike | None = None,
) -> Pruned:
    """The part that can carry tension of edges that need not all do so; the arguments are those of `Network`.

    Vertices without edges are dropped too.
    Raises `NetworkError` if nothing remains.
    """
    raw = _Loose(
        edges,  # type: ignore[arg-type]
        offsets,  # type: ignore[arg-type]
        cell,  # type: ignore[arg-type]
        stiffness,  # type: ignore[arg-type]
        pins or {},  # type: ignore[arg-type]
        n_vertices=0 if positions is None else len(np.asarray(positions)),
        positions=positions,  # type: ignore[arg-type]
    )
    return prune(raw)


class _Loose(Network):
    """Edges and a boundary, of which some edges need not carry tension."""

    @staticmethod
    def _check_support(edges: IntArray, pins: Mapping[int, Array], n_vertices: int) -> None:
        pass


class CarryingPart(NamedTuple):
    """The largest connected part whose edges can all carry tension, and the reason for each edge removed.

    edges        (n,) indices of its edges
    n_vertices   vertices of these edges
    directions   number of independent directions in which it winds around the cell
    bridges      edges of bridges and dangling ends
    closed       edges of pieces that hang on one vertex
    separate     edges that can carry tension, but in parts apart from the largest one
    """

    edges: IntArray
    n_vertices: int
    directions: int
    bridges: int
    closed: int
    separate: int

    @property
    def coordination(self) -> float:
        """Mean number of edges a vertex, z = 2 N_b/N_v."""
        return 2 * len(self.edges) / max(self.n_vertices, 1)

    @property
    def sentence(self) -> str:
        """The note on the edges removed."""
        counted = {
            "on bridges and dangling ends": self.bridges,
            "in pieces that hang on one vertex": self.closed,
            "in separate pieces": self.separate,
        }
        removed = [f"{count} {where}" for where, count in counted.items() if count]
        total = self.bridges + self.closed + self.separate
        if not total:
            return "every edge can carry tension"
        return f"removed {total} of {total + len(self.edges)} edges, which cannot carry tension: {', '.join(removed)}"


def carrying_part(edges: IntArray, offsets: IntArray, pins: Mapping[int, Array], n_vertices: int) -> CarryingPart:
    """The part of edges (n, 2) with offsets (n, d) that can carry tension; all pins count as joined."""
    # All pins are one vertex, and the label of a pin takes part in the gain of its edges as an offset does.
    root, label = n_vertices, np.zeros(n_vertices, int)
    vertex = np.arange(n_vertices)
    if pins:
        anchors = np.fromiter(pins, int, len(pins))
        vertex[anchors] = root
        places = np.unique(np.array([pins[i] for i in anchors]), axis=0, return_inverse=True)[1]
        label[anchors] = 1 + places.ravel()
    joined = vertex[edges]
    gains = np.column_stack([offsets, label[edges[:, 1]] - label[edges[:, 0]]])
    block, cycle_gain = _blocks(joined, gains, n_vertices + 1)
    winds = cycle_gain.any(axis=1)
    winding = np.zeros(len(edges), bool)
    winding[block[winds]] = True
    carries = winding[block]
    size = np.bincount(block, minlength=len(edges))[block]

    part = connected_components(_graph(joined[carries], n_vertices + 1), directed=False)[1]
    here = part[joined[:, 0]]
    largest = np.bincount(here[carries], minlength=1).argmax()
    kept = carries & (here == largest)
    loops = np.unique(cycle_gain[kept & winds], axis=0)
    used = np.zeros(n_vertices, bool)
    used[edges[kept]] = True
    return CarryingPart(
        np.flatnonzero(kept),
        int(used.sum()),
        int(np.linalg.matrix_rank(loops[:, :-1])) if len(loops) else 0,
        int(np.sum(~carries & (size == 1))),
        int(np.sum(~carries & (size > 1))),
        int(np.sum(carries & ~kept)),
    )


def part_of(network: Network, kept: IntArray, note: str) -> Pruned:
    """The network of the edges with these indices, with the faces of its embedding if the whole has faces."""
    if len(kept) == 0:
        raise NetworkError("no edge can carry tension: no closed path winds around the cell or joins two pins")
    edges, index = network.edges[kept], np.full(network.n_vertices, -1)
    index[edges] = 0
    vertices = np.flatnonzero(index == 0)
    index[vertices] = np.arange(len(vertices))
    positions = None if network.positions is None else network.positions[vertices]
    faces = None
    if network.faces is not None and positions is not None and network.cell is not None:
        L = positions[index[edges[:, 1]]] - positions[index[edges[:, 0]]] + network.offsets[kept] @ network.cell
        faces = PlanarFaces(index[edges], L, len(vertices))
    part = Network(
        index[edges],
        network.offsets[kept],
        network.cell,
        network.stiffness[kept],
        {int(index[i]): p for i, p in network.pins.items() if index[i] >= 0},
        positions=positions,
        faces=faces,
        note=note,
    )
    return Pruned(part, kept, vertices)


def _graph(edges: IntArray, n_vertices: int) -> sp.csr_array:
    return sp.csr_array((np.ones(len(edges)), (edges[:, 0], edges[:, 1])), shape=(n_vertices, n_vertices))


def _blocks(edges: IntArray, gains: IntArray, n_vertices: int) -> tuple[IntArray, IntArray]:
    """Biconnected component of each edge, (n,), and the gain of the cycle that it closes with a spanning tree, (n, m).

    The last vertex is the root; parts of the graph that it does not belong to are joined to it.  By the algorithm of
    Tarjan and Vishkin (SIAM J. Comput. 14, 862, 1985), which needs a spanning tree and connected components only.
    """
    n_edges, root = len(edges), n_vertices - 1
    part = connected_components(_graph(edges, n_vertices), directed=False)[1]
    first = np.unique(part, return_index=True)[1]
    joints = first[part[first] != part[root]]
    joined = np.concatenate([edges, np.column_stack([joints, np.full(len(joints), root)])])
    gains = np.concatenate([gains, np.zeros((len(joints), gains.shape[1]), int)])

    order, parent = breadth_first_order(_graph(joined, n_vertices), root, directed=False)
    place = np.empty(n_vertices, int)
    place[order] = np.arange(n_vertices)
    # From here on vertices are named by their place in this order, in which parents and levels are contiguous.
    ends = place[joined]
    above = np.zeros(n_vertices, int)
    above[1:] = place[parent[order[1:]]]
    tree_edge = _tree_edges(ends, above)
    starts = _levels(above)
    potential = _potentials(ends, gains, above, tree_edge, starts)
    is_tree = np.zeros(len(ends), bool)
    is_tree[tree_edge] = True
    cycle_gain = np.where(is_tree[:, None], 0, potential[ends[:, 0]] + gains - potential[ends[:, 1]])

    size, number = _preorder(above, starts)
    u, v = ends[~is_tree & (ends[:, 0] != ends[:, 1])].T
    low, high = number.copy(), number.copy()
    for a, b in ((u, v), (v, u)):
        np.minimum.at(low, a, number[b])
        np.maximum.at(high, a, number[b])
    for start, end in reversed(starts):
        np.minimum.at(low, above[start:end], low[start:end])
        np.maximum.at(high, above[start:end], high[start:end])
    # Each vertex but the root stands for the edge to its parent; two edges of a block are joined here.
    u, v = np.where(number[u] < number[v], [u, v], [v, u])
    unrelated = number[u] + size[u] <= number[v]
    child = np.flatnonzero(above > 0)
    over = above[child]
    beyond = (low[child] < number[over]) | (high[child] >= number[over] + size[over])
    pairs = np.concatenate([np.column_stack([u, v])[unrelated], np.column_stack([child, over])[beyond]])
    block_of = connected_components(_graph(pairs, n_vertices), directed=False)[1]
    later = np.where(number[ends[:, 0]] > number[ends[:, 1]], ends[:, 0], ends[:, 1])
    block = block_of[later]
    # An edge from a vertex to its own image is a block of its own.
    own = ends[:, 0] == ends[:, 1]
    block[own] = n_vertices + np.arange(int(own.sum()))
    return np.unique(block[:n_edges], return_inverse=True)[1].ravel(), cycle_gain[:n_edges]


def _levels(above: IntArray) -> list[tuple[int, int]]:
    """Ranges of vertices, in breadth-first order, at each distance of 1 and more from the root."""
    ranges, start = [], 1
    while start < len(above):
        end = int(np.searchsorted(above[1:], start)) + 1
        ranges.append((start, end))
        start = end
    return ranges


def _tree_edges(ends: IntArray, above: IntArray) -> IntArray:
    """For each vertex but the root, one edge to its parent; `ends` (n, 2) in breadth-first order."""
    n = len(above)
    key = ends.min(axis=1) * n + ends.max(axis=1)
    order = np.argsort(key, kind="stable")
    return order[np.searchsorted(key[order], above[1:] * n + np.arange(1, n))]


def _potentials(
    ends: IntArray, gains: IntArray, above: IntArray, tree_edge: IntArray, levels: list[tuple[int, int]]
) -> IntArray:
    """Sums of gains from the root along the tree, (n_vertices, m)."""
    step = gains[tree_edge] * np.where(ends[tree_edge, 1] == np.arange(1, len(above)), 1, -1)[:, None]
    potential = np.zeros((len(above), gains.shape[1]), int)
    for start, end in levels:
        potential[start:end] = potential[above[start:end]] + step[start - 1 : end - 1]
    return potential


def _preorder(above: IntArray, levels: list[tuple[int, int]]) -> tuple[IntArray, IntArray]:
    """Number of vertices of each subtree, and the place of each vertex in preorder."""
    size, number = np.ones(len(above), int), np.zeros(len(above), int)
    for start, end in reversed(levels):
        np.add.at(size, above[start:end], size[start:end])
    for start, end in levels:
        parent, before = above[start:end], np.cumsum(size[start:end]) - size[start:end]
        eldest = np.searchsorted(parent, parent)
        number[start:end] = number[parent] + 1 + before - before[eldest]
    return size, number
