"""Bond vectors and sums of edge forces of a network with 32 digits, as stresses over many decades need them."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from critflow.linalg.matrices import free_ends
from critflow.networks.network import Array, Network
from critflow.precision.double_double import Extended, edge_differences, multiply, part, two_sum

BLOCK = 1 << 16  # rows of an array of d columns in one step: its temporaries are then some megabytes


class ExtendedGeometry:
    """Bond vectors L = g x + b, their lengths, and sums of edge forces, in extended precision, for one graph."""

    def __init__(self, network: Network):
        free = network.free
        # A fixed vertex is part of the boundary vectors; its index −1 reads the zero after the last free one.
        self._tail, self._head = free_ends(network).T
        # An edge from a vertex to an image of itself exerts no force; its two forces would cancel only to rounding.
        ends = np.where(self._tail == self._head, -1, [self._tail, self._head]).ravel()
        order = np.argsort(ends, kind="stable")
        order = order[ends[order] >= 0]
        degree = np.bincount(ends[order], minlength=len(free))
        first = np.cumsum(degree) - degree
        place = np.arange(len(order)) - np.repeat(first, degree)
        # Edges around each vertex, one array of all vertices after the other, with the signs of their forces on it.
        self._around: list[tuple[NDArray[np.int64], Array]] = []
        for number in range(int(degree.max())):
            row = (place == number).nonzero()[0]
            edges, signs = np.zeros(len(free), np.int64), np.zeros((len(free), 1))
            edges[ends[order[row]]] = order[row] % network.n_edges
            signs[ends[order[row]], 0] = np.where(order[row] < network.n_edges, -1.0, 1.0)
            self._around.append((edges, signs))

    def bond_vectors(self, x: Extended, b: Array) -> Extended:
        """L (N_b, d) from free coordinates x (n_free, d) and boundary vectors b (N_b, d), to 32 digits of those."""
        zero = np.zeros((1, x.high.shape[1]))
        padded = Extended(np.concatenate([x.high, zero]), np.concatenate([x.low, zero]))
        high, low = np.empty(b.shape), np.empty(b.shape)
        for rows in blocks(len(b)):
            high[rows], low[rows] = edge_differences(self._tail[rows], self._head[rows], padded, b[rows])
        return Extended(high, low)

    def tension_forces(self, sigma: Extended, L: Extended) -> Extended:
        """gᵀ(σ ∘ L) over the free vertices, (n_free, d), of σ (N_b, 1) and L (N_b, d), to 32 digits of those."""
        high, low = np.empty_like(L.high), np.empty_like(L.low)
        for rows in blocks(len(high)):
            high[rows], low[rows] = multiply(part(sigma, rows), part(L, rows))
        return self.divergence(Extended(high, low))

    def divergence(self, edge_vectors: Extended) -> Extended:
        """gᵀ v over the free vertices, (n_free, d), of edge vectors v (N_b, d), to 32 digits of those."""
        return self._sums(edge_vectors, self._around)

    def spread(self, edge_vectors: Extended) -> Extended:
        """|g|ᵀ v over the free vertices, likewise: what each edge adds to both of its ends."""
        return self._sums(edge_vectors, [(edges, np.abs(signs)) for edges, signs in self._around])

    def _sums(self, v: Extended, around: list[tuple[NDArray[np.int64], Array]]) -> Extended:
        shape = (len(around[0][0]), v.high.shape[1])
        high, low = np.empty(shape), np.empty(shape)
        for rows in blocks(shape[0]):
            total = np.zeros((len(around[0][0][rows]), shape[1]))
            rest = np.zeros_like(total)
            for edges, signs in around:
                at, sign = edges[rows], signs[rows]
                total, rounding = two_sum(total, sign * v.high.take(at, 0))
                rest = rest + sign * v.low.take(at, 0) + rounding
            high[rows], low[rows] = two_sum(total, rest)
        return Extended(high, low)


def blocks(n_rows: int) -> Iterator[slice]:
    """Rows of an array in parts, whose temporary arrays are small enough for the cache."""
    return (slice(start, start + BLOCK) for start in range(0, n_rows, BLOCK))
