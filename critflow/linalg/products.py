"""Products of small sparse matrices, without the checks of SciPy, which take longer than the products themselves."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

# The kernels of SciPy's own product, unchanged since its first release.
from scipy.sparse._sparsetools import csr_matvec, csr_matvecs

Array = NDArray[np.float64]


def product(matrix: sp.csr_array, x: Array) -> Array:
    """A x for x (n,) or (n, d) of floats: the bits of `matrix @ x`."""
    rows, cols = matrix.shape
    y = np.zeros((rows, *x.shape[1:]))
    if x.ndim == 1:
        csr_matvec(rows, cols, matrix.indptr, matrix.indices, matrix.data, np.ascontiguousarray(x), y)
    else:
        csr_matvecs(rows, cols, x.shape[1], matrix.indptr, matrix.indices, matrix.data, x.ravel(), y.ravel())
    return y
