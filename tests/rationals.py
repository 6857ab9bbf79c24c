"""Numbers in extended precision as rational numbers."""

from fractions import Fraction

import numpy as np

# 2⁻¹⁰⁰: 30 digits, a few roundings of 32 digits.
DIGITS = Fraction(1, 2**100)
# Exact: sums and products of doubles are asserted without rounding.
fractions = np.vectorize(Fraction, otypes=[object])


def exact(a) -> np.ndarray:
    """The sum of the two parts of each number."""
    return fractions(a.high) + fractions(a.low)
