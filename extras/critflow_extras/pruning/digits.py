"""The digits of coordinates that a file has rounded, and their effect on singular values."""

from __future__ import annotations

from collections import Counter
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Doubles have 15 to 17 significant digits; with more than this number a coordinate was not rounded.
_ALL_DIGITS = 15
# Number of different coordinates of one decade that show its decimals; fewer ones may all end with zeros.
_ENOUGH = 4
# Coordinates below this part of the largest are zeros with rounding; powers of ten up to this one are numbers.
_ZERO, _LARGEST_POWER = 1e-12, 290
# Rounded coordinates change singular values of the rigidity matrix by about this number of their errors.
_MARGIN = 10.0
# Edges shorter than this part of the mean length are few, and count as that long.
_SHORT = 0.01
# Errors that would change singular values by more than this are those of grids, whose coordinates are exact.
_COARSE = 0.01
# A singular value below this number times the estimated effect of rounded coordinates may be due to them: the estimate
# is 0.7 of the largest in standard networks of 100 vertices.
FROM_ROUNDING = 6.0


class Digits(NamedTuple):
    """The digits of coordinates.

    decimals  of the largest ones, unless these are exact; negative where their last digits are zeros; None where they
              have all digits, or those of single precision
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
    """The digits of coordinates (N_v, d): a file keeps decimals, significant digits, or single precision.

    With a fixed number of decimals all decades of coordinates have the same; with significant digits each decade has
    one more than the next.  The rule that holds for more of the different coordinates counts: some are exact, such as
    those of a boundary, and show nothing.
    """
    values = np.unique(np.abs(coordinates))
    size = float(values.max(initial=0.0))
    if not size:
        return Digits(0, 0.5)
    values = values[values > _ZERO * size]
    decades = np.floor(np.log10(values)).astype(int)
    kept = {int(decade): _decimals(values[decades == decade], int(decade)) for decade in np.unique(decades)}
    counts = {decade: int(np.count_nonzero(decades == decade)) for decade in kept}
    top, enough = max(kept), [decade for decade in kept if counts[decade] >= _ENOUGH]
    if not enough:  # all together
        kept, counts, enough = {top: _decimals(values, top)}, {top: len(values)}, [top]
    fixed, significant, unrounded = Counter[int](), Counter[int](), 0
    for decade in enough:
        if (decimals := kept[decade]) is None:
            unrounded += counts[decade]
        else:
            fixed[decimals] += counts[decade]
            significant[decimals + decade] += counts[decade]
    if unrounded >= fixed.total():
        single = (coordinates == coordinates.astype(np.float32)).all()
        return Digits(None, single_precision(size) if single else 0.0)
    (decimals, same), (digits, alike) = fixed.most_common(1)[0], significant.most_common(1)[0]
    if alike > same:
        return Digits(digits - top, 0.5 * 10.0 ** (top - digits))
    # Of a single decade that is enough both rules hold: the few largest may have one decimal less.
    coarser = top not in enough and kept[top] == decimals - 1
    return Digits(decimals, 0.5 * 10.0 ** (coarser - decimals))


def _decimals(values: Array, decade: int) -> int | None:
    """Decimals of values of one decade; None where they have all digits."""
    for decimals in range(-decade, min(_ALL_DIGITS - decade, _LARGEST_POWER)):
        if np.allclose(np.round(values, decimals), values, rtol=4e-16, atol=0):
            return decimals
    return None


def single_precision(size: float) -> float:
    """Largest rounding error of coordinates up to a size in single precision."""
    return 2.0**-24 * size


def rounding_note(coordinates: Array, lengths: Array, singular_value: float) -> str:
    """A sentence where coordinates (N_v, d) have so few digits that a singular value may come from rounding them."""
    digits = digits_of(coordinates)
    if not 0 < singular_value < FROM_ROUNDING * digits.effect(lengths):
        return ""
    return (
        f"a singular value of {singular_value:.1e} may come from the coordinates, which have {digits.words}: "
        "nearest_critical(network, coordinates) restores a critical configuration that was rounded"
    )
