"""Bond vectors and sums of edge forces of a network in extended precision.

Two sums of forces serve two purposes.  `ExtendedGeometry.divergence` keeps 32 digits of the terms at each vertex, as
stresses over many decades need.  `exact_sums` consists of sparse products and serves any matrix; its rounding is 2⁻⁷⁷
of the largest of all terms, which is enough for the forces of springs.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from critflow.linalg.matrices import free_ends
from critflow.linalg.products import product
from critflow.networks.network import Array, IntArray, Network
from critflow.precision.double_double import Extended, two_product, two_sum


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
    tail, head = network.edges.T
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
        # Entry 2 N_b of the doubled list of edge forces is a zero.
        self._around: NDArray[np.int64] = np.full((int(degree.max()), len(free)), 2 * network.n_edges)
        self._around[place, ends[order]] = order

    def bond_vectors(self, x: Extended, b: Array) -> Extended:
        """L (N_b, d) from free coordinates x (n_free, d) and boundary vectors b (N_b, d), to 32 digits of those."""
        zero = np.zeros((1, x.high.shape[1]))
        padded = Extended(np.concatenate([x.high, zero]), np.concatenate([x.low, zero]))
        return edge_differences(self._tail, self._head, padded, b)

    def divergence(self, edge_vectors: Extended) -> Extended:
        """gᵀ v over the free vertices, (n_free, d), of edge vectors v (N_b, d), to 32 digits of those."""
        return self._sums(Extended(-edge_vectors.high, -edge_vectors.low), edge_vectors)

    def spread(self, edge_vectors: Extended) -> Extended:
        """|g|ᵀ v over the free vertices, likewise: what each edge adds to both of its ends."""
        return self._sums(edge_vectors, edge_vectors)

    def _sums(self, at_tails: Extended, at_heads: Extended) -> Extended:
        zero = np.zeros((1, at_tails.high.shape[1]))
        high = np.concatenate([at_tails.high, at_heads.high, zero])
        low = np.concatenate([at_tails.low, at_heads.low, zero])
        total, rest = high[self._around[0]], low[self._around[0]]
        for around in self._around[1:]:
            total, rounding = two_sum(total, high[around])
            rest += low[around]
            rest += rounding
        return two_sum(total, rest)


def exact_forces(network: Network, sigma: Array, bond_vectors: Extended) -> Array:
    """−gᵀ(σ ∘ L), (n_free, d), with the rounding of σ and of the result alone."""
    # One stress for each component: NumPy is several times slower where it repeats them in every product.
    stress = np.repeat(sigma, bond_vectors.high.shape[1]).reshape(bond_vectors.high.shape)
    pull = two_product(stress, bond_vectors.high)
    return -exact_sums(network.divergence, Extended(pull.high, pull.low + stress * bond_vectors.low))


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
