"""Extended precision: numbers as unevaluated sums of two doubles, for residuals of which no digit may be lost.

A residual is a difference of nearly equal terms, so in working precision it is mostly rounding.  With 32 digits it says
how far a solution really is from the exact one, P δ = r, and refinement then converges to all digits that doubles hold
(Wilkinson; Dekker, 1971).  Every function is a fixed number of plain operations on arrays, the same on any processor.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from critflow.networks.network import Array, Network


class Extended(NamedTuple):
    """An array of numbers high + low, with |low| at most half a rounding of high."""

    high: Array
    low: Array


def extended(values: Array) -> Extended:
    """Doubles as they are."""
    return Extended(values, np.zeros_like(values))


def two_sum(a: Array, b: Array) -> Extended:
    """a + b exactly (Knuth)."""
    total = a + b
    part = total - a
    return Extended(total, (a - (total - part)) + (b - part))


def two_product(a: Array, b: Array) -> Extended:
    """a b exactly, within the range 1e-290 to 1e290 of doubles (Dekker, Veltkamp)."""
    product = a * b
    (a_high, a_low), (b_high, b_low) = _halves(a), _halves(b)
    return Extended(product, ((a_high * b_high - product) + a_high * b_low + a_low * b_high) + a_low * b_low)


def _halves(a: Array) -> tuple[Array, Array]:
    scaled = 134217729.0 * a  # 2²⁷ + 1
    high = scaled - (scaled - a)
    return high, a - high


def add(a: Extended, b: Extended) -> Extended:
    """a + b to about 32 digits of the larger."""
    total, rest = two_sum(a.high, b.high)
    low, lower = two_sum(a.low, b.low)
    total, rest = _fast_two_sum(total, rest + low)
    return _fast_two_sum(total, rest + lower)


def subtract(a: Extended, b: Extended) -> Extended:
    """a − b to about 32 digits of the larger."""
    return add(a, Extended(-b.high, -b.low))


def multiply(a: Extended, b: Extended) -> Extended:
    """a b to about 31 digits."""
    product, rest = two_product(a.high, b.high)
    return _fast_two_sum(product, rest + (a.high * b.low + a.low * b.high))


def divide(a: Extended, b: Extended) -> Extended:
    """a/b to about 31 digits."""
    quotient = a.high / b.high
    rest = subtract(a, multiply(extended(quotient), b))
    return _fast_two_sum(quotient, rest.high / b.high)


def square_root(a: Extended) -> Extended:
    """√a to about 31 digits, for a > 0."""
    root = np.sqrt(a.high)
    rest = subtract(a, two_product(root, root))
    return _fast_two_sum(root, rest.high / (2 * root))


def _fast_two_sum(a: Array, b: Array) -> Extended:
    """a + b exactly where |a| ≥ |b|."""
    total = a + b
    return Extended(total, b - (total - a))


class ExtendedGeometry:
    """Bond vectors L = g x + b, their lengths, and sums of edge forces, in extended precision, for one graph."""

    def __init__(self, network: Network):
        free = network.free
        index = np.full(network.n_vertices, -1)
        index[free] = np.arange(len(free))
        # A fixed vertex adds what stands in the boundary vectors already; it reads the zero after the last one.
        self._tail, self._head = index[network.edges].T
        # An edge to its own image pulls at nothing; its two forces would cancel only to rounding.
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
        high = np.concatenate([x.high, zero])
        ends, rest = two_sum(high[self._head], -high[self._tail])
        total, low = two_sum(ends, b)
        low += rest
        if x.low.any():
            shift = np.concatenate([x.low, zero])
            low += shift[self._head] - shift[self._tail]
        return two_sum(total, low)

    def divergence(self, edge_vectors: Extended) -> Extended:
        """gᵀ v over the free vertices, (n_free, d), of edge vectors v (N_b, d), to 32 digits of those."""
        zero = np.zeros((1, edge_vectors.high.shape[1]))
        high = np.concatenate([-edge_vectors.high, edge_vectors.high, zero])
        low = np.concatenate([-edge_vectors.low, edge_vectors.low, zero])
        total, rest = high[self._around[0]], low[self._around[0]]
        for around in self._around[1:]:
            total, lost = two_sum(total, high[around])
            rest += low[around]
            rest += lost
        return two_sum(total, rest)


def lengths(vectors: Extended) -> Extended:
    """|v|, (n,), of vectors (n, d)."""
    square = multiply(vectors, vectors)
    total = Extended(square.high[:, 0], square.low[:, 0])
    for axis in range(1, vectors.high.shape[1]):
        total = add(total, Extended(square.high[:, axis], square.low[:, axis]))
    return square_root(total)


def total(a: Extended) -> tuple[float, float]:
    """Σ a, of numbers (n,), as high and low, to 31 digits of the sum of their sizes."""
    while len(a.high) > 1:
        half = len(a.high) // 2
        rest = Extended(a.high[2 * half :], a.low[2 * half :])
        paired = add(Extended(a.high[:half], a.low[:half]), Extended(a.high[half : 2 * half], a.low[half : 2 * half]))
        a = Extended(np.concatenate([paired.high, rest.high]), np.concatenate([paired.low, rest.low]))
    return float(a.high.sum()), float(a.low.sum())
