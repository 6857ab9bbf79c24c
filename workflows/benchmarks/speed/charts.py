"""Chart of error against time of three tasks, each with its methods and their times over that of the default below."""

from textwrap import fill

import numpy as np
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator, NullFormatter

from critflow.pictures import COLOURS

from ...shared.figures import TEXT, lettered, page
from .curves import MAIN_SIZE, cases, finest
from .tasks import TASKS

# The tasks of the overview: mechanics, response and design.
FIRST = ("strain_step", "moduli", "min_V_L")
# Where an error of exactly zero is drawn, if nothing is below.
FLOOR = 1e-17
# Height of a line of a legend [inches].
_LINE = 0.17
_PEER_COLOURS = (*COLOURS[2:6], "#8C510A", "#666666", "#000000")
_PEER_MARKERS, _OWN_MARKERS = "sPXDdhp", "^v<>*8H"
_ABOUT = (
    "\nSolid: prepared; dotted: with the preparation. Dark blue: default of critflow; light blue: its other methods.\n"
    "Below: time over that of the default at the finest error that both have, prepared / with the preparation"
)


def overview_figure(ds):
    """Three tasks at the size in the middle, each with its methods below."""
    shown = [case for word in FIRST if (case := _middle(ds, word))]
    if not shown:
        return nothing()
    # The legends have the height of the longest one.
    high, low = 3.6, _LINE * (2 + max(len(others) for *_, others in shown))
    figure = page(high + low)
    panels = figure.subplots(2, len(shown), squeeze=False, height_ratios=(high - 0.9, low))
    for (word, _, default, others), axes, below in zip(shown, *panels, strict=True):
        styles = _styles(default, others)
        _chart(axes, [*others, default], styles)
        axes.set_ylabel(fill(TASKS[word].error, 34))
        axes.set_title(fill(_capital(TASKS[word].title), 26))
        # The panels, not their legends, share the width of the page.
        _legend(below, default, others, styles).set_in_layout(False)
    lettered(*panels[0])
    sizes = " or ".join(f"{size:,}" for size in dict.fromkeys(size for _, size, *_ in shown))
    figure.suptitle(
        f"Error against processor time on one core, $N_v$ = {sizes}: lower left is better{_ABOUT}", fontsize=TEXT
    )
    return figure


def _middle(ds, word):
    """The case of a task whose size is nearest to the one in the middle, or None."""
    of_task = [case for case in cases(ds) if case[0] == word]
    return min(of_task, key=lambda case: abs(np.log(case[1] / MAIN_SIZE)), default=None)


def nothing(text="nothing was timed"):
    """A figure without data, with the reason."""
    figure = page(3)
    axes = figure.subplots()
    axes.set_axis_off()
    axes.text(0.5, 0.5, text, ha="center")
    return figure


def _capital(title):
    """The title with a capital letter, and without line breaks in equations."""
    return title[0].upper() + title[1:].replace(" = ", "\u00a0=\u00a0")


def _styles(default, others):
    """Colour and marker of each method: dark blue the default, light blue other methods, other colours packages."""
    styles = {default.name: {"color": COLOURS[0], "marker": "o", "markersize": 5.5, "linewidth": 2.2}}
    own, peers = ([curve.name for curve in others if curve.own is kind] for kind in (True, False))
    for name, marker in zip(own, _OWN_MARKERS, strict=False):
        styles[name] = {"color": COLOURS[1], "marker": marker, "markersize": 4.5, "linewidth": 1.0}
    for name, marker, colour in zip(peers, _PEER_MARKERS, _PEER_COLOURS, strict=False):
        styles[name] = {"color": colour, "marker": marker, "markersize": 4.5, "linewidth": 1.0}
    return styles


def _chart(axes, methods, styles):
    floor = min(FLOOR, min(c.errors[c.errors > 0].min(initial=FLOOR) for c in methods))
    for curve in methods:
        errors, style = np.maximum(curve.errors, floor), styles[curve.name]
        spread = np.maximum(np.stack([curve.seconds - curve.low, curve.high - curve.seconds]), 0)
        axes.errorbar(curve.seconds, errors, xerr=spread, elinewidth=0.7, **style)
        if curve is methods[-1] or not curve.own:
            axes.plot(curve.seconds + curve.preparation, errors, ":", color=style["color"], linewidth=1.3, zorder=1)
            axes.plot(curve.seconds[-1:] + curve.preparation, errors[-1:], ".", color=style["color"])
    axes.set(xscale="log", yscale="log", xlabel="processor time  [s]")
    axes.margins(0.08)
    axes.xaxis.set_major_locator(LogLocator(numticks=4))
    axes.yaxis.set_major_locator(LogLocator(numticks=8))
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.yaxis.set_minor_formatter(NullFormatter())
    axes.grid(which="major", color="0.92", linewidth=0.6, zorder=0)


def _legend(axes, default, others, styles):
    """The methods from fast to slow, with their times over that of the default."""
    axes.set_axis_off()
    times = {curve.name: finest(default, curve) for curve in others}
    handles = [Line2D([], [], label=default.name, **styles[default.name])]
    for name, ratio in sorted(times.items(), key=lambda item: item[1].warm if item[1] else np.inf):
        handles.append(Line2D([], [], label=f"{name}: {ratio}" if ratio else name, **styles[name]))
    return axes.legend(
        handles=handles, loc="upper left", fontsize=TEXT - 1, frameon=False, borderaxespad=0, handlelength=1.4,
        handletextpad=0.4, labelspacing=0.3, bbox_to_anchor=(-0.42, 0, 1.4, 1),
    )  # fmt: skip
