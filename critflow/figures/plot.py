"""Networks and distributions as matplotlib figures, from arrays; no physics is computed here.

Periodic networks are drawn whole: every edge is repeated in all images that touch the cell and cut at its border.
Tension is shown by colour (a map for all kinds of colour vision and for grey print) and by width.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import Colormap, LinearSegmentedColormap, LogNorm, Normalize, to_rgb
from matplotlib.figure import Figure
from matplotlib.patches import Polygon
from numpy.typing import ArrayLike

from critflow.figures.shades import TENSION_COLOURS, widely
from critflow.networks.faces import Faces
from critflow.networks.network import Array, IntArray
from critflow.networks.periodic_cell import images_in_cell

# Okabe and Ito's colours, distinct for all common kinds of colour vision.
COLOURS = ("#0072B2", "#56B4E9", "#D55E00", "#009E73", "#E69F00", "#CC79A7", "#7F7F7F")
COMPRESSED = "#D55E00"
SHADE = "#FBE3B5"
SLACK = "#BBBBBB"
_CORNERS = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])

TENSION_MAP: Colormap = LinearSegmentedColormap.from_list("tension", TENSION_COLOURS)
# On a dark page strong edges are light.
DARK_TENSION_MAP: Colormap = LinearSegmentedColormap.from_list("dark", ["#2b5580", "#4f93c4", "#a9d0ee", "#ffffff"])


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


def stiffness_scale(stiffness: Array) -> Normalize:
    """The scale of the colours of stiffnesses (N_b,): from zero, or logarithmic where they differ widely."""
    low, high = float(stiffness.min()), float(stiffness.max())
    return LogNorm(low, high, clip=True) if widely(stiffness) else Normalize(0.0, high, clip=True)


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
    corners = _CORNERS @ np.asarray(cell)
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
        shading.set_clip_path(Polygon(_CORNERS @ np.asarray(cell), closed=True, transform=axes.transData))
    return shading


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
        lines: LineCollection | ScalarMappable = draw_in_depth(axes, edges, offsets, cell, coordinates, tensions)
    else:
        lines = draw_network(axes, edges, offsets, cell, coordinates, tensions, width=1.6)
    bar = figure.colorbar(lines, ax=axes, shrink=0.8, pad=0.02)
    bar.set_label("edge tension τ at unit pressure")
    if (tensions < 0).any():
        axes.plot([], [], color=COMPRESSED, linestyle=(0, (2, 1)), label="compressed")
        axes.legend(loc="upper left", fontsize=8, frameon=True)
    axes.set_title(title, fontsize=10)
    return figure


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
