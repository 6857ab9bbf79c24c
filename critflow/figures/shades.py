"""Where edges are shown by their stiffness, and how: also for drawings that are made without matplotlib."""

from __future__ import annotations

from critflow.networks.network import Array

TENSION_COLOURS = ("#b8d4ea", "#4f93c4", "#1c4f86", "#0b1530")
"""From a light to a dark blue-black, so that strong edges stand out on white and print in grey."""

# Values that differ by less than this part of the largest are equal; beyond this ratio their logarithm is shown.
_EQUAL, _WIDE = 1e-6, 10.0


def varied(values: Array) -> bool:
    """Whether positive values (n,) differ by more than rounding."""
    return bool(values.size and values.max() > (1 + _EQUAL) * values.min())


def widely(values: Array) -> bool:
    """Whether positive values (n,) differ so much that colours show their logarithm."""
    return bool(values.max() > _WIDE * values.min())
