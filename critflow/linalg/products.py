"""Products of small sparse matrices, without the checks of SciPy, which take longer than the products themselves."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

# The kernels of SciPy's own product, unchanged since its first release.
from scipy.sparse._sparsetools import csc_matvec, csc_matvecs, csr_matvec, csr_matvecs

Array = NDArray[np.float64]

_KERNELS = {"csr": (csr_matvec, csr_matvecs), "csc": (csc_matvec, csc_matvecs)}


def product(matrix: sp.csr_array | sp.csc_matrix, x: Array) -> Array:
    """A x for x (n,) or (n, d) of floats: the bits of `matrix @ x`."""
    return add_product(matrix, x, np.zeros((matrix.shape[0], *x.shape[1:])))


def add_product(matrix: sp.csr_array | sp.csc_matrix, x: NDArray[Any], y: NDArray[Any]) -> NDArray[Any]:
    """y + A x in place of y (n,) or (n, d), all of the same precision."""
    rows, cols = matrix.shape
    one, several = _KERNELS[matrix.format]
    # Of a transposed array `ravel` alone takes longer than the product.
    x = np.ascontiguousarray(x)
    if x.size == cols:
        one(rows, cols, matrix.indptr, matrix.indices, matrix.data, x.ravel(), y.ravel())
    else:
        several(rows, cols, x.shape[1], matrix.indptr, matrix.indices, matrix.data, x.ravel(), y.ravel())
    return y
