"""Parts of figures that several studies share: panels side by side, legends, violins, edges of a network."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.patches import Polygon

from critflow.figures.plot import COLOURS
from critflow.networks.network import Array


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


def violins(axes: Axes, groups: Sequence[Array], labels: Sequence[str], *, log: bool = False) -> None:
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
        colour = COLOURS[place % len(COLOURS)]
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
