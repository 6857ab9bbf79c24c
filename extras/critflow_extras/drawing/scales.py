"""Whether values differ, so that colours show them, and by how much."""

from __future__ import annotations

from critflow.networks import Array

# Values that differ by less than this part of the largest are equal; beyond this ratio their logarithm is shown.
_EQUAL, _WIDE = 1e-6, 10.0


def varied(values: Array) -> bool:
    """Whether positive values (n,) differ by more than rounding."""
    return bool(values.size and values.max() > (1 + _EQUAL) * values.min())


def widely(values: Array) -> bool:
    """Whether positive values (n,) differ so much that colours show their logarithm."""
    return bool(values.max() > _WIDE * values.min())
