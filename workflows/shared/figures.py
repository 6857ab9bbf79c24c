"""Parts of figures that several studies share: panels at the width of a page, legends, violins."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from critflow.engine.study import plural
from critflow.networks import Array

# A figure is printed 17 cm wide, with text of 9 points.
WIDTH, TEXT, RESOLUTION = 17 / 2.54, 9, 200
# Fewer values than these are drawn one by one: the shape of their violin would be that of its kernel.
LEAST_VIOLIN = 20


def page(height, title=""):
    """A figure as wide as a page, with its finding as the title."""
    figure = Figure(figsize=(WIDTH, height), dpi=RESOLUTION, layout="constrained")
    figure.suptitle(title, fontsize=TEXT + 1)
    return figure


def panels(n, title, height=2.9, **more):
    """A figure with n panels side by side, as wide as a page, and the panels; more: options of `subplots`."""
    figure = page(height, title)
    row = figure.subplots(1, n, squeeze=False, **more)[0]
    readable(*row)
    return figure, row


def readable(*panels):
    """Set all text of panels to the size of print, and remove the upper and right spines."""
    for axes in panels:
        axes.tick_params(which="both", labelsize=TEXT)
        for text in (axes.xaxis.label, axes.yaxis.label, axes.title):
            text.set_fontsize(TEXT)
        axes.spines[["top", "right"]].set_visible(False)


def lettered(*panels, letters="ABCDEFGH"):
    """Name panels A, B, … before their titles, in text of the size of print."""
    readable(*panels)
    for axes, letter in zip(panels, letters, strict=False):
        title = axes.get_title()
        axes.set_title("")
        axes.set_title(f"$\\bf{{{letter}}}$  {title}".rstrip(), loc="left", fontsize=TEXT)


def legend_below(figure, panels, ncols):
    """The legend of one or several panels below the figure."""
    panels = panels if isinstance(panels, tuple) else (panels,)
    entries = [entry for axes in panels for entry in zip(*axes.get_legend_handles_labels(), strict=True)]
    figure.legend(
        *zip(*entries, strict=True), fontsize=TEXT, frameon=False, ncols=ncols, loc="outside lower center",
        columnspacing=1.2, handletextpad=0.4,
    )  # fmt: skip


def counted(ds):
    """The number of networks of a run, as text."""
    return plural(ds.sizes["seed"], "network")


def size_axis(axes, sizes):
    """Numbers of vertices on a logarithmic axis."""
    axes.set(xscale="log", xlabel="number of vertices $N_v$")
    axes.set_xticks(sizes, [f"{size:,}" for size in sizes])
    axes.set_xticks([], minor=True)


def mean_bars(axes, x, values, **style):
    """Means of values (n, networks) with bars of their standard errors; the means (n,)."""
    means, n = np.nanmean(values, axis=1), np.isfinite(values).sum(axis=1)
    errors = np.nanstd(values, axis=1) / np.sqrt(np.maximum(n - 1, 1))
    axes.errorbar(x, means, errors, linestyle="none", **style)
    return means


def heading(figure, letter, text):
    """Name a row of pictures by a letter, as `lettered` names panels."""
    figure.suptitle(f"$\\bf{{{letter}}}$  {text}", fontsize=TEXT, x=0.01, ha="left")


def violins(
    axes: Axes, groups: Sequence[Array], labels: Sequence[str], colours: Sequence[str], *, log: bool = False
) -> None:
    """Distributions side by side with their medians: violins, or points where there are few values or no spread.

    Values that are not finite are omitted and counted under the label.
    """
    shown_labels = []
    for place, (group, label, colour) in enumerate(zip(groups, labels, colours, strict=True)):
        finite = group[np.isfinite(group)]
        n_omitted = len(group) - len(finite)
        shown_labels.append(f"{label}\n{n_omitted} undefined" if n_omitted else label)
        if len(finite) == 0:
            axes.text(place, 0.5, "none", transform=axes.get_xaxis_transform(), ha="center", fontsize=TEXT, color="0.4")
            continue
        # The mark is the median of the values, not of their logarithms.
        median = float(np.median(finite))
        if log:
            finite, median = np.log10(np.maximum(finite, 1e-300)), np.log10(max(median, 1e-300))
        _distribution(axes, place, finite, median, colour)
    axes.set_xticks(range(len(groups)), shown_labels)
    axes.set_xlim(-0.6, len(groups) - 0.4)
    readable(axes)
    if log:
        _decades(axes)


def points_at(axes: Axes, place: float, values: Array, colour: str) -> None:
    """Values one by one at a place: multiples of the golden ratio keep neighbours apart."""
    shift = 0.5 * (np.arange(len(values)) * 0.618 % 1 - 0.5)
    axes.plot(place + shift, values, "o", color=colour, markersize=3, alpha=0.6, markeredgewidth=0)


def _distribution(axes: Axes, place: int, values: Array, median: float, colour: str) -> None:
    """One distribution at its place: a violin of many values that differ, else points next to each other."""
    if len(values) >= LEAST_VIOLIN and np.ptp(values) > 1e-9 * max(abs(median), 1e-300):
        parts = axes.violinplot([values], [place], widths=0.85, showextrema=False)
        for body in parts["bodies"]:  # type: ignore[attr-defined]
            body.set(facecolor=colour, edgecolor=colour, alpha=0.45, linewidth=0.8)
    else:
        points_at(axes, place, values, colour)
    axes.plot([place - 0.3, place + 0.3], [median, median], color=colour, linewidth=2.0, solid_capstyle="butt")


def _decades(axes: Axes) -> None:
    """Names of the ticks of logarithms."""
    low, high = axes.get_ylim()
    # Fewer than three decades need ticks within them to be readable, and less than one needs more.
    marks = (1, 1.5, 2, 3, 4, 5, 7) if high - low < 1 else (1, 3) if high - low < 3 else (1,)
    decades = range(int(np.floor(low)), int(np.ceil(high)) + 1)
    ticks = [(decade + np.log10(mark), mark, decade) for decade in decades for mark in marks]
    ticks = [tick for tick in ticks if low <= tick[0] <= high]
    plain = high - low < 3 and low > -4
    factors = {mark: "" if mark == 1 else rf"{mark:g} \times " for mark in marks}
    names = [f"{mark * 10.0**decade:g}" if plain else f"${factors[mark]}10^{{{decade}}}$" for _, mark, decade in ticks]
    axes.set_yticks([place for place, _, _ in ticks], names)
