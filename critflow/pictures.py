"""Networks and distributions as matplotlib figures, from arrays; no physics is computed here.

Periodic networks are drawn whole: every edge is repeated in all images that touch the cell and cut at its border.
Tension is shown by colour (a map for all kinds of colour vision and for grey print) and by width.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import reduce
from itertools import product

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import Colormap, LinearSegmentedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Polygon
from numpy.typing import ArrayLike

from critflow.extensions import from_extras
from critflow.faces import Faces
from critflow.networks import Array, IntArray

TENSION_COLOURS = ("#b8d4ea", "#4f93c4", "#1c4f86", "#0b1530")
"""From a light to a dark blue-black, so that strong edges stand out on white and print in grey."""

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


def network_figure(
    edges: ArrayLike,
    offsets: ArrayLike,
    cell: ArrayLike,
    coordinates: ArrayLike,
    sigma: Array,
    lengths: Array,
    title: str = "",
) -> Figure:
    """A figure of one network with a colour bar of the tensions at unit pressure; 3D networks in projection."""
    tensions = unit_pressure_tensions(sigma, lengths, float(abs(np.linalg.det(np.asarray(cell)))))
    figure = Figure(figsize=(6.2, 5.4), layout="constrained")
    axes = figure.add_subplot()
    if np.shape(coordinates)[1] == 3:
        draw_in_depth = from_extras("draw_in_depth", "drawings in space", counts=False)
        lines: ScalarMappable = draw_in_depth(axes, edges, offsets, cell, coordinates, tensions)
    else:
        lines = draw_network(axes, edges, offsets, cell, coordinates, tensions, width=1.6)
    bar = figure.colorbar(lines, ax=axes, shrink=0.8, pad=0.02)
    bar.set_label("edge tension τ at unit pressure")
    if (tensions < 0).any():
        axes.plot([], [], color=COMPRESSED, linestyle=(0, (2, 1)), label="compressed")
        axes.legend(loc="upper left", fontsize=8, frameon=True)
    axes.set_title(title, fontsize=10)
    return figure


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


# Lines nearer to a border, in units of the cell, lie along it.
BORDER = 1e-12


def images_in_cell(ends: Array) -> tuple[Array, IntArray]:
    """Images that touch the cell of lines, ends (n, 2, d) in its units: ends (m, 2, d), and the line of each (m,)."""
    ends = ends - np.floor(ends[:, :1])
    # Along each axis the whole shifts and the lines that they move to the cell: one test for all images of a shift.
    shifts = []
    for low, high in zip(np.minimum(ends[:, 0], ends[:, 1]).T, np.maximum(ends[:, 0], ends[:, 1]).T, strict=True):
        whole = range(-int(np.floor(high.max() + BORDER)), 1 - int(np.floor(low.min())))
        # A line along a border is drawn at the lower one of both.
        shifts.append([(n, (low + n < 1 - BORDER) & ((high + n > BORDER) | (low + n > -BORDER))) for n in whole])
    pieces, lines = [], []
    for image in product(*shifts):
        lines.append(np.flatnonzero(reduce(np.logical_and, [within for _, within in image])))
        pieces.append(ends[lines[-1]] + [n for n, _ in image])
    return np.concatenate(pieces), np.concatenate(lines)


def periodic_segments(
    edges: ArrayLike, offsets: ArrayLike, cell: ArrayLike, coordinates: ArrayLike
) -> tuple[Array, IntArray]:
    """All images of the edges that touch the cell: end points (n, 2, 2), and the edge of each (n,)."""
    edges, offsets, cell = np.asarray(edges), np.asarray(offsets), np.asarray(cell, dtype=float)
    tail, head = (np.asarray(coordinates) @ np.linalg.inv(cell))[edges.T]
    segments, owners = images_in_cell(np.stack([tail, head + offsets], axis=1))
    return segments @ cell, owners


# Faces of planar networks as polygons, filled behind the edges.

SHADE = "#FBE3B5"


def face_polygons(faces: Faces, edges: ArrayLike, coordinates: ArrayLike, bond_vectors: ArrayLike) -> list[Array]:
    """The corners (n_sides, 2) of every face, each whole even where it crosses the border of the cell."""
    arrays = np.asarray(edges), np.asarray(coordinates), np.asarray(bond_vectors)
    return [face_polygon(faces, face, *arrays) for face in range(faces.n_faces)]


def face_polygon(faces: Faces, face: int, edges: IntArray, coordinates: Array, bond_vectors: Array) -> Array:
    """The corners (n_sides, 2) of one face."""
    sides = slice(faces.starts[face], faces.starts[face + 1])
    boundary, signs = faces.edges[sides], faces.signs[sides]
    steps = signs[:, None] * bond_vectors[boundary]
    first = edges[boundary[0], 0 if signs[0] > 0 else 1]
    return coordinates[first] + np.cumsum(steps, axis=0) - steps


def polygon_images(polygon: Array, cell: Array) -> list[Array]:
    """The corners (n, 2) of a polygon in all periodic images that touch the cell."""
    fraction = polygon @ np.linalg.inv(cell)
    low, high = np.ceil(-fraction.max(axis=0)), np.floor(1 - fraction.min(axis=0))
    shifts = product(*(range(int(a), int(b) + 1) for a, b in zip(low, high, strict=True)))
    return [polygon + np.array(shift) @ cell for shift in shifts]


def shade_faces(
    axes: Axes, polygons: Sequence[Array], cell: ArrayLike | None, colours: str | Array = SHADE
) -> PolyCollection:
    """Fill faces behind the edges, of a periodic network in all images that touch the cell and cut at its border.

    colours  one, or one a face (N_f, 4)
    """
    images = [[one] if cell is None else polygon_images(one, np.asarray(cell, dtype=float)) for one in polygons]
    if not isinstance(colours, str):
        colours = np.repeat(colours, [len(pieces) for pieces in images], axis=0)
    shading = PolyCollection([piece for pieces in images for piece in pieces], edgecolors="none", zorder=0)
    shading.set_facecolor(colours)  # type: ignore[arg-type]
    axes.add_collection(shading)
    if cell is not None:
        shading.set_clip_path(Polygon(CORNERS @ np.asarray(cell), closed=True, transform=axes.transData))
    return shading
