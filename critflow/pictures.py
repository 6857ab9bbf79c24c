"""Draw any network, configuration or state: periodic or with fixed vertices, in two or three dimensions."""

from __future__ import annotations

from collections.abc import Sequence
from functools import reduce
from itertools import product
from pathlib import Path
from typing import Any

import matplotlib
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backend_bases import FigureCanvasBase
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import Colormap, LinearSegmentedColormap, LogNorm, Normalize
from matplotlib.figure import Figure, SubFigure
from matplotlib.patches import Polygon
from numpy.typing import ArrayLike

from critflow.arguments import of_kind
from critflow.calls import running
from critflow.extensions import provided
from critflow.faces import Faces
from critflow.networks import Array, IntArray, Network
from critflow.result import InputError, Solution

# Where edges are shown by their stiffness, and how: also for drawings that are made without matplotlib.

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


# Networks and distributions as matplotlib figures, from arrays; no physics is computed here.
#
# Periodic networks are drawn whole: every edge is repeated in all images that touch the cell and cut at its border.
# Tension is shown by colour (a map for all kinds of colour vision and for grey print) and by width.

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
        lines: ScalarMappable = _draw_in_depth(axes, edges, offsets, cell, coordinates, tensions)
    else:
        lines = draw_network(axes, edges, offsets, cell, coordinates, tensions, width=1.6)
    bar = figure.colorbar(lines, ax=axes, shrink=0.8, pad=0.02)
    bar.set_label("edge tension τ at unit pressure")
    if (tensions < 0).any():
        axes.plot([], [], color=COMPRESSED, linestyle=(0, (2, 1)), label="compressed")
        axes.legend(loc="upper left", fontsize=8, frameon=True)
    axes.set_title(title, fontsize=10)
    return figure


def _draw_in_depth(*arguments: Any) -> ScalarMappable:
    """Draw a periodic network of three dimensions, which an extra does."""
    drawn: ScalarMappable = provided("draw_in_depth", "pictures of periodic networks in space")(*arguments)
    return drawn


# Colour of edges without values.
_PLAIN = "0.35"
# Edges with less than this part of the mean |tension| carry none.
_NO_TENSION = 1e-9
# Colours of faces, of which a part on each side of the middle is pale enough for edges to stand out.
_FACE_MAP, _PALE = "RdBu_r", 0.3
# Largest part of the axes that discs of all vertices may cover.
_DISC_AREA = 0.2


@running("draw")
def draw(
    thing: Any,
    ax: Axes | None = None,
    *,
    color: ArrayLike | None = None,
    cmap: str | Colormap = TENSION_MAP,
    vertices: ArrayLike | None = None,
    width: float = 1.4,
    title: str = "",
) -> Axes:
    """Draw a `Network`, `CriticalConfiguration`, tissue, spring state, or a `Solution` with one; returns the axes.

    color     values (N_b,) that colour the edges; by default the tensions of a configuration or state, or without any
              tension its stiffnesses, where they vary, with a colour bar
    cmap      a matplotlib colour map
    vertices  values (N_v,) drawn as discs, the largest value as the largest disc: the part in floppy motions, say
    width     line width in points

    Colour and width show the same values.  Compressed edges are orange and dashed, edges without tension thin and grey,
    fixed vertices black squares.  Faces have the colours of their pressures, or of the tensions of their perimeters:
    red above zero, blue below.
    Raises `InputError` for a network without positions.

    >>> import critflow as cf
    >>> axes = cf.draw(cf.optimize(cf.lattice("honeycomb", 2, 2), 'B_0'))
    >>> axes.figure.clear()
    """
    if isinstance(ax, str | Path):
        raise InputError(f"ax must be an Axes, not {str(ax)!r}: draw(...).figure.savefig({str(ax)!r}) saves a picture")
    ax = of_kind(Axes, None, ax=ax)
    of_kind(np.ndarray, None, color=color, vertices=vertices)
    cmap = of_kind(str, Colormap, cmap=cmap)
    of_kind(float, width=width)
    of_kind(str, title=title)
    network, x, tensions, of_faces = _parts(thing)
    values, scale = None if color is None else np.asarray(color, dtype=float), None
    if color is None:
        scale = _stiffness_scale(network, x, tensions)
        values = tensions if scale is None else network.stiffness
    _check_drawn(network, values, vertices, cmap)
    if ax is None:
        ax = plt.figure(figsize=(6.0, 5.4), layout="constrained").add_subplot()
    if network.dimension == 3 and network.cell is not None:
        shown = np.ones(network.n_edges) if values is None else values
        drawn: ScalarMappable | None = _draw_in_depth(ax, network.edges, network.offsets, network.cell, x, shown, scale)
    elif network.dimension == 3:
        drawn = _draw_plane(ax, network, x[:, [0, 2]], values, cmap, width, scale)
        title = f"{title} (seen along y)" if title else "seen along y"
    else:
        drawn = _draw_plane(ax, network, x, values, cmap, width, scale)
        if of_faces is not None and network.faces is not None and len(of_faces) == network.faces.n_faces:
            _colour_faces(ax, network, x, of_faces)
        if vertices is not None:
            _discs(ax, network, x, np.asarray(vertices, dtype=float))
    if scale is not None and drawn is not None:
        ax.figure.colorbar(drawn, ax=ax, shrink=0.8, pad=0.02, label="stiffness k")
    ax.set_title(title, fontsize=10)
    return ax


def _parts(thing: Any) -> tuple[Network, Array, Array | None, Array | None]:
    """Network, coordinates, and tensions and values of faces, if any."""
    if isinstance(thing, Solution):
        thing = thing.value
    of_faces = getattr(thing, "pressures", getattr(thing, "face_tensions", None))
    thing = getattr(thing, "configuration", thing)
    network = thing if isinstance(thing, Network) else getattr(thing, "network", None)
    if not isinstance(network, Network):
        raise InputError(f"a {type(thing).__name__} cannot be drawn: give a network, a configuration or a state")
    x = network.positions if thing is network else thing.coordinates
    if x is None:
        raise InputError("the network has no positions: draw a configuration of it, or give it positions")
    x = np.array(x)
    for vertex, position in network.pins.items():
        x[vertex] = position
    tensions = None if thing is network else np.asarray(thing.sigma) * np.asarray(thing.lengths)
    return network, x, tensions, of_faces


def _check_drawn(network: Network, values: Array | None, vertices: ArrayLike | None, cmap: str | Colormap) -> None:
    """Raise `InputError` for values of other edges or vertices, and for an unknown colour map."""
    if values is not None and values.shape != (network.n_edges,):
        raise InputError(f"color must have one value per edge, shape ({network.n_edges},), not {values.shape}")
    if vertices is not None and np.shape(vertices) != (network.n_vertices,):
        raise InputError(f"vertices must have one value per vertex, shape ({network.n_vertices},)")
    if isinstance(cmap, str) and cmap not in matplotlib.colormaps:
        raise InputError(f"matplotlib has no colour map {cmap!r}: choose a name such as 'viridis'")


def _stiffness_scale(network: Network, x: Array, tensions: Array | None) -> Normalize | None:
    """The scale of colours by stiffness, logarithmic where these differ widely; None where they are equal.

    None too where an edge carries more tension than that of rounding.
    """
    k = network.stiffness
    unit = float((k * np.linalg.norm(network.bond_vectors(x), axis=1)).mean())
    if not varied(k) or (tensions is not None and not np.abs(tensions).max() <= _NO_TENSION * unit):
        return None
    low, high = float(k.min()), float(k.max())
    return LogNorm(low, high, clip=True) if widely(k) else Normalize(0.0, high, clip=True)


def _colour_faces(ax: Axes, network: Network, x: Array, of_faces: Array) -> None:
    """Faces in pale colours of their values (N_f,), red above zero and blue below."""
    assert network.faces is not None
    shade = matplotlib.colormaps[_FACE_MAP](0.5 + _PALE * of_faces / (np.abs(of_faces).max() or 1.0))
    polygons = face_polygons(network.faces, network.edges, x, network.bond_vectors(x))
    shade_faces(ax, polygons, network.cell, shade)


def _draw_plane(
    ax: Axes,
    network: Network,
    x: Array,
    values: Array | None,
    cmap: str | Colormap,
    width: float,
    scale: Normalize | None,
) -> ScalarMappable | None:
    """The edges in two dimensions, with the outline of the cell or the fixed vertices; those in tension are returned.

    Many parameters: network, values and their scale are arguments of one picture.
    """
    outline = None
    if network.cell is not None:
        segments, edges = periodic_segments(network.edges, network.offsets, network.cell, x)
        outline = add_cell(ax, network.cell)
    else:
        segments, edges = x[network.edges], np.arange(network.n_edges)
        margin = 0.03 * float(np.ptp(x, axis=0).max())
        ax.set_xlim(x[:, 0].min() - margin, x[:, 0].max() + margin)
        ax.set_ylim(x[:, 1].min() - margin, x[:, 1].max() + margin)
        ax.set_aspect("equal")
        ax.set_axis_off()
    drawn = None
    if values is None:
        lines = LineCollection(list(segments), colors=_PLAIN, linewidths=width, capstyle="round")
        ax.add_collection(lines)
        lines.set_clip_path(outline)
    else:
        slack = np.abs(values) <= _NO_TENSION * (float(np.abs(values).mean()) or 1.0)
        shown = np.where(slack, 0.0, values)[edges]
        drawn = add_edges(ax, segments, shown, scale or colour_limits(values), outline, width=width, cmap=cmap)
    if network.pins:
        ax.plot(*x[list(network.pins)].T, "s", color="black", markersize=3.5, zorder=4)
    return drawn


def _discs(ax: Axes, network: Network, x: Array, values: Array) -> None:
    if not np.isfinite(values).all():
        return
    places = x
    if network.cell is not None:
        fraction = x @ np.linalg.inv(network.cell)
        places = (fraction - np.floor(fraction)) @ network.cell
    largest = float(values.max(initial=0.0))
    # Area in square points, of which the largest leaves the edges between two vertices visible.
    inches = ax.get_window_extent().transformed(ax.figure.dpi_scale_trans.inverted()).size
    most = min(90.0, _DISC_AREA * 72**2 * float(np.prod(inches)) / len(x))
    size = most * np.clip(values, 0, None) / (largest or 1.0)
    ax.scatter(places[:, 0], places[:, 1], s=size, color=COLOURS[4], alpha=0.75, linewidths=0, zorder=3)


def require_picture(path: Path) -> None:
    """Raise `InputError` where a figure cannot be saved to a path."""
    endings = FigureCanvasBase.get_supported_filetypes()
    if path.suffix[1:].lower() not in endings:
        raise InputError(f"a picture cannot have the ending {path.suffix!r}: choose .png, .pdf or .svg")
    require_folder(path)


def require_folder(path: Path) -> None:
    """Raise `InputError` where a file cannot be written for want of its folder, or is a folder itself."""
    if not path.parent.is_dir():
        raise InputError(f"there is no folder {path.parent} for {path.name}: make it, or choose another")
    if path.is_dir():
        raise InputError(f"{path} is a folder: give the name of a file in it")


def saved(figure: Figure | SubFigure, path: Any) -> None:
    """Save a figure and release it."""
    whole = figure.figure if isinstance(figure, SubFigure) else figure
    whole.savefig(path, dpi=160)
    plt.close(whole)
