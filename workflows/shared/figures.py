"""Parts of figures that several studies share: panels side by side, limits, edges of a network."""

from __future__ import annotations

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure


def panels(n, title, height=3.6):
    """A figure with n panels side by side, as wide as a page, and the panels."""
    figure = Figure(figsize=(min(10, 5 * n), height), dpi=150, layout="constrained")
    row = figure.subplots(1, n, squeeze=False)[0]
    for axes in row:
        axes.spines[["top", "right"]].set_visible(False)
    figure.suptitle(title, fontsize=11)
    return figure, row


def lettered(*panels):
    """Name panels A, B, … before their titles, and remove the upper and right spines."""
    for axes, letter in zip(panels, "ABCDEFGH", strict=False):
        title = axes.get_title()
        axes.set_title("")
        axes.set_title(f"$\\bf{{{letter}}}$   {title}".rstrip(), loc="left", fontsize=11)
        axes.spines[["top", "right"]].set_visible(False)


def legend_below(figure, axes, ncols):
    """The legend of one panel below the figure."""
    figure.legend(
        *axes.get_legend_handles_labels(), fontsize=8.5, frameon=False, ncols=ncols, loc="outside lower center"
    )


def signed(value):
    """A number with the sign of typography."""
    return f"{value:g}".replace("-", "−")


def segments(critical):
    """Ends of the edges (N_b, 2, 2) of a planar configuration, with the tails inside the cell."""
    network = critical.network
    tail = critical.coordinates[network.edges[:, 0]]
    tail = (tail @ np.linalg.inv(network.cell) % 1.0) @ network.cell
    return np.stack([tail, tail + critical.bond_vectors], axis=1)


def draw_cell(axes, n_vertices, shear=0.0):
    """The square cell of a generated network of n vertices, V = N_v, after a simple shear."""
    corners = np.sqrt(n_vertices) * np.array([[0, 0], [1, 0], [1 + shear, 1], [shear, 1], [0, 0]])
    axes.plot(*corners.T, color="0.6", linewidth=0.8, linestyle="--", zorder=0)


def draw_segments(axes, lines, title, **style):
    """Draw edges without a frame."""
    axes.add_collection(LineCollection(lines, **style))
    axes.autoscale_view()
    axes.set_aspect("equal")
    axes.set_anchor("N")
    axes.set_axis_off()
    axes.set_title(title, fontsize=10)
