"""The digits of coordinates that a file has rounded, and their effect on singular values."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Doubles have 15 to 17 significant digits; with this number of decimals a coordinate was not rounded.
_ALL_DECIMALS = 15
# Number of coordinates as large as the largest that show its decimals, which are the fewest where a file has a fixed
# number of significant digits; fewer ones may all end with zeros.
_ENOUGH = 4
# Rounded coordinates change singular values of the rigidity matrix by about this number of their errors.
_MARGIN = 10.0
# Edges shorter than this part of the mean length are few, and count as that long.
_SHORT = 0.01
# Errors that would change singular values by more than this are those of grids, whose coordinates are exact.
_COARSE = 0.01


class Digits(NamedTuple):
    """The digits of coordinates.

    decimals  of the largest ones, negative where their last digits are zeros; None where they have all digits, or those
              of single precision
    error     largest rounding error; 0 with all digits
    """

    decimals: int | None
    error: float

    @property
    def words(self) -> str:
        """For a sentence: coordinates have ..."""
        if self.decimals is None:
            return "single precision"
        if self.decimals < 0:
            return f"digits down to 1e{-self.decimals} only"
        return f"{self.decimals} decimal{'' if self.decimals == 1 else 's'}"

    def effect(self, lengths: Array, grids: bool = True) -> float:
        """Singular values that the rounding of coordinates may cause; 0 with all digits and, if allowed, for grids.

        Error bound (estimate): ten times the root mean square of the error over the lengths, which short edges raise.
        """
        inverse = 1 / np.maximum(lengths, _SHORT * float(lengths.mean()))
        changed = _MARGIN * self.error * float(np.sqrt(np.mean(inverse**2)))
        return 0.0 if grids and changed > _COARSE else changed


def digits_of(coordinates: Array) -> Digits:
    """The digits of coordinates (N_v, d): a file keeps decimals, significant digits, or single precision."""
    size = float(np.abs(coordinates).max(initial=0.0))
    decade = 10.0 ** np.floor(np.log10(size)) if size else 0.0
    large = largest = coordinates[np.abs(coordinates) >= decade]
    if large.size < _ENOUGH:
        large = coordinates[np.abs(coordinates) >= 0.1 * decade]
    # Of large coordinates doubles keep fewer decimals.
    whole = max(0, int(np.floor(np.log10(size)))) if size else 0
    # Negative decimals are those of large numbers of few digits, such as 1.234e9.
    for decimals in range(-whole, _ALL_DECIMALS - whole):
        if _has_decimals(large, decimals):
            # With a fixed number of significant digits the few largest have one decimal less than the others.
            coarser = large.size > largest.size and _has_decimals(largest, decimals - 1)
            return Digits(decimals, 0.5 * 10.0 ** (coarser - decimals))
    if (large == large.astype(np.float32)).all():
        return Digits(None, single_precision(size))
    return Digits(None, 0.0)


def _has_decimals(values: Array, decimals: int) -> bool:
    return np.allclose(np.round(values, decimals), values, rtol=4e-16, atol=0)


def single_precision(size: float) -> float:
    """Largest rounding error of coordinates up to a size in single precision."""
    return 2.0**-24 * size
