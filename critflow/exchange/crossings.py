"""Edges that cross in the plane: found in all images of the cell, and joined by a vertex on request."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from scipy.spatial import KDTree

from critflow.exchange.data import Array, IntArray, NetworkData, bond_vectors_of

# Parts of an edge next to its ends in which it meets others without crossing them.
_ENDS = 1e-9
# Pieces of the longest edge, at most, when neighbours are looked for.
_MOST_PIECES = 64


@dataclass(frozen=True, eq=False)
class Crossings:
    """Pairs of edges that cross, and where along each of the two, as a part of its length.

    pairs  (n, 2) edges
    parts  (n, 2) in the open interval from 0 to 1
    """

    pairs: IntArray
    parts: Array


def crossings_of(data: NetworkData) -> Crossings:
    """All crossings of the edges of a planar network, with those of periodic images."""
    start, L = data.positions[data.edges[:, 0]], bond_vectors_of(data)
    n = len(L)
    owner, at = np.arange(n), start
    if data.cell is not None:
        inverse = np.linalg.inv(data.cell)
        fraction = start @ inverse
        start = (fraction - np.floor(fraction)) @ data.cell
        owner, at = _images(start, L, data.cell)
    pairs = _near(np.concatenate([start, at]), np.concatenate([L, L[owner]]), n)
    first, second = pairs[:, 0], owner[pairs[:, 1] - n]
    parts = _parts(start[first], L[first], at[pairs[:, 1] - n], L[second])
    inside = ((parts > _ENDS) & (parts < 1 - _ENDS)).all(axis=1) & (first <= second)
    both, parts = np.stack([first, second], axis=1)[inside], parts[inside]
    # An edge that crosses an image of itself does so in two images, of which one is kept.
    kept = (both[:, 0] < both[:, 1]) | (parts[:, 0] < parts[:, 1])
    return Crossings(both[kept].astype(np.int64), parts[kept])


def split(data: NetworkData, found: Crossings) -> NetworkData:
    """The record with a vertex at each crossing.

    A part f of a spring has the stiffness k/f, the rest length f ℓ and the force density σ/f.
    """
    L, n_old = bond_vectors_of(data), data.n_vertices
    places = data.positions[data.edges[found.pairs[:, 0], 0]] + found.parts[:, :1] * L[found.pairs[:, 0]]
    vertex, places = _joined(places, data)
    # Ends and crossings of all edges, in order along each.
    m = data.n_edges
    edge = np.concatenate([np.arange(m), found.pairs.ravel(), np.arange(m)])
    part = np.concatenate([np.zeros(m), found.parts.ravel(), np.ones(m)])
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
        ids=(*data.ids, *(f"crossing {k}" for k in range(len(places)))) if data.ids else (),
        vertex_numbers=np.append(np.asarray(data.vertex_numbers), np.full(len(places), -1)),
    )


def _images(start: Array, L: Array, cell: Array) -> tuple[IntArray, Array]:
    """Owner and start of all images of the edges that may meet edges which start in the cell."""
    low, high = np.minimum(start, start + L), np.maximum(start, start + L)
    bottom, top = low.min(axis=0), high.max(axis=0)
    # Both edges of a pair may leave the cell, in opposite directions.
    reach = 1 + int(np.ceil(2 * np.abs(L @ np.linalg.inv(cell)).max()))
    owners, starts = [], []
    for image in product(range(-reach, reach + 1), repeat=2):
        shift = np.array(image) @ cell
        meeting = np.flatnonzero(((high + shift >= bottom) & (low + shift <= top)).all(axis=1))
        owners.append(meeting)
        starts.append(start[meeting] + shift)
    return np.concatenate(owners), np.concatenate(starts)


def _near(start: Array, L: Array, n: int) -> IntArray:
    """Pairs, sorted, of one of the first n segments and one of the others that have pieces near each other."""
    length = np.linalg.norm(L, axis=1)
    size = max(float(np.median(length)), float(length.max()) / _MOST_PIECES) or 1.0
    # Pieces that meet are shorter than this size, and so are the distances of their middles.
    count = np.maximum(1, np.ceil(length / size)).astype(int)
    segment = np.repeat(np.arange(len(L)), count)
    within = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
    middle = start[segment] + ((within + 0.5) / count[segment])[:, None] * L[segment]
    first = int(count[:n].sum())
    near = KDTree(middle[:first]).sparse_distance_matrix(KDTree(middle[first:]), 1.001 * size, output_type="ndarray")
    pairs = np.unique(segment[near["i"]] * len(L) + segment[first + near["j"]])
    return np.stack(np.divmod(pairs, len(L)), axis=1)


def _parts(a: Array, u: Array, b: Array, v: Array) -> Array:
    """Solutions t, s of a + t u = b + s v, (n, 2); NaN for parallel segments."""
    cross = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]
    parallel = np.abs(cross) <= _ENDS * np.linalg.norm(u, axis=1) * np.linalg.norm(v, axis=1)
    cross = np.where(parallel, np.nan, cross)
    w = b - a
    return np.stack(
        [(w[:, 0] * v[:, 1] - w[:, 1] * v[:, 0]) / cross, (w[:, 0] * u[:, 1] - w[:, 1] * u[:, 0]) / cross], axis=1
    )


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
