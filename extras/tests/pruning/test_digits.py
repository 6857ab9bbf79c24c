"""Digits of coordinates: decimals, significant digits and single precision as files have them, and exact grids."""

import numpy as np
import pytest

from critflow_extras.pruning.digits import digits_of

X = np.random.default_rng(3).uniform(-14, 14, (50, 2))
X[0] = 0.00123456789, 14.0


def printed(form):
    return np.array([[float(form % value) for value in row] for row in X])


@pytest.mark.parametrize(
    ("form", "decimals", "error"),
    [("%.6f", 6, 5e-7), ("%.3f", 3, 5e-4), ("%.6g", 4, 5e-5), ("%.8e", 7, 5e-8), ("%.0f", 0, 0.5)],
)
def test_decimals_are_those_of_the_largest_coordinates(form, decimals, error):
    digits = digits_of(printed(form))
    assert (digits.decimals, digits.error) == (decimals, pytest.approx(error))
    assert np.abs(printed(form) - X).max() <= error
    # Relative to lengths as short as on a grid, digits are no rounding.
    assert digits.effect(np.full(3, 10 * error / 0.011)) == 0
    assert digits.effect(np.full(3, 10 * error / 0.009)) == pytest.approx(0.009)


def test_single_precision_and_all_digits():
    assert digits_of(X.astype(np.float32).astype(float)) == (None, pytest.approx(2.0**-24 * 14))
    assert digits_of(X) == (None, 0.0)
    assert digits_of(printed("%.17g")).error == 0
    assert digits_of(X).effect(np.ones(3)) == 0


def test_doubles_of_large_coordinates_have_all_digits():
    # Round to 14 decimals they hardly change: a double near 20 has no more.
    X = 1 + 19 * np.random.default_rng(0).random((9, 2))
    assert digits_of(X) == (None, 0.0) and digits_of(np.round(X, 12)).decimals == 12
    assert digits_of(np.array([[20 / 3, 10 * 3**0.5], [5.0, 0.5]])).decimals is None


def test_large_numbers_of_few_digits_are_known_to_their_last_one():
    digits = digits_of(np.vectorize(lambda value: float(f"{value:.3e}"))(1e8 * X))
    assert digits == (-6, 5e5) and "1e6" in digits.words
    assert digits.effect(np.full(3, 1e10)) == pytest.approx(5e-4)
    # Named by the user, even coarse digits are no grid.
    assert digits.effect(np.full(3, 1e8), grids=False) == pytest.approx(0.05) and digits.effect(np.full(3, 1e8)) == 0


@pytest.mark.parametrize("digits", [3, 5, 8])
def test_a_few_largest_numbers_may_have_one_decimal_less(digits):
    exact = np.random.default_rng(0).uniform(2e5, 9e5, (20, 2))
    exact[0] = 1234567.891, 1098765.432
    rounded = np.vectorize(lambda value: float(f"{value:.{digits}e}"))(exact)
    assert np.abs(rounded - exact).max() <= digits_of(rounded).error == 0.5 * 10.0 ** (6 - digits)
    assert digits_of(np.round(exact, 1)) == (1, 0.05)


def test_exact_coordinates_show_nothing_of_the_others():
    """Boundaries of a box, pins on a grid and a few large values: decimals are those of most coordinates."""
    rng = np.random.default_rng(2)
    for size in (0.7, 9.9, 10.0, 12.0, 110.0):
        for decimals in (2, 5, 8):
            x = np.round(size * rng.random((80, 2)), decimals)
            x[:10, 0], x[10:20, 1], x[20:23] = size, 0.0, np.round(0.5 * size, 1)
            assert digits_of(x) == (decimals, pytest.approx(0.5 * 10.0**-decimals)), (size, decimals)
    # Significant digits that span decades, with exact ones among the largest
    for size in (0.7, 9.9, 12.0, 110.0):
        x = np.vectorize(lambda value: float(f"{value:.5e}"))(size * rng.random((300, 2)))
        exact = 0.5 * 10.0 ** (np.floor(np.log10(size)) - 5)
        assert digits_of(x).error == pytest.approx(exact)
    assert digits_of(np.zeros((3, 2))) == (0, 0.5)
    assert digits_of(1e-300 * rng.random((30, 2))).error == 0
