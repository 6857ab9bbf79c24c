"""Charts of error against time: an overview of three tasks, and for every task a figure with a panel a size.

A legend next to the panels lists the methods with their times over that of the default, so that no text lies on points.
"""

from __future__ import annotations

from textwrap import fill

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator, NullFormatter

from critflow.figures.plot import COLOURS

from .curves import MAIN_SIZE, cases, gain
from .tasks import TASKS

# The tasks of the overview: mechanics, response and design.
FIRST = ("strain_step", "moduli", "length_variance")
# Where an error of exactly zero is drawn, if nothing is below.
FLOOR = 1e-17
# Width of a page of print [inches]; text is 7.5 to 10 points there.
_WIDTH, _RESOLUTION, _SMALL, _TEXT = 7.2, 160, 7.5, 8.5
# Height of a line of a legend [inches].
_LINE = 0.16
_PEER_COLOURS = (*COLOURS[2:6], "#8C510A", "#666666", "#000000")
_PEER_MARKERS, _OWN_MARKERS = "sPXDdhp", "^v<>*8H"


def overview_figure(ds):
    """Three tasks at the size in the middle, each with its methods below."""
    shown = {word: sizes[_middle(sizes)] for word, sizes in _by_task(ds).items() if word in FIRST}
    shown = {word: shown[word] for word in FIRST if word in shown}
    if not shown:
        return nothing()
    # The legends have the height of the longest one.
    high, low = 3.4, _LINE * (2.2 + max(len(curves) for _, curves, _ in shown.values()))
    figure = Figure(figsize=(_WIDTH, high + low), dpi=_RESOLUTION, layout="constrained")
    panels = figure.subplots(2, len(shown), squeeze=False, height_ratios=(high - 0.6, low))
    titles = [
        fill(f"$\\bf{{{letter}}}$  {_capital(TASKS[word].title)}", 40)
        for letter, word in zip("ABC", shown, strict=False)
    ]
    lines = max(title.count("\n") for title in titles)
    for (word, (_, curves, default)), title, axes, below in zip(shown.items(), titles, *panels, strict=True):
        styles = _styles(curves, default)
        _chart(axes, curves, default, styles)
        axes.set_ylabel(fill(TASKS[word].error, 34), fontsize=_TEXT)
        axes.set_title(title + "\n" * (lines - title.count("\n")), loc="left", fontsize=_TEXT)
        # The panels, not their legends, share the width of the page.
        _legend(below, curves, default, styles, "upper left", left=-0.3).set_in_layout(False)
    sizes = " or ".join(f"{size:,}" for size in dict.fromkeys(size for size, _, _ in shown.values()))
    _explain(figure, ds, f"Error against time of every method, $N_v$ = {sizes}")
    return figure


def task_figure(ds, word):
    """All sizes of one task in panels, with one legend."""
    sizes = _by_task(ds.sel(task=[word]) if word in ds.task.values else ds.isel(task=slice(0))).get(word)
    if not sizes:
        return nothing()
    cells = len(sizes) + 1
    columns = {1: 2, 2: 3, 3: 2, 4: 3}.get(len(sizes), 3)
    rows = -(-cells // columns)
    figure = Figure(figsize=(_WIDTH, 2.75 * rows + 0.75), dpi=_RESOLUTION, layout="constrained")
    grid = figure.subplots(rows, columns, squeeze=False, sharey=False)
    panels = list(grid.flat)
    # One style a method in all panels.
    everyone = list({c.name: c for n in sizes for c in sizes[n][1]}.values())
    _, middle_curves, middle_default = sizes[_middle(sizes)]
    styles = _styles(everyone, middle_default)
    for n, (size, (_, curves, default)) in enumerate(sizes.items()):
        _chart(panels[n], curves, default, styles)
        panels[n].set_title(f"$N_v$ = {size:,}", loc="left", fontsize=_TEXT)
        if n % columns == 0:
            panels[n].set_ylabel(fill(TASKS[word].error, 34), fontsize=_TEXT)
    for axes in panels[len(sizes) :]:
        axes.set_axis_off()
    title = f"at $N_v$ = {_middle(sizes):,}:"
    _legend(panels[len(sizes)], middle_curves, middle_default, styles, "center left", title, everyone)
    _explain(figure, ds, _capital(TASKS[word].title))
    return figure


def _by_task(ds):
    """Size, curves and default of each case, by task and size."""
    tasks: dict[str, dict] = {}
    for word, size, curves, default in cases(ds):
        tasks.setdefault(word, {})[size] = size, curves, default
    return tasks


def _middle(sizes):
    return min(sizes, key=lambda size: abs(np.log(size / MAIN_SIZE)))


def nothing(text="nothing was timed"):
    """A figure without data, with the reason."""
    figure = Figure(figsize=(_WIDTH, 3), dpi=_RESOLUTION)
    figure.text(0.5, 0.5, text, ha="center")
    return figure


def _capital(title):
    """The title with a capital letter, and without line breaks in equations."""
    title = title.replace(" = ", "\u00a0=\u00a0")
    return title if title[0] == "σ" else title[0].upper() + title[1:]


def _number(ratio):
    return f"{ratio:,.0f}" if ratio >= 9.95 else f"{ratio:.2g}"


def _styles(curves, default):
    """Colour and marker of each method: dark blue the default, light blue other methods, other colours packages."""
    styles, own, peers = {}, 0, 0
    for curve in curves:
        if default is not None and curve.name == default.name:
            styles[curve.name] = {"color": COLOURS[0], "marker": "o", "markersize": 5.5, "linewidth": 2.2}
        elif curve.own:
            marker = _OWN_MARKERS[own % len(_OWN_MARKERS)]
            styles[curve.name] = {
                "color": COLOURS[1], "marker": marker, "markersize": 4.5, "linewidth": 1.0, "markerfacecolor": "white",
            }  # fmt: skip
            own += 1
        else:
            styles[curve.name] = {
                "color": _PEER_COLOURS[peers % len(_PEER_COLOURS)], "marker": _PEER_MARKERS[peers % len(_PEER_MARKERS)],
                "markersize": 4.5, "linewidth": 1.0, "linestyle": "--",
            }  # fmt: skip
            peers += 1
    return styles


def _chart(axes, curves, default, styles):
    floor = min(FLOOR, min(c.errors[c.errors > 0].min(initial=FLOOR) for c in curves))
    for curve in sorted(curves, key=lambda curve: curve is default):
        spread = np.maximum(np.stack([curve.seconds - curve.low, curve.high - curve.seconds]), 0)
        axes.errorbar(
            curve.seconds, np.maximum(curve.errors, floor), xerr=spread, elinewidth=0.7,
            zorder=3 + (curve is default), **styles[curve.name],
        )  # fmt: skip
    axes.set(xscale="log", yscale="log")
    axes.margins(0.08)
    axes.set_xlabel("processor time of a run  [s]", fontsize=_TEXT)
    axes.tick_params(labelsize=_SMALL)
    axes.xaxis.set_major_locator(LogLocator(numticks=5))
    axes.yaxis.set_major_locator(LogLocator(numticks=8))
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.yaxis.set_minor_formatter(NullFormatter())
    axes.grid(which="major", color="0.92", linewidth=0.6, zorder=0)
    axes.spines[["top", "right"]].set_visible(False)


def _legend(axes, curves, default, styles, place, title="", everyone=(), left=0.0):
    """The methods from fast to slow, with their times over that of the default, then those of other sizes alone."""
    axes.set_axis_off()
    handles = []
    ratios = {c.name: gain(default, c) if default is not None and c is not default else None for c in curves}
    for name in sorted(ratios, key=lambda name: ratios[name] if ratios[name] is not None else -1):
        ratio = ratios[name]
        times = "" if ratio is None else ": more accurate" if not ratio else f": {_number(ratio)} ×"
        handles.append(Line2D([], [], label=name + times, **styles[name]))
    for curve in everyone:
        if curve.name not in ratios:
            handles.append(Line2D([], [], label=f"{curve.name}: other sizes", **styles[curve.name]))
    compared = f"time over that of {default.name}" if default is not None else ""
    heading = "\n".join(part for part in (title, compared) if part)
    return axes.legend(
        handles=handles, loc=place, fontsize=_SMALL, title=heading, title_fontsize=_SMALL, alignment="left",
        frameon=False, borderaxespad=0, handlelength=2.0, labelspacing=0.35,
        bbox_to_anchor=(left, 0, 1 - left, 1),
    )  # fmt: skip


def _explain(figure, ds, first):
    share = (ds.seconds / ds.wall_seconds).values
    share = share[np.isfinite(share)]
    load = f"; runs had {100 * np.median(share):.0f} % of it (median)" if len(share) else ""
    figure.suptitle(
        f"{fill(first, 80)}\nlower left is better; dark blue: default, light blue: other methods of critflow, "
        f"dashed: other packages\nprocessor time on one core{load}",
        fontsize=_TEXT,
    )
