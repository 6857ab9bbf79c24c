"""Sums of lengths in extended precision, such as perimeters."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from critflow.double_double import Extended
from critflow.networks import Array
from critflow.numerics import product
from critflow.refinement import leading_half


def exact_sums(matrix: sp.csr_array, vectors: Extended, less: Array | float = 0.0) -> Array:
    """A v − w for a sparse A, its terms cancelling without loss.

    The leading halves of A and v lie on grids on which their products and sums are exact; the remainder is
    smaller by 2⁻²⁵, and so is its rounding.
    """
    leading = leading_half(vectors.high)
    small = product(matrix, (vectors.high - leading) + vectors.low)
    coarse = leading_half(matrix.data)
    if not np.array_equal(coarse, matrix.data):
        small = small + sp.csr_array((matrix.data - coarse, matrix.indices, matrix.indptr), matrix.shape) @ leading
        matrix = sp.csr_array((coarse, matrix.indices, matrix.indptr), matrix.shape)
    return np.asarray((product(matrix, leading) - less) + small)
