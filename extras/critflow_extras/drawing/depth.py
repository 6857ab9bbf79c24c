"""Periodic networks of three dimensions in parallel projection."""

from __future__ import annotations

from itertools import product

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import Normalize, to_rgb
from numpy.typing import ArrayLike

from critflow.networks import Array
from critflow.pictures import COMPRESSED, TENSION_MAP

# Directions of view on three dimensions, across and up, at right angles: from the front, a little from above.
_ACROSS, _UP = np.array([0.94, -0.34, 0.0]), np.array([0.09, 0.25, 0.96])


def draw_in_depth(
    axes: Axes,
    edges: ArrayLike,
    offsets: ArrayLike,
    cell: ArrayLike,
    coordinates: ArrayLike,
    tensions: Array,
    scale: Normalize | None = None,
) -> ScalarMappable:
    """Draw a periodic network of three dimensions in parallel projection, near edges over far ones, which fade.

    scale  of the colours; from zero to the 97th percentile by default

    Colour and width show the tension as in two dimensions.  Every edge is drawn once, from the image of its tail in the
    cell to its head, inside or outside.  Returns the mappable for a colour bar.
    """
    (tail, head), x, cell = np.asarray(edges).T, np.asarray(coordinates), np.asarray(cell, dtype=float)
    fraction = x[tail] @ np.linalg.inv(cell)
    start = (fraction - np.floor(fraction)) @ cell
    ends = np.stack([start, start + x[head] - x[tail] + np.asarray(offsets) @ cell], axis=1)
    view = np.stack([_ACROSS, _UP], axis=1)
    depth = ends.mean(axis=1) @ np.cross(_ACROSS, _UP)
    far, close = np.percentile(depth, (2, 98))
    near = np.clip((depth - far) / (close - far), 0, 1)
    norm = scale or Normalize(0.0, float(np.percentile(np.abs(tensions), 97)) or 1.0, clip=True)
    strength = np.asarray(norm(np.abs(tensions)))
    ink = np.where((tensions < 0)[:, None], to_rgb(COMPRESSED), TENSION_MAP(strength)[:, :3])
    faded = 1 - (0.15 + 0.85 * near**1.5)[:, None] * (1 - ink)
    widths = (0.4 + 1.8 * strength) * (0.45 + 0.55 * near)
    order = np.argsort(depth, kind="stable")
    axes.add_collection(
        LineCollection(list((ends @ view)[order]), colors=faded[order], linewidths=widths[order], capstyle="round")
    )
    corners = np.array(list(product((0, 1), repeat=3)))
    sides = [(a, b) for a in range(8) for b in range(a) if np.abs(corners[a] - corners[b]).sum() == 1]
    frame = corners @ cell @ view
    axes.add_collection(LineCollection(list(frame[np.array(sides)]), colors="0.55", linewidths=0.7, zorder=0))
    for name, place in zip("xyz", ((0.5, 0, 0), (0, 0.5, 0), (0, 1, 0.5)), strict=True):
        label = frame.mean(axis=0) + 1.16 * (np.array(place) @ cell @ view - frame.mean(axis=0))
        axes.text(label[0], label[1], f"${name}$", fontsize=11, ha="center", va="center", color="0.35")
    axes.autoscale_view()
    axes.set_aspect("equal")
    axes.set_axis_off()
    return ScalarMappable(norm, TENSION_MAP)
