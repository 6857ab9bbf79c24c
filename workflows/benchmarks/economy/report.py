"""Figure, claims and summary of the cost of the requested variables, from the dataset alone."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from critflow.figures.plot import COLOURS
from critflow.workflow import Claim

from ...shared.reports import parameters

# Question: the requested quantity, the short route to it, and the long one.
WORDS = {
    "growth": ("$C_B$", "exact, at the transition", "a line fitted to a strain path"),
    "member": ("a member of the ensemble", "$B_0$ and exact $C_B$ alone", "all variables"),
    "moduli": ("$B_0$ at a configuration", "sums over the edges", "springs just past the transition"),
    "configuration": ("the configuration of $\\sigma$", "$P$, one matrix for all directions", "the Hessian of springs"),
    "optimum": ("max $B_0$", "closed form", "L-BFGS from a random stress"),
}


def _times(ds, question):
    """Seconds of both routes, their ratio for every network, and the largest difference of the answers."""
    one = ds.sel(question=question)
    short, long = one.seconds_short.values, one.seconds_long.values
    return np.nanmedian(short), np.nanmedian(long), long / short, float(one.difference.max())


def ratio_figure(ds):
    """Cost of the long over the short route to each quantity, with both times and the difference of the answers."""
    rows = []
    for question in map(str, ds.question.values):
        short, long, ratio, difference = _times(ds, question)
        note = f"{_seconds(short)} instead of {_seconds(long)}; answers differ by {_shown(difference)}"
        rows.append((np.nanmedian(ratio), ratio, WORDS[question], note, COLOURS[0]))
    stored = (ds.bytes_of_all / ds.bytes_of_scalars).values
    kilobytes = [float(ds[name].median()) / 1000 for name in ("bytes_of_scalars", "bytes_of_all")]
    note = f"{kilobytes[0]:.2g} kB instead of {kilobytes[1]:.0f} kB; the same numbers"
    rows.append((np.median(stored), stored, ("stored of a member", "scalars", "all arrays"), note, COLOURS[2]))
    rows.sort(key=lambda row: row[0])

    figure = Figure(figsize=(11, 0.75 * len(rows) + 1.3), dpi=110, layout="constrained")
    axes = figure.subplots()
    ends = [max(1.0, row[0], *row[1]) for row in rows]
    for place, (middle, ratios, _, note, colour) in enumerate(rows):
        axes.barh(place, middle - 1, left=1, color=colour, height=0.55)
        axes.plot(ratios, np.full(len(ratios), place), "|", color="black", markersize=9)
        offset = {"xytext": (8, 0), "textcoords": "offset points"}
        axes.annotate(f"{middle:.3g}×", (ends[place], place), va="bottom", fontweight="bold", **offset)
        axes.annotate(note, (ends[place], place), va="top", fontsize=8.5, **offset)
    axes.set_yticks(
        range(len(rows)), [f"{quantity}: {short}\nnot {long}" for _, _, (quantity, short, long), *_ in rows], fontsize=9
    )
    axes.set(
        xscale="log",
        xlabel="cost of the long route over that of the short route",
        xlim=(min(1.0, *(row[1].min() for row in rows)), 60 * max(ends)),
    )
    axes.spines[["top", "right"]].set_visible(False)
    vertices = parameters(ds)["n_vertices"]
    networks = f"{ds.sizes['seed']} networks of {vertices} vertices"
    figure.suptitle(
        f"Cost saved by computing only the requested variables ({networks}; blue: time, orange: bytes)", fontsize=11
    )
    return figure


def claims(ds):
    """The cost of every short route on every network, and the difference of its answer from that of the long route."""
    for question in map(str, ds.question.values):
        quantity, short, long = (text.replace("$", "").replace("\\sigma", "σ") for text in WORDS[question])
        seconds, instead, ratio, difference = _times(ds, question)
        yield Claim.tested(
            question, f"{quantity}: {short} costs less than {long}", "not stated",
            f"{np.median(ratio):.3g} times less ({ratio.min():.3g} to {ratio.max():.3g}): {_seconds(seconds)} instead "
            f"of {_seconds(instead)}; answers differ by {_shown(difference)}", bool((ratio > 1).all()),
            "on some network the long route was not slower: the network may be too small",
        )  # fmt: skip
    value = f"{int(ds.bytes_of_scalars.median())} bytes of {int(ds.bytes_of_all.median())} per configuration"
    yield Claim("bytes", "scalars alone store no arrays", "not stated", value, "measured")


def summary(ds):
    """Medians over the networks: seconds of both routes, their ratio, the largest difference, and bytes."""
    table = {}
    for question in map(str, ds.question.values):
        short, long, ratio, difference = _times(ds, question)
        table[question] = {
            "seconds_short": short, "seconds_long": long, "ratio": np.median(ratio), "difference": difference,
        }  # fmt: skip
    stored = {name: int(ds[name].median()) for name in ("bytes_of_scalars", "bytes_of_all")}
    return {"networks": int(ds.sizes["seed"]), "questions": table, **stored}


def _seconds(value):
    """Seconds with a unit that leaves few digits."""
    for factor, unit in ((1e6, "µs"), (1e3, "ms")):
        if value * factor < 1000:
            return f"{value * factor:.3g} {unit}"
    return f"{value:.3g} s"


def _shown(difference):
    if difference == 0:
        return "nothing"
    return f"{100 * difference:.2g} %" if difference > 0.01 else f"{difference:.0e}"
