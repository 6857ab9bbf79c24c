"""Networks and distributions as matplotlib figures, from arrays; no physics is computed here.

Periodic networks are drawn whole: every edge is repeated in all images that touch the cell and cut at its border.
Tension is shown by colour (a map for all kinds of colour vision and for grey print) and by width.
"""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import Colormap, LinearSegmentedColormap, Normalize, to_rgb, to_rgba
from matplotlib.figure import Figure
from matplotlib.patches import Polygon
from mpl_toolkits.mplot3d import Axes3D
from mpl_toolkits.mplot3d.art3d import Poly3DCollection
from numpy.typing import ArrayLike

from critflow.networks.faces import Faces
from critflow.networks.network import Array

# Okabe and Ito's colours, distinct for all common kinds of colour vision.
COLOURS = ("#0072B2", "#56B4E9", "#D55E00", "#009E73", "#E69F00", "#CC79A7", "#7F7F7F")
COMPRESSED = "#D55E00"
SHADE = "#FBE3B5"
SLACK = "#BBBBBB"

# From a light to a dark blue-black, so that strong edges stand out on white and print in grey.
TENSION_MAP: Colormap = LinearSegmentedColormap.from_list("tension", ["#b8d4ea", "#4f93c4", "#1c4f86", "#0b1530"])


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
    border: bool = True,
) -> LineCollection:
    """Draw a periodic network once and whole, edges coloured by tension; compressed edges are orange and dashed.

    Edges without tension are slack: thin and grey below the others.

    Many parameters: figures read the arrays of a network from files, so each is an argument.

    limits  tensions of the light and dark ends of the colour map; by default 0 and the 99th percentile
    """
    segments, edge = periodic_segments(edges, offsets, cell, coordinates)
    values = np.ones(len(np.asarray(edges))) if tensions is None else np.asarray(tensions)
    low, high = limits or (0.0, float(np.percentile(np.abs(values), 99)) or 1.0)
    norm = Normalize(low, high, clip=True)
    order = np.argsort(values[edge], kind="stable")
    segments, strength = segments[order], values[edge][order]
    loose = strength == 0 if values.any() else np.zeros(len(strength), bool)
    tense = (strength >= 0) & ~loose
    widths = width * (0.45 + 1.1 * norm(np.abs(strength)))
    lines = LineCollection(segments[tense], cmap=TENSION_MAP, norm=norm, capstyle="round")
    # The constructor would distribute widths three times.
    lines.set_linewidth(widths[tense])
    lines.set_array(strength[tense])
    pushed = strength < 0
    compressed = LineCollection(
        segments[pushed], colors=COMPRESSED, linewidths=np.maximum(widths[pushed], width), linestyles=(0, (2, 1))
    )
    slack = LineCollection(segments[loose], colors=SLACK, linewidths=0.5 * width, zorder=1)
    corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) @ np.asarray(cell)
    outline = Polygon(corners, closed=True, fill=False, edgecolor="0.6" if border else "none", linewidth=0.6)
    axes.add_patch(outline)
    for collection in (lines, compressed, slack) if loose.any() else (lines, compressed):
        axes.add_collection(collection)
        collection.set_clip_path(outline)
    span = np.ptp(corners, axis=0)
    axes.set_xlim(corners[:, 0].min() - 0.01 * span[0], corners[:, 0].max() + 0.01 * span[0])
    axes.set_ylim(corners[:, 1].min() - 0.01 * span[1], corners[:, 1].max() + 0.01 * span[1])
    axes.set_aspect("equal")
    axes.set_axis_off()
    return lines


def periodic_segments(
    edges: ArrayLike, offsets: ArrayLike, cell: ArrayLike, coordinates: ArrayLike
) -> tuple[Array, Array]:
    """All images of the edges that touch the cell: end points (n, 2, 2), and the edge of each (n,)."""
    edges, offsets, cell = np.asarray(edges), np.asarray(offsets), np.asarray(cell, dtype=float)
    fraction = np.asarray(coordinates) @ np.linalg.inv(cell)
    # An edge starts at the image of its tail in the cell; its head may lie outside.
    tail = fraction[edges[:, 0]]
    start = tail - np.floor(tail)
    end = start + fraction[edges[:, 1]] - tail + offsets
    pieces, owners = [], []
    low, high = np.minimum(start, end), np.maximum(start, end)
    for image in product(
        *(range(int(-np.floor(high[:, k].max())), int(1 - np.floor(low[:, k].min()))) for k in range(2))
    ):
        touching = ((high + image > 0) & (low + image < 1)).all(axis=1)
        pieces.append(np.stack([start[touching] + image, end[touching] + image], axis=1) @ cell)
        owners.append(np.flatnonzero(touching))
    return np.concatenate(pieces), np.concatenate(owners)


def face_polygons(faces: Faces, edges: ArrayLike, coordinates: ArrayLike, bond_vectors: ArrayLike) -> list[Array]:
    """The corners (n_sides, 2) of every face, each whole even where it crosses the border of the cell."""
    edges, coordinates = np.asarray(edges), np.asarray(coordinates)
    sides = faces.signs[:, None] * np.asarray(bond_vectors)[faces.edges]
    start = np.where(faces.signs > 0, edges[faces.edges, 0], edges[faces.edges, 1])[faces.starts[:-1]]
    walks = np.split(sides, faces.starts[1:-1])
    return [coordinates[first] + np.cumsum(walk, axis=0) - walk for first, walk in zip(start, walks, strict=True)]


def shade_faces(axes: Axes, polygons: Sequence[Array], cell: ArrayLike, colour: str = SHADE) -> PolyCollection:
    """Fill faces of a periodic network behind its edges, in all images that touch the cell and cut at its border."""
    cell = np.asarray(cell, dtype=float)
    pieces = []
    for polygon in polygons:
        fraction = polygon @ np.linalg.inv(cell)
        low, high = fraction.min(axis=0), fraction.max(axis=0)
        images = (range(int(np.ceil(-high[k])), int(np.floor(1 - low[k])) + 1) for k in range(2))
        pieces += [polygon + np.array(image) @ cell for image in product(*images)]
    shading = PolyCollection(pieces, facecolors=colour, edgecolors="none", zorder=0)
    axes.add_collection(shading)
    outline = Polygon(np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) @ cell, closed=True, transform=axes.transData)
    shading.set_clip_path(outline)
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
    axes: Axes, edges: ArrayLike, offsets: ArrayLike, cell: ArrayLike, coordinates: ArrayLike, tensions: Array
) -> ScalarMappable:
    """Draw a periodic network of three dimensions in parallel projection, near edges over far ones, which fade.

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
    norm = Normalize(0.0, float(np.percentile(np.abs(tensions), 97)) or 1.0, clip=True)
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


def violins(
    axes: Axes, groups: Sequence[Array], labels: Sequence[str], *, colours: Sequence[str] = COLOURS, log: bool = False
) -> None:
    """Distributions side by side, each a violin with its median; few values are drawn as points.

    A group without spread is drawn as a line; values that are not finite are omitted and counted under the label.
    """
    shown_labels = []
    for place, (group, label) in enumerate(zip(groups, labels, strict=True)):
        finite = group[np.isfinite(group)]
        n_omitted = len(group) - len(finite)
        shown_labels.append(f"{label}\n{n_omitted} undefined" if n_omitted else label)
        if len(finite) == 0:
            axes.text(place, 0.5, "none", transform=axes.get_xaxis_transform(), ha="center", fontsize=7, color="0.4")
            continue
        colour = colours[place % len(colours)]
        values = np.log10(np.maximum(finite, 1e-300)) if log else finite
        median = float(np.median(values))
        if np.ptp(values) > 1e-9 * max(abs(median), 1e-300) and len(values) > 3:
            parts = axes.violinplot([values], [place], widths=0.85, showextrema=False)
            for body in parts["bodies"]:  # type: ignore[attr-defined]
                body.set(facecolor=colour, edgecolor=colour, alpha=0.45, linewidth=0.8)
        else:
            axes.plot(np.full(len(values), place), values, "o", color=colour, markersize=2.5)
        axes.plot([place - 0.2, place + 0.2], [median, median], color=colour, linewidth=2.0, solid_capstyle="butt")
    axes.set_xticks(range(len(groups)), shown_labels, fontsize=8)
    axes.set_xlim(-0.6, len(groups) - 0.4)
    if log:
        low, high = axes.get_ylim()
        # Fewer than three decades need ticks within them to be readable.
        marks = (1, 3) if high - low < 3 else (1,)
        decades = range(int(np.floor(low)), int(np.ceil(high)) + 1)
        ticks = [(decade + np.log10(mark), mark, decade) for decade in decades for mark in marks]
        ticks = [tick for tick in ticks if low <= tick[0] <= high]
        plain = high - low < 3 and low > -4
        names = [f"{mark * 10.0**decade:g}" if plain else f"$10^{{{decade}}}$" for _, mark, decade in ticks]
        axes.set_yticks([place for place, _, _ in ticks], names)
    axes.spines[["top", "right"]].set_visible(False)
    axes.tick_params(axis="y", labelsize=8)


@dataclass(frozen=True, eq=False)
class Drawing:
    """A small picture of a network: its arrays, tensions at unit pressure and a caption."""

    caption: str
    edges: Array
    offsets: Array
    cell: Array
    coordinates: Array
    tensions: Array

    def draw(
        self, axes: Axes, font_size: float, width: float, limits: tuple[float, float] | None = None
    ) -> LineCollection:
        """Draw the network with its caption as title; options as of `draw_network`."""
        # A given height is not searched for: that takes as long as the drawing.
        axes.set_title(self.caption, fontsize=font_size, y=1.0)
        arrays = (self.edges, self.offsets, self.cell, self.coordinates, self.tensions)
        return draw_network(axes, *arrays, limits=limits, width=width)


@dataclass(frozen=True, eq=False)
class Panel:
    """Distributions of one quantity over groups, with drawings of networks as examples of its values."""

    label: str
    groups: Sequence[Array]
    drawings: Sequence[Drawing] = ()
    log: bool = False
    zero_line: bool = False


def panel_figure(panels: Sequence[Panel], labels: Sequence[str], title: str, note: str = "") -> Figure:
    """Panels two by two, violins on the left and drawings on the right of each."""
    rows = (len(panels) + 1) // 2
    lines = textwrap.wrap(note, _NOTE_WIDTH)
    low = 0.15 + 0.17 * len(lines)
    size = (12.5, 4.3 * rows + 0.45 + low)
    figure = Figure(figsize=size, dpi=150)
    figure.suptitle(title, fontsize=13, y=1 - 0.1 / size[1], va="top")
    for n, (panel, letter) in enumerate(zip(panels, "ABCDEFGH", strict=False)):
        left, bottom = 6.25 * (n % 2), low + 4.3 * (rows - 1 - n // 2)
        axes = _axes(figure, left + 0.72, bottom + 0.5, 4.1, 3.55)
        if panel.zero_line:
            axes.axhline(0.0, color="#C00000", linewidth=1.0, zorder=0)
        violins(axes, panel.groups, labels, log=panel.log)
        axes.set_ylabel(panel.label, fontsize=10)
        axes.set_title(letter, loc="left", fontweight="bold", fontsize=12, y=1.0)
        height = 3.6 / max(len(panel.drawings), 1)
        for row, drawing in enumerate(panel.drawings):
            small = _axes(figure, left + 4.93, bottom + 4.05 - height * (row + 1), 1.25, height - 0.35)
            drawing.draw(small, 8, width=0.75)
    if lines:
        figure.supxlabel("\n".join(lines), fontsize=8.5, color="0.25", y=0.07 / size[1], va="bottom")
    return figure


# Characters of a line of the note under a figure of panels, which leave a margin on both sides.
_NOTE_WIDTH = 190


def _axes(figure: Figure, left: float, bottom: float, width: float, height: float) -> Axes:
    """Axes at a place of a figure in inches: a layout by the sizes of all labels takes longer than the drawing."""
    across, up = figure.get_size_inches()
    return figure.add_axes((left / across, bottom / up, width / across, height / up))


def gallery_figure(drawings: Sequence[Drawing], title: str, columns: int = 4) -> Figure:
    """Networks side by side on one colour scale of the tension at unit pressure, with its bar in the last place."""
    columns = min(columns, len(drawings) + 1)
    rows = (len(drawings) + columns) // columns
    size = (3.1 * columns, 3.35 * rows + 0.4)
    figure = Figure(figsize=size, dpi=100)
    figure.suptitle(title, fontsize=13, y=1 - 0.1 / size[1], va="top")
    high = float(np.percentile(np.concatenate([np.abs(drawing.tensions) for drawing in drawings]), 97))
    places = [(3.1 * (n % columns), 3.35 * (rows - 1 - n // columns)) for n in range(rows * columns)]
    for (left, bottom), drawing in zip(places, drawings, strict=False):
        lines = drawing.draw(_axes(figure, left + 0.05, bottom + 0.05, 3.0, 3.0), 10, width=1.1, limits=(0.0, high))
    if len(places) > len(drawings):
        left, bottom = places[len(drawings)]
        bar = figure.colorbar(lines, cax=_axes(figure, left + 0.4, bottom + 0.2, 0.2, 2.7), extend="max")
        bar.set_label("edge tension at unit pressure")
    return figure


# Surfaces in three dimensions


def surface_quads(points: Array) -> Array:
    """The cells of a grid of points (n, m, 3) as quadrilaterals ((n − 1)(m − 1), 4, 3)."""
    corners = (points[:-1, :-1], points[1:, :-1], points[1:, 1:], points[:-1, 1:])
    return np.stack(corners, axis=2).reshape(-1, 4, points.shape[2])


def clipped_polygons(polygons: Sequence[Array], high: float) -> list[Array]:
    """The parts of convex polygons (n, 3) in which no coordinate exceeds `high`; empty parts are omitted."""
    kept = []
    for polygon in polygons:
        for axis in range(polygon.shape[1]):
            over = polygon[:, axis] - high
            corners = []
            for i, (here, there) in enumerate(zip(over, np.roll(over, -1), strict=True)):
                if here <= 0:
                    corners.append(polygon[i])
                if (here < 0 < there) or (there < 0 < here):
                    corners.append(polygon[i] + here / (here - there) * (polygon[(i + 1) % len(polygon)] - polygon[i]))
            polygon = np.array(corners).reshape(-1, polygon.shape[1])
        if len(polygon) > 2:
            kept.append(polygon)
    return kept


def draw_surfaces(
    axes: Axes3D, surfaces: Sequence[tuple[Sequence[Array], str, float]], light: ArrayLike = (0.3, 0.2, 1.0)
) -> Poly3DCollection:
    """Polygons with the colour and opacity of their surface, shaded, and hidden by those in front of them.

    All are one collection, since matplotlib sorts by depth within a collection only.
    """
    towards = np.asarray(light) / np.linalg.norm(light)
    faces, colours, edges = [], [], []
    for polygons, colour, alpha in surfaces:
        for polygon in polygons:
            normal = np.cross(polygon[2] - polygon[0], polygon[-1] - polygon[1])
            size = np.linalg.norm(normal)
            shade = 0.62 + 0.38 * abs(normal @ towards) / size if size > 0 else 1.0
            faces.append(polygon)
            colours.append((*(shade * np.array(to_rgba(colour)[:3])), alpha))
            # Outlines of opaque faces close the gaps between them.
            edges.append((*colours[-1][:3], float(alpha == 1)))
    collection = Poly3DCollection(faces, facecolors=colours, edgecolors=edges, linewidths=0.4)
    axes.add_collection3d(collection)
    return collection
