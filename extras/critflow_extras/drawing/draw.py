"""Draw any network, configuration or state: periodic or with fixed vertices, in two or three dimensions."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import Colormap, LogNorm, Normalize
from matplotlib.figure import Figure, SubFigure
from numpy.typing import ArrayLike

from critflow.arguments import of_kind
from critflow.calls import running
from critflow.networks import Array, Network
from critflow.pictures import (
    COLOURS,
    TENSION_MAP,
    add_cell,
    add_edges,
    colour_limits,
    face_polygons,
    periodic_segments,
    shade_faces,
)
from critflow.result import InputError, Solution
from critflow_extras.drawing.depth import draw_in_depth
from critflow_extras.drawing.scales import varied, widely

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
    >>> import critflow_extras as ce
    >>> axes = ce.draw(cf.optimize(cf.lattice("honeycomb", 2, 2), 'B_0'))
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
        drawn: ScalarMappable | None = draw_in_depth(ax, network.edges, network.offsets, network.cell, x, shown, scale)
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


def saved(figure: Figure | SubFigure, path: Any) -> None:
    """Save a figure and release it."""
    whole = figure.figure if isinstance(figure, SubFigure) else figure
    whole.savefig(path, dpi=160)
    plt.close(whole)
