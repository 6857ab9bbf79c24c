"""Networks and distributions as matplotlib figures, from arrays; no physics is computed here.

Periodic networks are drawn whole: every edge is repeated in all images that touch the cell and cut at its border.
Tension is shown by colour (a map for all kinds of colour vision and for grey print) and by width.
"""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import Colormap, LinearSegmentedColormap, Normalize
from matplotlib.patches import Polygon
from numpy.typing import ArrayLike

from critflow.figures.shades import TENSION_COLOURS
from critflow.networks.network import Array, IntArray
from critflow.networks.periodic_cell import images_in_cell

# Okabe and Ito's colours, distinct for all common kinds of colour vision.
COLOURS = ("#0072B2", "#56B4E9", "#D55E00", "#009E73", "#E69F00", "#CC79A7", "#7F7F7F")
COMPRESSED = "#D55E00"
SLACK = "#BBBBBB"
# Corners of a periodic cell, in its units.
CORNERS = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])

TENSION_MAP: Colormap = LinearSegmentedColormap.from_list("tension", TENSION_COLOURS)


def unit_pressure_tensions(sigma: Array, lengths: Array, volume: float) -> Array:
    """Tensions τ = σ|L| scaled so that the pressure Σσ|L|²/(2V) is one (`Networks`), (N_b,)."""
    return sigma * lengths * (2 * volume / float(sigma @ lengths**2))


def draw_network(
    axes: Axes,
    edges: ArrayLike,
    offsets: ArrayLike,
    cell: ArrayLike,
    coordinates: ArrayLike,
    tensions: Array | None = None,
    *,
    limits: tuple[float, float] | None = None,
    width: float = 1.0,
) -> LineCollection:
    """Draw a periodic network once and whole, edges coloured by tension as `add_edges` describes.

    Many parameters: figures read the arrays of a network from files, so each is an argument.

    limits  tensions of the light and dark ends of the colour map; by default 0 and the 99th percentile
    """
    segments, edge = periodic_segments(edges, offsets, cell, coordinates)
    values = np.ones(len(np.asarray(edges))) if tensions is None else np.asarray(tensions)
    outline = add_cell(axes, cell)
    return add_edges(axes, segments, values[edge], limits or colour_limits(values), outline, width=width)


def colour_limits(tensions: Array) -> tuple[float, float]:
    """0 and the 99th percentile of the tensions: the ends of the colour map."""
    return 0.0, float(np.percentile(np.abs(tensions), 99)) or 1.0


def add_edges(
    axes: Axes,
    segments: Array,
    tensions: Array,
    limits: tuple[float, float] | Normalize,
    outline: Polygon | None = None,
    *,
    width: float = 1.0,
    cmap: str | Colormap = TENSION_MAP,
) -> LineCollection:
    """Add segments (n, 2, 2) with tensions (n,), cut at an outline, and return those in tension, for a colour bar.

    limits  tensions of the light and dark ends of the colour map, or the scale between them

    Tension is shown by colour and width; compressed edges are orange and dashed, slack ones thin and grey below.
    """
    norm = limits if isinstance(limits, Normalize) else Normalize(*limits, clip=True)
    order = np.argsort(tensions, kind="stable")
    segments, strength = segments[order], tensions[order]
    slack, compressed, tense = strength == 0, strength < 0, strength > 0
    widths = width * (0.45 + 1.1 * np.asarray(norm(np.abs(strength))))
    lines = LineCollection(list(segments[tense]), cmap=cmap, norm=norm, capstyle="round")
    # The constructor would distribute widths three times.
    lines.set_linewidth(widths[tense].tolist())
    lines.set_array(strength[tense])
    thick = np.maximum(widths[compressed], width)
    collections = [
        lines,
        LineCollection(list(segments[compressed]), colors=COMPRESSED, linewidths=thick, linestyles=(0, (2, 1))),
    ]
    if slack.any():
        collections.append(LineCollection(list(segments[slack]), colors=SLACK, linewidths=0.5 * width, zorder=1))
    for collection in collections:
        axes.add_collection(collection)
        if outline is not None:
            collection.set_clip_path(outline)
    return lines


def add_cell(axes: Axes, cell: ArrayLike) -> Polygon:
    """Add the outline of a periodic cell, set the limits of the axes to it, and hide the axes."""
    corners = CORNERS @ np.asarray(cell)
    outline = Polygon(corners, closed=True, fill=False, edgecolor="0.6", linewidth=0.6)
    axes.add_patch(outline)
    margin = 0.01 * np.ptp(corners, axis=0)
    axes.set_xlim(corners[:, 0].min() - margin[0], corners[:, 0].max() + margin[0])
    axes.set_ylim(corners[:, 1].min() - margin[1], corners[:, 1].max() + margin[1])
    axes.set_aspect("equal")
    axes.set_axis_off()
    return outline


def periodic_segments(
    edges: ArrayLike, offsets: ArrayLike, cell: ArrayLike, coordinates: ArrayLike
) -> tuple[Array, IntArray]:
    """All images of the edges that touch the cell: end points (n, 2, 2), and the edge of each (n,)."""
    edges, offsets, cell = np.asarray(edges), np.asarray(offsets), np.asarray(cell, dtype=float)
    tail, head = (np.asarray(coordinates) @ np.linalg.inv(cell))[edges.T]
    segments, owners = images_in_cell(np.stack([tail, head + offsets], axis=1))
    return segments @ cell, owners
