"""Vectors and their sizes: the quasi-random vector, norms, and the nearest power of two."""

import numpy as np

from critflow.numerics import norms, power_of_two, quasi_random


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
