"""Figures of populations: panels of distributions with example networks, and galleries of networks."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from critflow.figures.plot import draw_network
from critflow.networks.network import Array

from .violins import violins


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
