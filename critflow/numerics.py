"""Many short vectors: lengths, dot products, products with sparse matrices; units, and read-only arrays.

Products with sparse matrices leave out the checks of SciPy, which take longer than the products themselves.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.sparse._sparsetools import csc_matvec, csc_matvecs, csr_matvec, csr_matvecs

from critflow.arguments import Array

# Relative spacing of doubles, 2⁻⁵².  A pivot below n EPS of the largest is as good as zero: rounding of the
# elimination makes pivots of that size.
EPS = float(np.finfo(float).eps)
LARGEST_DENSE = 20_000_000  # largest number of entries of a dense array made in physics: 160 MB


def quasi_random(n: int) -> Array:
    """The fractional parts of i (√5 − 1)/2, i = 1…n, in [0, 1): equidistributed, without repetition or symmetry.

    Networks have symmetries, and an iteration that starts from a symmetric vector finds symmetric answers only.  A
    fixed sequence does the same as a random one, with the same result in every run.
    """
    return np.mod(0.6180339887498949 * np.arange(1.0, n + 1), 1.0)


def dot(one: Array, other: Array) -> Array:
    """The products, (..., n), of vectors (..., n, d): axis by axis, since NumPy's sums of few terms are slow."""
    products = one * other
    total = products[..., 0]
    for axis in range(1, products.shape[-1]):
        total = total + products[..., axis]
    return np.asarray(total)


def norms(vectors: Array) -> Array:
    """|v| of each row, (n,), of vectors (n, d): the bits of `numpy.linalg.norm`."""
    return np.sqrt(dot(vectors, vectors))


def largest(values: Array) -> float:
    """The largest size of all numbers, NaN with one that is; 0 without any."""
    return float(np.maximum.reduce(np.abs(values), axis=None, initial=0.0))


def mean(values: Array) -> float:
    """The mean of numbers (n,): the bits of `numpy.mean`."""
    return float(np.add.reduce(values) / values.size)


def power_of_two(size: float, step: int = 1) -> float:
    """The power of two nearest a size > 0, as a unit: products with it are exact; `step` of its exponents."""
    return float(2.0 ** (step * np.round(np.log2(size) / step)))


def read_only(array: Array) -> Array:
    """The array, to which nobody can write."""
    array.flags.writeable = False
    return array


def restore_read_only(record: object, state: dict[str, Any]) -> None:
    """Attributes of a frozen record from those of a copy, whose arrays may be written to; for `__setstate__`."""
    for value in state.values():
        if isinstance(value, np.ndarray):
            value.flags.writeable = False
    record.__dict__.update(state)


def set_read_only(record: object, *names: str) -> None:
    """Replace arrays of a frozen record, of these names, by views that nobody can write to; for `__post_init__`."""
    for name in names:
        array = getattr(record, name)
        if isinstance(array, np.ndarray) and array.flags.writeable:
            array = array.view()
            array.flags.writeable = False
            object.__setattr__(record, name, array)


KERNELS = {"csr": (csr_matvec, csr_matvecs), "csc": (csc_matvec, csc_matvecs)}


def product(matrix: sp.csr_array | sp.csc_matrix, x: Array) -> Array:
    """A x for x (n,) or (n, d) of floats: the bits of `matrix @ x`."""
    y = np.zeros((matrix.shape[0], *x.shape[1:]))
    KERNELS[matrix.format][x.ndim - 1](len(y), *x.shape, matrix.indptr, matrix.indices, matrix.data, x, y)
    return y


def symmetric_product(upper: sp.csc_matrix, x: Array) -> Array:
    """A x of the symmetric A with this upper triangle, x (n,) or (n, d) of floats; the diagonal ends each column."""
    above, below = np.zeros(x.shape), np.zeros(x.shape)
    # The rows of the transpose are the columns.
    for kind, y in (("csc", above), ("csr", below)):
        KERNELS[kind][x.ndim - 1](len(y), *x.shape, upper.indptr, upper.indices, upper.data, x, y)
    return above + below - (upper.data[upper.indptr[1:] - 1] * x.T).T
