"""Vectors without symmetry, to start iterations from, and the lengths of many short vectors."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

_GOLDEN = 0.6180339887498949  # (√5 − 1)/2


def quasi_random(n: int) -> NDArray[np.float64]:
    """The fractional parts of i (√5 − 1)/2, i = 1…n, in [0, 1): equidistributed, without repetition or symmetry.

    Networks have symmetries, and an iteration that starts from a symmetric vector finds symmetric answers only.  A
    fixed sequence does the same as a random one, with the same result in every run.
    """
    return np.mod(_GOLDEN * np.arange(1.0, n + 1), 1.0)


def dot(one: NDArray[np.float64], other: NDArray[np.float64]) -> NDArray[np.float64]:
    """The products, (..., n), of vectors (..., n, d): axis by axis, since NumPy's sums of few terms are slow."""
    products = one * other
    total = products[..., 0]
    for axis in range(1, products.shape[-1]):
        total = total + products[..., axis]
    return np.asarray(total)


def norms(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    """|v| of each row, (n,), of vectors (n, d): the bits of `numpy.linalg.norm`."""
    return np.sqrt(dot(vectors, vectors))
