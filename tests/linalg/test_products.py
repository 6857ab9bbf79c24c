"""Products without the checks of SciPy: matrices by rows and by columns, any layout of the vectors."""

import numpy as np
import pytest
import scipy.sparse as sp

from critflow.numerics import product

MATRIX = sp.csr_array(sp.random_array((7, 5), density=0.5, rng=1))
VECTORS = np.random.default_rng(1).random((10, 6))
LAYOUTS = {
    "one": VECTORS[:5, 0].copy(),
    "strided": VECTORS[::2, 0],
    "several": VECTORS[:5].copy(),
    "columns": np.asfortranarray(VECTORS[:5]),
    "parts": VECTORS[::2, ::2],
}


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("matrix", [MATRIX, sp.csc_array(MATRIX), sp.csr_array(MATRIX.T).T], ids=("csr", "csc", "T"))
def test_products_are_those_of_scipy(matrix, layout):
    x = LAYOUTS[layout]
    np.testing.assert_array_equal(product(matrix, x), matrix @ x)
