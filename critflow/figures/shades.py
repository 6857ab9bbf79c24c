"""Where edges are shown by their stiffness, and how: also for drawings that are made without matplotlib."""

from __future__ import annotations

import numpy as np

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


def strengths(values: Array) -> Array:
    """The place of positive values (n,) between the light and the dark end of the colours, from 0 to 1."""
    if not widely(values):
        return np.asarray(values / values.max())
    low, high = np.log([values.min(), values.max()])
    return np.asarray((np.log(values) - low) / (high - low))


def hexadecimal(strength: float) -> str:
    """The colour of a place from 0 to 1, interpolated between `TENSION_COLOURS`."""
    ends = np.array([[int(colour[n : n + 2], 16) for n in (1, 3, 5)] for colour in TENSION_COLOURS])
    place = np.linspace(0, 1, len(ends))
    red, green, blue = (round(float(np.interp(strength, place, channel))) for channel in ends.T)
    return f"#{red:02x}{green:02x}{blue:02x}"
