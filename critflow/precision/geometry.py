"""Bond vectors and sums of edge forces of a network in extended precision.

Two sums of forces serve two purposes.  `ExtendedGeometry.divergence` keeps 32 digits of the terms at each vertex, as
stresses over many decades need.  `exact_sums` consists of sparse products and serves any matrix; its rounding is 2⁻⁷⁷
of the largest of all terms, which is enough for the forces of springs.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from critflow.linalg.matrices import free_ends
from critflow.linalg.vectors import product
from critflow.networks.network import Array, IntArray, Network
from critflow.precision.double_double import Extended, multiply, part, two_product, two_sum

BLOCK = 1 << 16  # rows of an array of d columns in one step: its temporaries are then some megabytes


def edge_differences(tail: IntArray, head: IntArray, x: Extended, b: Array) -> Extended:
    """L_α = x_head − x_tail + b_α, (N_b, d), of coordinates x (n, d), to 32 digits of those."""
    ends, rest = two_sum(x.high.take(head, 0), -x.high.take(tail, 0))
    high, low = two_sum(ends, b)
    low += rest
    if x.low.any():
        low += x.low.take(head, 0) - x.low.take(tail, 0)
    return two_sum(high, low)


def exact_bond_vectors(network: Network, coordinates: Array, displacement: Array) -> Extended:
    """L = g (x + D) + b, (N_b, d), with displacements D (n_free, d) below the rounding of the coordinates (N_v, d)."""
    x, D = coordinates, np.zeros_like(coordinates)
    D[network.free_rows] = displacement
    if network.pins:
        # Pins are part of b; of a periodic network only differences count.
        x = coordinates.copy()
        x[list(network.pins)] = 0.0
    tail, head = np.ascontiguousarray(network.edges.T)
    return edge_differences(tail, head, Extended(x, D), network.boundary_vectors)


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
        return _in_blocks(lambda rows: edge_differences(self._tail[rows], self._head[rows], padded, b[rows]), b.shape)

    def tension_forces(self, sigma: Extended, L: Extended) -> Extended:
        """gᵀ(σ ∘ L) over the free vertices, (n_free, d), of σ (N_b, 1) and L (N_b, d), to 32 digits of those."""
        return self.divergence(_in_blocks(lambda rows: multiply(part(sigma, rows), part(L, rows)), L.high.shape))

    def divergence(self, edge_vectors: Extended) -> Extended:
        """gᵀ v over the free vertices, (n_free, d), of edge vectors v (N_b, d), to 32 digits of those."""
        return self._sums(edge_vectors, self._around)

    def spread(self, edge_vectors: Extended) -> Extended:
        """|g|ᵀ v over the free vertices, likewise: what each edge adds to both of its ends."""
        return self._sums(edge_vectors, [(edges, np.abs(signs)) for edges, signs in self._around])

    def _sums(self, v: Extended, around: list[tuple[NDArray[np.int64], Array]]) -> Extended:
        shape = (len(around[0][0]), v.high.shape[1])

        def of(rows: slice) -> Extended:
            total = np.zeros((len(around[0][0][rows]), shape[1]))
            rest = np.zeros_like(total)
            for edges, signs in around:
                at, sign = edges[rows], signs[rows]
                total, rounding = two_sum(total, sign * v.high.take(at, 0))
                rest = rest + sign * v.low.take(at, 0) + rounding
            return two_sum(total, rest)

        return _in_blocks(of, shape)


def blocks(n_rows: int) -> Iterator[slice]:
    """Rows of an array in parts, whose temporary arrays are small enough for the cache."""
    return (slice(start, start + BLOCK) for start in range(0, n_rows, BLOCK))


def _in_blocks(of: Callable[[slice], Extended], shape: tuple[int, ...]) -> Extended:
    """An extended array from parts of its rows."""
    if shape[0] <= BLOCK:
        return of(slice(None))
    result = Extended(np.empty(shape), np.empty(shape))
    for rows in blocks(shape[0]):
        result.high[rows], result.low[rows] = of(rows)
    return result


def exact_forces(network: Network, sigma: Array, bond_vectors: Extended) -> Array:
    """−gᵀ(σ ∘ L), (n_free, d), with the rounding of σ and of the result alone."""
    # One stress for each component: NumPy is several times slower where it repeats them in every product.
    stress = np.repeat(sigma, bond_vectors.high.shape[1]).reshape(bond_vectors.high.shape)
    pull = two_product(stress, bond_vectors.high)
    leading = _leading(pull.high)
    # The incidence is of ones, on any grid.
    small = product(network.divergence, (pull.high - leading) + (pull.low + stress * bond_vectors.low))
    return -(product(network.divergence, leading) + small)


def exact_sums(matrix: sp.csr_array, vectors: Extended, less: Array | float = 0.0) -> Array:
    """A v − w for a sparse A, its terms cancelling without loss.

    The leading halves of A and v lie on grids on which their products and sums are exact; the remainder is
    smaller by 2⁻²⁵, and so is its rounding.
    """
    leading = _leading(vectors.high)
    small = product(matrix, (vectors.high - leading) + vectors.low)
    coarse = _leading(matrix.data)
    if not np.array_equal(coarse, matrix.data):
        small = small + sp.csr_array((matrix.data - coarse, matrix.indices, matrix.indptr), matrix.shape) @ leading
        matrix = sp.csr_array((coarse, matrix.indices, matrix.indptr), matrix.shape)
    return np.asarray((product(matrix, leading) - less) + small)


def _leading(values: Array) -> Array:
    """Values rounded to a grid common to all, 2⁻²⁶ of the largest."""
    largest = float(np.abs(values).max(initial=0.0))
    if not largest:
        return values
    grid = 1.5 * 2.0 ** (np.ceil(np.log2(largest)) + 27)
    return np.asarray((values + grid) - grid)
