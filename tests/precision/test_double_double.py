"""Extended precision against rational numbers."""

from fractions import Fraction

import numpy as np
import pytest
from rationals import DIGITS, exact, fractions

from critflow.double_double import (
    Extended,
    add,
    divide,
    less_squares,
    multiply,
    square_root,
    subtract,
    total,
    two_product,
    two_square,
    two_sum,
)


def numbers(seed: int, n: int = 200) -> np.ndarray:
    """Numbers of both signs over twelve decades."""
    rng = np.random.default_rng(seed)
    return rng.choice([-1.0, 1.0], n) * 10 ** rng.uniform(-6, 6, n)


def pairs(seed: int) -> Extended:
    """Numbers whose low parts count."""
    high = numbers(seed)
    return two_sum(high, 2.0**-54 * high * np.random.default_rng(seed + 100).uniform(-1, 1, len(high)))


@pytest.mark.parametrize("seed", range(3))
def test_sums_and_products_of_doubles_lose_nothing(seed):
    a, b = numbers(seed), numbers(seed + 10)
    near = -a * (1 + 2e-16)
    for found, expected in (
        (two_sum(a, b), fractions(a) + fractions(b)),
        (two_sum(a, near), fractions(a) + fractions(near)),
        (two_product(a, b), fractions(a) * fractions(b)),
        (two_square(a), fractions(a) ** 2),
    ):
        assert (exact(found) == expected).all()


@pytest.mark.parametrize("seed", range(3))
def test_arithmetic_keeps_thirty_digits(seed):
    a, b = pairs(seed), pairs(seed + 10)
    x, y = exact(a), exact(b)
    for found, expected, size in [
        (add(a, b), x + y, np.abs(x) + np.abs(y)),
        (subtract(a, b), x - y, np.abs(x) + np.abs(y)),
        (multiply(a, b), x * y, np.abs(x * y)),
        (divide(a, b), x / y, np.abs(x / y)),
    ]:
        assert (np.abs(exact(found) - expected) <= DIGITS * size).all()
        # High parts are the numbers rounded.
        assert (np.abs(found.low) <= np.spacing(np.abs(found.high))).all()
    positive = Extended(*(np.sign(a.high) * part for part in a))
    assert (np.abs(exact(square_root(positive)) ** 2 / exact(positive) - 1) <= 4 * DIGITS).all()


@pytest.mark.parametrize("n", [1, 2, 7, 200])
def test_sums_of_many_numbers(n):
    a = Extended(*(part[:n] for part in pairs(4)))
    (found,) = exact(total(a))
    assert abs(found - sum(exact(a))) <= DIGITS * sum(np.abs(exact(a)))


@pytest.mark.parametrize("extension", [1e-3, 1e-9, 1e-15])
def test_differences_of_squares_keep_the_digits_of_small_extensions(extension):
    vectors = pairs(5)
    v = Extended(vectors.high.reshape(-1, 2), vectors.low.reshape(-1, 2))
    lengths = np.linalg.norm(v.high, axis=1) * (1 - extension)
    expected = np.sum(exact(v) ** 2, axis=1) - fractions(lengths) ** 2
    found = fractions(less_squares(v, two_square(lengths)))
    # One rounding of the result, and 30 digits of the squares that cancel in it.
    assert (np.abs(found - expected) <= Fraction(1, 2**52) * np.abs(expected) + DIGITS * fractions(lengths) ** 2).all()
