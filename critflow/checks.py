"""What makes a network: checks of its pins, cell, ends and positions, and the blocks of its graph.

A block is a maximal part of the network that no single vertex separates, where all pins count as one vertex.  The
bond vectors in balance split over the blocks.  Where b sums to zero around every cycle of a block, there are
coordinates at which all its bond vectors vanish, and these minimise Σσ|L|² under every positive stress: the block
collapses to a point, as every bridge does.  In any other block each edge has a length for almost every stress:
L_α = 0 for all σ implies 0 = ∂L_α/∂σ_β = −(g P⁻¹ gᵀ)_{αβ} L_β for every β, and inside a block no entry of g P⁻¹ gᵀ
vanishes for all σ.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import product

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike, NDArray
from scipy.sparse.csgraph import connected_components, depth_first_order

from critflow.arguments import Array, IntArray, Mask, finite_rows, floats, shown
from critflow.result import NetworkError

# Most vertices of a network that is made from a number alone, which may be a typing error: 1 kB a vertex is 20 GB.
MOST_VERTICES = 20_000_000
# Distance of the pins from the origin in units of their extent, at most: four digits of every length.
_FARTHEST = 1e4
# Part of the edges across the boundary that may be longer than the cell: wrong signs make it about a half.
_CONTRADICTING = 0.1
# An edge longer than every diagonal of the cell is doubtful if its nearest image is less than this part of it.
_NEARER = 0.5


def checked_pins(pins: object, n_vertices: int) -> dict[int, Array]:
    if pins is None:
        return {}
    if not isinstance(pins, Mapping):
        raise NetworkError(f"pins must be a mapping, such as {{0: [0.0, 0.0]}}, not a {type(pins).__name__}")
    places = {}
    for vertex, position in pins.items():
        if not isinstance(vertex, int | np.integer) or not 0 <= vertex < n_vertices:
            raise NetworkError(f"pin {shown(vertex)} is not a vertex: vertices run from 0 to {n_vertices - 1}")
        places[int(vertex)] = place = floats(position, f"the position of pin {vertex}")
        if not np.isfinite(place).all():
            raise NetworkError(f"the position of pin {vertex} is not finite: give one number for each dimension")
    if len({place.shape for place in places.values()}) == 1:
        positions = np.array(list(places.values()))
        distance, extent = np.abs(positions).max(), np.ptp(positions, axis=0).max(initial=0.0)
        if distance > _FARTHEST * extent > 0:
            raise NetworkError(
                f"the pins lie {distance / extent:.0e} times their extent from the origin, which costs as many digits "
                "of every length: subtract their mean"
            )
    return places


def checked_cell(cell: ArrayLike, dimension: int | None = None) -> Array:
    """A copy of cell vectors as rows (d, d), else a `NetworkError`."""
    array = floats(cell, "cell")
    if array.ndim != 2 or array.shape != (dimension or len(array),) * 2:
        raise NetworkError(
            f"cell must be a square matrix with {dimension or 'd'} cell vectors as rows, not {array.shape}"
        )
    with np.errstate(all="ignore"):
        volume = abs(np.linalg.det(array))
    # A volume beyond the range of doubles has no digits.
    if not (np.isfinite(array).all() and 0 < volume < np.inf):
        raise NetworkError(
            "the cell vectors must span a finite volume: two of them are parallel, or one is zero or huge"
        )
    return array


def check_size(n_vertices: float) -> None:
    """Raise `NetworkError` before a network of this size is made if it is out of reach."""
    if not n_vertices <= MOST_VERTICES:
        raise NetworkError(
            f"a network of {n_vertices:,} vertices needs about {n_vertices / 1e6:,.0f} GB to make: choose at most "
            f"{MOST_VERTICES:,} vertices"
        )


def check_ends(edges: IntArray, n_vertices: int) -> None:
    missing = (edges < 0) | (edges >= n_vertices)
    if missing.any():
        edge = int(np.flatnonzero(missing.any(axis=1))[0])
        raise NetworkError(
            f"edge {edge} joins vertices {edges[edge].tolist()}, but vertices run from 0 to {n_vertices - 1}: "
            "remove it or add the vertex, or check whether counting begins at 0 or 1"
        )


def check_positions(
    positions: Array, edges: IntArray, offsets: IntArray, cell: Array | None, shape: tuple[int, int]
) -> None:
    """Raise `NetworkError` for positions that are not finite, or contradict the offsets of many edges."""
    finite_rows(positions, "positions", shape)
    if cell is None:
        return
    doubtful, n_crossing, contradicted = doubtful_offsets(edges, offsets, cell, positions)
    if contradicted:
        raise NetworkError(
            f"the positions contradict the offsets of {len(doubtful)} of {n_crossing} edges across the "
            f"boundary: edge {doubtful[0]} is longer than the cell, though its ends have images nearby; an "
            "offset is that of the head (negate it?), or leave positions out"
        )


def doubtful_offsets(
    edges: IntArray, offsets: IntArray, cell: Array, positions: Array
) -> tuple[NDArray[np.intp], int, bool]:
    """Edges longer than every diagonal of the cell and more than twice their image nearest by rounded coordinates.

    With the number of edges across the boundary, and whether so many are doubtful that a convention is wrong; a few
    long edges may be meant.
    """
    # An edge from a vertex to an image of itself has no nearer one.
    crossing = np.flatnonzero(offsets.any(axis=1) & (edges[:, 0] != edges[:, 1]))
    tail, head = edges[crossing].T
    apart = (positions[head] - positions[tail]) @ np.linalg.inv(cell) + offsets[crossing]
    given, nearest = (np.linalg.norm(v @ cell, axis=1) for v in (apart, apart - np.round(apart)))
    corners = np.array(list(product((-1.0, 1.0), repeat=len(cell)))) @ cell
    doubtful = crossing[(given > np.linalg.norm(corners, axis=1).max()) & (nearest < _NEARER * given)]
    return doubtful, len(crossing), len(doubtful) > max(1, _CONTRADICTING * len(crossing))


# Pins closer than this part of a cell vector, or of the largest coordinate, lie at the same place.
_SAME_PLACE = 1e-13


def blocks(
    edges: IntArray, offsets: IntArray, cell: Array | None, pins: Mapping[int, Array], n_vertices: int
) -> tuple[IntArray, IntArray]:
    """The block of each edge, (N_b,), and the gain of the cycle that it closes with a spanning tree, (N_b, d + 1).

    The gain is a sum of offsets and, in the last column, of differences of the places of pins: it is zero where b is.
    Parts of the graph that no edge joins are blocks apart.  All follows from one depth-first tree, in which every other
    edge joins a vertex to one of its ancestors.
    """
    # The vertex after the last one is the root: all pins in one, or a vertex that edges without gain join to the parts.
    root, gains = n_vertices, np.column_stack([offsets, np.zeros(len(edges), np.int64)])
    vertex = np.arange(n_vertices)
    if pins:
        vertex[list(pins)] = root
        place = _places(pins, cell, n_vertices)
        gains += place[edges[:, 1]] - place[edges[:, 0]]
    ends = vertex[edges]
    part = components(ends, n_vertices + 1)
    first = np.unique(part, return_index=True)[1]
    joints = first[part[first] != part[root]]
    ends = np.concatenate([ends, np.column_stack([np.full_like(joints, root), joints])])
    gains = np.concatenate([gains, np.zeros((len(joints), gains.shape[1]), np.int64)])

    # Vertices by their number in the order of the visit, in which a subtree is the range [v, end(v)).
    parent, number, end = _depth_first_tree(ends, root)
    ends = number[ends]
    upper, lower = np.sort(ends, axis=1).T

    # Edges above a vertex and above its parent share a block if an edge leaves the subtree to beyond the parent.  The
    # edge of the tree above a vertex has its number; every edge belongs to the block of its lower end.
    reached = np.arange(len(parent))
    np.minimum.at(reached, lower, upper)
    joined = np.flatnonzero(_range_minima(reached, end) < parent)
    block = components(np.column_stack([joined, parent[joined]]), len(parent))[lower]
    # An edge from a vertex to an image of itself is a block by itself.
    loops = np.flatnonzero(lower == upper)
    block[loops] = len(parent) + np.arange(len(loops))

    # The sum of gains along the path from the root begins where a subtree begins, and ends where it ends.  Of parallel
    # edges the last one belongs to the tree.
    of_tree = np.flatnonzero((upper != lower) & (parent[lower] == upper))
    child, change = lower[of_tree], np.zeros((len(parent) + 1, gains.shape[1]), np.int64)
    change[child] = np.where((ends[of_tree, 1] == child)[:, None], gains[of_tree], -gains[of_tree])
    np.subtract.at(change, end, change[:-1].copy())
    potential = np.cumsum(change[:-1], axis=0)
    cycle_gain = potential[ends[:, 0]] + gains - potential[ends[:, 1]]
    return np.unique(block[: len(edges)], return_inverse=True)[1].ravel(), cycle_gain[: len(edges)]


def _places(pins: Mapping[int, Array], cell: Array | None, n_vertices: int) -> IntArray:
    """Image of the cell in which each pin lies, and the number of its place in that cell, (N_v, d + 1)."""
    x = np.array(list(pins.values()))
    unit = np.eye(x.shape[1]) * max(float(np.abs(x).max()), 1e-300) if cell is None else cell
    inside = x @ np.linalg.inv(unit)
    image = np.zeros(x.shape, np.int64) if cell is None else np.floor(inside + _SAME_PLACE).astype(np.int64)
    rounded = np.round((inside - image) / _SAME_PLACE)
    place = np.zeros((n_vertices, x.shape[1] + 1), np.int64)
    place[list(pins), :-1] = image
    place[list(pins), -1] = 1 + np.unique(rounded, axis=0, return_inverse=True)[1].ravel()
    return place


def _depth_first_tree(edges: IntArray, root: int) -> tuple[IntArray, IntArray, IntArray]:
    """A depth-first tree of a connected graph, whose vertices get numbers in the order of the visit.

    Returns the parent (n,) by number, for the root 0 itself; the number (n,) of each vertex; and one more than the last
    number of each subtree (n,), by number.
    """
    order, above = depth_first_order(_graph(np.concatenate([edges, edges[:, ::-1]]), root + 1), root)
    n = len(order)
    number = np.empty(n, np.int64)
    number[order] = np.arange(n)
    above[root] = root
    parent = number[above[order]]
    # The last of several assignments stands: each vertex points to its last child, then to its last descendant.
    last = np.arange(n)
    last[parent[1:]] = np.arange(1, n)
    while not np.array_equal(further := last[last], last):
        last = further
    return parent, number, last + 1


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
    # Added where vertices are missing and their numbers seem to count from one.
    from_zero = "; vertices count from 0: subtract 1 from their numbers" if edges.min() == 1 else ""
    # Before any array of n_vertices is made, whose number may be a typing error.
    if n_vertices - len(pins) > len(edges):
        used = np.union1d(edges, np.fromiter(pins, np.int64, len(pins)))
        unused = np.flatnonzero(used != np.arange(len(used)))
        lone = int(unused[0]) if len(unused) else len(used)
        if lone < n_vertices:
            raise NetworkError(
                f"vertex {lone} hangs on no edge: {n_vertices:,} vertices need two edges each, and there are "
                f"{len(edges):,} edges; remove it, or number the vertices without gaps{from_zero}"
            )
    degree = np.bincount(edges.ravel(), minlength=n_vertices)
    degree[list(pins)] = 2
    loose = np.flatnonzero(degree <= 1)
    if len(loose):
        support = "no edge" if degree[loose[0]] == 0 else "a single edge, which cannot carry tension"
        raise NetworkError(
            f"vertex {loose[0]} hangs on {support}: remove it, or use pruned(...) of critflow-extras{from_zero}"
        )
    if len(pins) == n_vertices or n_vertices == 1:
        raise NetworkError("no vertex is free to move, so there is nothing to find: add vertices or remove pins")
    # All pins belong to one support, so they count as joined.
    anchors = np.fromiter(pins, int, len(pins))
    part = components(np.concatenate([edges, np.column_stack([anchors[:-1], anchors[1:]])]), n_vertices)
    if (n_parts := int(part.max()) + 1) > 1:
        stray = int(np.flatnonzero(part != part[0])[0])
        raise NetworkError(
            f"the network falls into {n_parts} parts that no edge joins (vertices 0 and {stray} are in two of them): "
            "keep one part (pruned(...) of critflow-extras keeps the largest), or make a network of each"
        )
    block, cycle_gain = blocks(edges, offsets, cell, pins, n_vertices)
    collapsing = ~opened_edges(block, cycle_gain)
    if cell is None:
        collapsing &= np.bincount(block)[block] == 1
    _refuse(edges, collapsing, "use pruned(...) of critflow-extras, or correct its offsets")


def check_opened(edges: IntArray, offsets: IntArray, pins: Mapping[int, Array], n_vertices: int) -> None:
    """Raise `NetworkError` if an edge of a network without a cell has no length under any positive stress."""
    collapsing = ~opened_edges(*blocks(edges, offsets, None, pins, n_vertices))
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


def _graph(edges: IntArray, n_vertices: int) -> sp.csr_array:
    return sp.csr_array((np.ones(len(edges)), tuple(edges.T)), shape=(n_vertices, n_vertices))
