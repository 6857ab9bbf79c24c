"""The blocks of a network, and whether its boundary opens them, from the graph alone.

A block is a maximal part of the network that no single vertex separates, where all pins count as one vertex.  The
bond vectors in balance split over the blocks.  Where b sums to zero around every cycle of a block, there are
coordinates at which all its bond vectors vanish, and these minimise Σσ|L|² under every positive stress: the block
collapses to a point, as every bridge does.  In any other block each edge has a length for almost every stress:
L_α = 0 for all σ implies 0 = ∂L_α/∂σ_β = −(g P⁻¹ gᵀ)_{αβ} L_β for every β, and inside a block no entry of g P⁻¹ gᵀ
vanishes for all σ.

All of this follows from one depth-first tree, in which every other edge joins a vertex to one of its ancestors.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components, depth_first_order

from critflow.result import NetworkError

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]
Mask = NDArray[np.bool_]

# Pins closer than this part of a cell vector, or of the largest coordinate, lie at the same place.
_SAME_PLACE = 1e-13


def blocks(
    edges: IntArray, offsets: IntArray, cell: Array | None, pins: Mapping[int, Array], n_vertices: int
) -> tuple[IntArray, IntArray]:
    """The block of each edge, (N_b,), and the gain of the cycle that it closes with a spanning tree, (N_b, d + 1).

    The gain is a sum of offsets and, in the last column, of differences of the places of pins: it is zero where b is.
    Parts of the graph that no edge joins are blocks apart.
    """
    # The vertex after the last one is the root: all pins in one, or a vertex that only joins the parts.
    vertex, gains = np.arange(n_vertices), np.column_stack([offsets, np.zeros(len(edges), np.int64)])
    if pins:
        anchors = np.fromiter(pins, np.int64, len(pins))
        vertex[anchors] = n_vertices
        place = np.zeros((n_vertices, offsets.shape[1] + 1), np.int64)
        # The image of the cell in which each pin lies, and the number of its place in that cell.
        x = np.array(list(pins.values()))
        unit = np.eye(x.shape[1]) * max(float(np.abs(x).max()), 1e-300) if cell is None else cell
        inside = x @ np.linalg.inv(unit)
        image = np.zeros(x.shape, np.int64) if cell is None else np.floor(inside + _SAME_PLACE).astype(np.int64)
        rounded = np.round((inside - image) / _SAME_PLACE)
        place[anchors, :-1] = image
        place[anchors, -1] = 1 + np.unique(rounded, axis=0, return_inverse=True)[1].ravel()
        gains += place[edges[:, 1]] - place[edges[:, 0]]
    ends = vertex[edges]
    part = components(ends, n_vertices + 1)
    first = np.unique(part, return_index=True)[1]
    joints = first[part[first] != part[n_vertices]]
    tree = _Tree(np.concatenate([ends, np.column_stack([np.full_like(joints, n_vertices), joints])]), n_vertices)
    gains = np.concatenate([gains, np.zeros((len(joints), gains.shape[1]), np.int64)])
    block = tree.blocks()[tree.lower]
    # An edge from a vertex to an image of itself is a block by itself.
    loops = np.flatnonzero(tree.lower == tree.upper)
    block[loops] = n_vertices + 1 + np.arange(len(loops))
    return np.unique(block[: len(edges)], return_inverse=True)[1].ravel(), tree.cycle_gains(gains)[: len(edges)]


def components(edges: IntArray, n_vertices: int) -> IntArray:
    """The connected part (N_v,) in which each vertex lies, counted in the order of their first vertices."""
    return np.asarray(connected_components(_graph(edges, n_vertices), directed=False)[1], np.int64)


def opened_edges(block: IntArray, cycle_gain: IntArray) -> Mask:
    """The edges (N_b,) of the blocks with a cycle that winds around the cell or joins pins at different places."""
    opened = np.zeros(len(block), bool)
    opened[block[cycle_gain.any(axis=1)]] = True
    return opened[block]


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


def _from_zero(edges: IntArray) -> str:
    """What to do where the numbers of vertices seem to count from one."""
    return "; vertices count from 0: subtract 1 from their numbers" if edges.size and edges.min() == 1 else ""


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
                f"{len(edges):,} edges; remove it, or number the vertices without gaps{_from_zero(edges)}"
            )
    degree = np.bincount(edges.ravel(), minlength=n_vertices)
    degree[list(pins)] = 2
    loose = np.flatnonzero(degree <= 1)
    if len(loose):
        support = "no edge" if degree[loose[0]] == 0 else "a single edge, which cannot carry tension"
        raise NetworkError(f"vertex {loose[0]} hangs on {support}: remove it, or use pruned(...){_from_zero(edges)}")


def _graph(edges: IntArray, n_vertices: int) -> sp.csr_array:
    return sp.csr_array((np.ones(len(edges)), tuple(edges.T)), shape=(n_vertices, n_vertices))


class _Tree:
    """A depth-first tree, its vertices numbered in the order of the visit: a subtree is the range [v, end(v)).

    parent        (n,) by number, as all that follow; the root is 0 and the parent of itself
    end           (n,) one more than the last number of the subtree
    ends          (N_b, 2) tail and head of each edge
    upper, lower  (N_b,) the same as ancestor and descendant
    """

    def __init__(self, edges: IntArray, root: int):
        graph = _graph(np.concatenate([edges, edges[:, ::-1]]), root + 1)
        order, above = depth_first_order(graph, root)
        n = len(order)
        place = np.empty(n, np.int64)
        place[order] = np.arange(n)
        above[root] = root
        self.parent = place[above[order]]
        last = np.arange(n)
        # The last of several assignments stands: each vertex points to its last child, then to its last descendant.
        last[self.parent[1:]] = np.arange(1, n)
        while not np.array_equal(further := last[last], last):
            last = further
        self.end = last + 1
        self.ends = place[edges]
        self.upper, self.lower = np.sort(self.ends, axis=1).T

    def blocks(self) -> IntArray:
        """The block (n,) of the edge of the tree above each vertex; an edge belongs to the block of its lower end."""
        # Edges above a vertex and above its parent share a block if an edge leaves the subtree to beyond the parent.
        reached = np.arange(len(self.parent))
        np.minimum.at(reached, self.lower, self.upper)
        joined = np.flatnonzero(_range_minima(reached, self.end) < self.parent)
        pairs = np.column_stack([joined, self.parent[joined]])
        return components(pairs, len(self.parent))

    def cycle_gains(self, gains: IntArray) -> IntArray:
        """The gain (N_b, m) of the cycle that each edge closes with the tree, from the gains of the edges."""
        # Of parallel edges the last one belongs to the tree.
        number = np.flatnonzero((self.upper != self.lower) & (self.parent[self.lower] == self.upper))
        child = self.lower[number]
        change = np.zeros((len(self.parent) + 1, gains.shape[1]), np.int64)
        change[child] = np.where((self.ends[number, 1] == child)[:, None], gains[number], -gains[number])
        # The sum along the path from the root begins where a subtree begins, and ends where it ends.
        np.subtract.at(change, self.end, change[:-1].copy())
        potential = np.cumsum(change[:-1], axis=0)
        return np.asarray(potential[self.ends[:, 0]] + gains - potential[self.ends[:, 1]])


def _range_minima(values: IntArray, end: IntArray) -> IntArray:
    """Minima of values[v:end[v]] for every v, from minima over all ranges of 1, 2, 4, ... values in turn."""
    minima, level = values.copy(), np.frexp(end - np.arange(len(values)))[1] - 1
    table, width = values, 1
    for k in range(int(level.max()) + 1):
        here = np.flatnonzero(level == k)
        minima[here] = np.minimum(table[here], table[end[here] - width])
        table = np.minimum(table[:-width], table[width:])
        width *= 2
    return minima
