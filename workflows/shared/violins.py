"""Distributions side by side as violins."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes

from critflow.figures.plot import COLOURS
from critflow.networks.network import Array


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
