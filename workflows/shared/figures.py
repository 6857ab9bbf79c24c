"""Parts of figures that several studies share: panels side by side, limits, edges of a network."""

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.patches import Polygon


def panels(n, title, height=3.6):
    """A figure with n panels side by side, as wide as a page, and the panels."""
    figure = Figure(figsize=(min(10, 5 * n), height), dpi=150, layout="constrained")
    row = figure.subplots(1, n, squeeze=False)[0]
    for axes in row:
        axes.spines[["top", "right"]].set_visible(False)
    figure.suptitle(title, fontsize=11)
    return figure, row


def lettered(*panels, letters="ABCDEFGH"):
    """Name panels A, B, … before their titles, and remove the upper and right spines."""
    for axes, letter in zip(panels, letters, strict=False):
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


def draw_in_cell(axes, lines, widths, n_vertices, shear=0.0, **style):
    """Draw the edges of a planar network with all their images in the cell, a sheared square with V = N_v, once."""
    cell = np.sqrt(n_vertices) * np.array([[1, 0], [shear, 1]])
    outline = Polygon([[0, 0], cell[0], cell[0] + cell[1], cell[1]], facecolor="none", edgecolor="0.7", linewidth=0.8)
    axes.add_patch(outline)
    images = [lines + (np.array(shift) - 1) @ cell for shift in np.ndindex(3, 3)]
    drawn = LineCollection(np.concatenate(images), linewidths=np.tile(widths, len(images)), **style)
    axes.add_collection(drawn, autolim=False)
    drawn.set_clip_path(outline)
    axes.autoscale_view()
    axes.set_aspect("equal")
    axes.set_anchor("N")
    axes.set_axis_off()


def heading(figure, letter, text):
    """Name a row of pictures by a letter, as `lettered` names panels."""
    figure.suptitle(f"$\\bf{{{letter}}}$   {text}", fontsize=11, x=0.01, ha="left")
