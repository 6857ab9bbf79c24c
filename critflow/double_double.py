"""Double-double arithmetic: numbers as unevaluated sums of two doubles, with about 32 digits.

A residual is a difference of nearly equal terms, so in working precision it is mostly rounding.  With 32 digits it is
the distance of a solution from the exact one, P δ = r, and refinement converges to all digits of a double (Wilkinson;
Dekker, 1971).  Every function is a fixed number of plain operations on arrays, the same on any processor.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from critflow.arguments import Array, IntArray


class Extended(NamedTuple):
    """An array of numbers high + low, with |low| at most half a rounding of high."""

    high: Array
    low: Array


def extended(values: Array) -> Extended:
    """Doubles, with low parts of zero."""
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


def two_square(a: Array) -> Extended:
    """a² exactly, as `two_product`."""
    square = a * a
    high, low = _halves(a)
    cross = high * low
    return Extended(square, ((high * high - square) + 2 * cross) + low * low)


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


def dot(a: Extended, b: Extended) -> Extended:
    """a·b of each row, (n,), of vectors (n, d)."""
    product = multiply(a, b)
    result = part(product, (..., 0))
    for axis in range(1, product.high.shape[1]):
        result = add(result, part(product, (..., axis)))
    return result


def less_squares(vectors: Extended, squares: Extended) -> Array:
    """|v|² − q, (n,), rounded once but for 1e-31 |v|², of vectors (n, d) and numbers q (n,) of the same size."""
    square, rest = two_square(vectors.high)
    rest += 2 * vectors.high * vectors.low
    result, error = -squares.high, -squares.low
    for axis in range(square.shape[1]):
        result, rounding = two_sum(result, square[:, axis])
        error += rounding
        error += rest[:, axis]
    return result + error


def lengths(vectors: Extended) -> Extended:
    """|v|, (n,), of vectors (n, d)."""
    return square_root(dot(vectors, vectors))


def scaled(factors: Extended, vectors: Extended) -> Extended:
    """Rows of vectors (n, d) times factors (n,)."""
    return multiply(Extended(factors.high[:, None], factors.low[:, None]), vectors)


def total(values: Extended) -> Extended:
    """Σ values, of numbers (n,), in pairs, as an array (1,); to 31 digits of the sum of their sizes."""
    while len(values.high) > 1:
        half = len(values.high) // 2
        odd = part(values, slice(2 * half, None))
        values = add(part(values, slice(half)), part(values, slice(half, 2 * half)))
        values = Extended(np.append(values.high, odd.high), np.append(values.low, odd.low))
    return values


def part(values: Extended, index: Any) -> Extended:
    """values[index]."""
    return Extended(values.high[index], values.low[index])


def edge_differences(tail: IntArray, head: IntArray, x: Extended, b: Array) -> Extended:
    """L_α = x_head − x_tail + b_α, (N_b, d), of coordinates x (n, d), to 32 digits of those."""
    ends, rest = two_sum(x.high.take(head, 0), -x.high.take(tail, 0))
    high, low = two_sum(ends, b)
    low += rest
    if x.low.any():
        low += x.low.take(head, 0) - x.low.take(tail, 0)
    return two_sum(high, low)
