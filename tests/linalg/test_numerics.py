"""Many short vectors: products without the checks of SciPy, the quasi-random vector, norms, powers of two."""

import numpy as np
import pytest
import scipy.sparse as sp

from critflow.numerics import norms, power_of_two, product, quasi_random, symmetric_product

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


@pytest.mark.parametrize("layout", LAYOUTS)
def test_products_of_a_symmetric_matrix_need_its_upper_triangle(layout):
    upper, x = sp.csc_matrix(sp.triu(MATRIX[:5] + MATRIX[:5].T + sp.eye_array(5))), LAYOUTS[layout]
    whole = upper.toarray() + np.triu(upper.toarray(), 1).T
    np.testing.assert_allclose(symmetric_product(upper, x), whole @ x, rtol=1e-14)


def test_no_value_repeats_and_no_symmetry_maps_it_to_itself():
    values = quasi_random(10_000)
    assert ((values >= 0) & (values < 1)).all()
    gaps = np.diff(np.sort(values))
    # Of all sequences i c mod 1 the golden section leaves the most even gaps; those of random numbers go to 0 and 10/n.
    assert 0.5 / 10_000 < gaps.min() and gaps.max() < 2 / 10_000
    for shift in range(1, 50):
        assert not np.isclose(values, np.roll(values, shift)).any()
    assert not np.isclose(values, values[::-1]).all()
    np.testing.assert_array_equal(values[:100], quasi_random(100))
    assert abs(values[0] - 0.618034) < 1e-6


def test_norms_have_the_bits_of_numpy():
    for dimension in (1, 2, 3):
        vectors = np.random.default_rng(dimension).standard_normal((50, dimension))
        np.testing.assert_array_equal(norms(vectors), np.linalg.norm(vectors, axis=1))


def test_the_nearest_power_of_two_with_a_step_of_its_exponents():
    for step, sizes in ((1, {0.7: 0.5, 0.72: 1.0, 3.0: 4.0}), (8, {15.0: 1.0, 17.0: 256.0, 0.07: 1.0, 0.06: 2.0**-8})):
        assert {size: power_of_two(size, step) for size in sizes} == sizes
