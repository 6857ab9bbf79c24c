"""Edges that cross in the plane: found in all images of the cell, and joined by a vertex on request."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy

from critflow.extras.files.data import Array, IntArray, NetworkData, bond_vectors_of

# Parts of an edge next to its ends in which it meets others without crossing them.
_ENDS = 1e-9
# Pieces of the longest edge, at most, when neighbours are looked for.
_MOST_PIECES = 64


def crossings_of(data: NetworkData) -> tuple[IntArray, Array]:
    """Pairs (n, 2) of edges of a planar network that cross, and where along each, as parts (n, 2) of its length.

    Crossings with periodic images count; pairs are sorted by the edges.
    An edge is parallel to its own images, and crosses none of them.
    """
    start, L = data.positions[data.edges[:, 0]], bond_vectors_of(data)
    # A free network is periodic in a cell that is much larger.
    cell = (
        data.cell if data.cell is not None else 4 * float(np.abs(np.stack([start, start + L])).max() or 1) * np.eye(2)
    )
    pairs, shifts = _near(start, L, cell)
    first, second = pairs.T
    # Solutions t, s of a + t u = b + s v; NaN for parallel edges.
    w, u, v = start[second] + shifts @ cell - start[first], L[first], L[second]
    cross = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]
    parallel = np.abs(cross) <= _ENDS * np.linalg.norm(u, axis=1) * np.linalg.norm(v, axis=1)
    along = [w[:, 0] * e[:, 1] - w[:, 1] * e[:, 0] for e in (v, u)]
    parts = np.stack(along, axis=1) / np.where(parallel, np.nan, cross)[:, None]
    inside = ((parts > _ENDS) & (parts < 1 - _ENDS)).all(axis=1)
    return pairs[inside], parts[inside]


def split(data: NetworkData, pairs: IntArray, parts: Array) -> NetworkData:
    """The record with a vertex at each crossing of pairs (n, 2) of edges, at parts (n, 2) of their lengths.

    A part f of a spring has the stiffness k/f, the rest length f ℓ and the force density σ/f.
    """
    L, n_old = bond_vectors_of(data), data.n_vertices
    places = data.positions[data.edges[pairs[:, 0], 0]] + parts[:, :1] * L[pairs[:, 0]]
    vertex, places = _joined(places, data)
    # Ends and crossings of all edges, in order along each.
    m = data.n_edges
    edge = np.concatenate([np.arange(m), pairs.ravel(), np.arange(m)])
    part = np.concatenate([np.zeros(m), parts.ravel(), np.ones(m)])
    node = np.concatenate([data.edges[:, 0], n_old + np.repeat(vertex, 2), data.edges[:, 1]])
    order = np.lexsort((part, edge))
    edge, part, node = edge[order], part[order], node[order]
    piece = np.diff(part) * (edge[1:] == edge[:-1]) > _ENDS
    owner, f = edge[:-1][piece], np.diff(part)[piece]
    edges = np.stack([node[:-1][piece], node[1:][piece]], axis=1)
    positions = np.concatenate([data.positions, places])
    offsets = None
    if data.cell is not None:
        apart = f[:, None] * L[owner] - (positions[edges[:, 1]] - positions[edges[:, 0]])
        offsets = np.round(apart @ np.linalg.inv(data.cell)).astype(np.int64)
    whole = data.with_edges(owner)
    return replace(
        whole,
        edges=edges,
        positions=positions,
        offsets=offsets,
        bond_vectors=None,
        stiffness=(np.ones(len(f)) if whole.stiffness is None else whole.stiffness) / f,
        rest_lengths=None if whole.rest_lengths is None else whole.rest_lengths * f,
        force_densities=None if whole.force_densities is None else whole.force_densities / f,
        sides=None,
        ids=(*data.ids, *(f"crossing {k}" for k in range(len(places)))) if data.ids else (),
        vertex_numbers=np.append(np.asarray(data.vertex_numbers), np.full(len(places), -1)),
    )


def _near(start: Array, L: Array, cell: Array) -> tuple[IntArray, IntArray]:
    """Pairs (n, 2) of different edges with pieces near each other, and the cell (n, 2) of the second edge."""
    inverse, length = np.linalg.inv(cell), np.linalg.norm(L, axis=1)
    # Pieces of this size that meet are nearest images: their middles differ by less than half a cell vector.
    size = min(max(np.median(length), length.max() / _MOST_PIECES) or 1.0, 0.25 / np.linalg.norm(inverse, 2))
    count = np.maximum(1, np.ceil(length / size)).astype(int)
    edge = np.repeat(np.arange(len(L)), count)
    within = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
    middle = (start[edge] + ((within + 0.5) / count[edge])[:, None] * L[edge]) @ inverse
    tree = scipy.spatial.KDTree(middle - np.floor(middle), boxsize=1 + 1e-15)
    a, b = tree.query_pairs(1.001 * size * np.linalg.norm(inverse, 2), output_type="ndarray").T
    a, b = np.where(edge[a] < edge[b], (a, b), (b, a))
    rows = np.column_stack([edge[a], edge[b], np.round(middle[a] - middle[b]).astype(np.int64)])
    rows = np.unique(rows[edge[a] != edge[b]], axis=0)
    return rows[:, :2], rows[:, 2:]


def _joined(places: Array, data: NetworkData) -> tuple[IntArray, Array]:
    """The vertex of each crossing, and the place of each such vertex: lines through one point have one vertex."""
    if data.cell is None:
        scaled = (places - data.positions.min(axis=0)) / (float(np.ptp(data.positions, axis=0).max()) or 1.0)
    else:
        scaled = places @ np.linalg.inv(data.cell)
        scaled = scaled - np.floor(scaled)
    grid = np.round(scaled / (10 * _ENDS)).astype(np.int64)
    grid = grid % round(1 / (10 * _ENDS)) if data.cell is not None else grid
    _, first, vertex = np.unique(grid, axis=0, return_index=True, return_inverse=True)
    return vertex.ravel().astype(np.int64), places[first]
