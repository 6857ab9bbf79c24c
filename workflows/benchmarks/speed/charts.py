"""Chart of error against time of three tasks, each with its methods and their times over that of the default below."""

from textwrap import fill

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator, NullFormatter

from critflow.figures.plot import COLOURS

from ...shared.figures import RESOLUTION, TEXT, WIDTH
from .curves import MAIN_SIZE, cases, gain
from .tasks import TASKS

# The tasks of the overview: mechanics, response and design.
FIRST = ("strain_step", "moduli", "length_variance")
# Where an error of exactly zero is drawn, if nothing is below.
FLOOR = 1e-17
# Text of 9 points at the width of a page.
_WIDTH, _RESOLUTION, _SMALL, _TEXT = WIDTH, RESOLUTION, TEXT, TEXT
# Height of a line of a legend [inches].
_LINE = 0.16
_PEER_COLOURS = (*COLOURS[2:6], "#8C510A", "#666666", "#000000")
_PEER_MARKERS, _OWN_MARKERS = "sPXDdhp", "^v<>*8H"


def overview_figure(ds):
    """Three tasks at the size in the middle, each with its methods below."""
    shown = {word: at for word in FIRST if (at := _middle(ds, word))}
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
        _legend(below, curves, default, styles).set_in_layout(False)
    sizes = " or ".join(f"{size:,}" for size in dict.fromkeys(size for size, _, _ in shown.values()))
    _explain(figure, f"Error against time of every method at $N_v$ = {sizes}: lower left is better")
    return figure


def _middle(ds, word):
    """Size, curves and default of the case of a task whose size is nearest to the one in the middle, or None."""
    of_task = [case for of, *case in cases(ds) if of == word]
    return min(of_task, key=lambda case: abs(np.log(case[0] / MAIN_SIZE)), default=None)


def nothing(text="nothing was timed"):
    """A figure without data, with the reason."""
    figure = Figure(figsize=(_WIDTH, 3), dpi=_RESOLUTION)
    figure.text(0.5, 0.5, text, ha="center")
    return figure


def _capital(title):
    """The title with a capital letter, and without line breaks in equations."""
    return title[0].upper() + title[1:].replace(" = ", "\u00a0=\u00a0")


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


def _legend(axes, curves, default, styles):
    """The methods from fast to slow, with their times over that of the default."""
    axes.set_axis_off()
    handles = []
    ratios = {c.name: gain(default, c) if default is not None and c is not default else None for c in curves}
    for name in sorted(ratios, key=lambda name: ratios[name] if ratios[name] is not None else -1):
        ratio = ratios[name]
        times = "" if ratio is None else ": more accurate" if not ratio else f": {_number(ratio)} ×"
        handles.append(Line2D([], [], label=name + times, **styles[name]))
    return axes.legend(
        handles=handles, loc="upper left", fontsize=_SMALL, title_fontsize=_SMALL, alignment="left",
        title=f"time over that of {default.name}" if default is not None else "",
        frameon=False, borderaxespad=0, handlelength=2.0, labelspacing=0.35, bbox_to_anchor=(-0.3, 0, 1.3, 1),
    )  # fmt: skip


def _explain(figure, first):
    figure.suptitle(
        f"{first}\n(one network; dark blue: default, light blue: other methods of critflow,\n"
        "dashed: other packages; processor time on one core)",
        fontsize=_TEXT + 1,
    )
