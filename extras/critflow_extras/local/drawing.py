"""Pictures of local responses: the network, the source, its targets and the motion."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import ListedColormap
from matplotlib.patches import Patch
from numpy.typing import ArrayLike

from critflow.arguments import of_kind
from critflow.manifold import CriticalConfiguration
from critflow.networks import Array
from critflow.pictures import COLOURS, add_cell, periodic_segments
from critflow.result import InputError
from critflow_extras.drawing.draw import draw
from critflow_extras.local.local_response import LocalResponse
from critflow_extras.local.pairs import Pair

# The arrow of the median motion and the longest one, in units of the spacing of vertices; widths of lines in points.
_MEDIAN, _LONGEST, _SOURCE, _LEAST, _MOST = 0.25, 0.8, 3.5, 0.8, 3.0
_EDGES = ListedColormap(["0.72"])
SOURCE, GROWS, SHRINKS = "black", COLOURS[0], COLOURS[2]


def draw_response(critical: CriticalConfiguration, response: LocalResponse, ax: Axes | None = None) -> Axes:
    """Draw a planar configuration and a response of it: the source black, targets in colours of growth and shrinkage.

    Lines of targets are as wide as |η|, up to 1; arrows are the motion, and the longest of them are shortened.
    Returns the axes.

    >>> import critflow as cf
    >>> import critflow_extras as ce
    >>> from critflow_extras.local.drawing import draw_response
    >>> best = cf.optimize(cf.voronoi_network(n_vertices=20, seed=1), "B_0").value
    >>> axes = draw_response(best, ce.local_response(best, (0, 9), [(4, 15)]).value)
    >>> axes.figure.clear()
    """
    critical = of_kind(CriticalConfiguration, critical=critical)
    response = of_kind(LocalResponse, response=response)
    ax = of_kind(Axes, None, ax=ax)
    network = critical.network
    if network.dimension != 2:
        raise InputError("pictures of responses are those of planar networks: print the strains of others")
    ax = draw(critical, ax, color=np.ones(network.n_edges), cmap=_EDGES, width=0.9)
    # The arrow of a vertex is its response.
    shown = [
        (pair, eta) for pair, eta in zip(response.targets, response.strains, strict=True) if isinstance(pair, Pair)
    ]
    pairs = (response.source, *(pair for pair, _ in shown))
    ends, images = np.array([[pair.tail, pair.head] for pair in pairs]), np.array([pair.image for pair in pairs])
    strains = np.array([1.0, *(eta for _, eta in shown)])
    add_response(ax, network.cell, critical.coordinates, response.displacements, ends, images, strains)
    return ax


def add_response(
    axes: Axes, cell: Array | None, x: Array, moves: Array, ends: ArrayLike, images: ArrayLike, strains: Array
) -> None:
    """Add pairs, of which the first is the source, and arrows of the motion (N_v, 2) to axes of a network.

    ends, images, strains  (n, 2) vertices, (n, 2) cells of the heads, η (n,)
    Many parameters: the arrays of a response, so that one read from a file can be drawn.
    """
    ends, outline, places = np.asarray(ends), None, x
    if cell is None:
        segments, owner, area = x[ends], np.arange(len(ends)), float(np.prod(np.ptp(x, axis=0)))
    else:
        outline, area = add_cell(axes, cell), float(abs(np.linalg.det(cell)))
        segments, owner = periodic_segments(ends, images, cell, x)
        places = (x @ np.linalg.inv(cell) % 1.0) @ cell
    widths = _LEAST + (_MOST - _LEAST) * np.minimum(np.abs(strains), 1.0)
    widths[0], colours = _SOURCE, [GROWS if strain > 0 else SHRINKS for strain in strains]
    colours[0] = SOURCE
    lines = LineCollection(
        list(segments), linewidths=widths[owner], colors=[colours[n] for n in owner], capstyle="round", zorder=3
    )
    axes.add_collection(lines)
    lines.set_clip_path(outline)
    size, spacing = np.linalg.norm(moves, axis=1), np.sqrt(area / len(x))
    scale = np.minimum(_MEDIAN / (np.median(size) or 1.0), _LONGEST / np.where(size > 0, size, 1.0)) * spacing
    arrows = axes.quiver(
        *places.T, *(scale * moves.T), angles="xy", scale_units="xy", scale=1, width=0.005, color="0.15", zorder=4
    )
    arrows.set_clip_path(outline)


def response_legend() -> list[Patch]:
    """Handles of a legend of these pictures."""
    words = {"source": SOURCE, "grows with it": GROWS, "shrinks": SHRINKS}
    return [Patch(color=colour, label=word) for word, colour in words.items()]
