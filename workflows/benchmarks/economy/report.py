"""Figure, claims and summary of what asking for less spares, read off its dataset alone."""

from __future__ import annotations

import json

import numpy as np
from matplotlib.figure import Figure

from critflow.plot import COLOURS
from critflow.workflow import Claim

# Question: what is asked for, how the short way answers, and how the long way does.
WORDS = {
    "growth": ("$C_B$", "exact, at the transition", "a line fitted to a strain path"),
    "member": ("a member of the ensemble", "$B_0$ and exact $C_B$ alone", "all variables"),
    "moduli": ("$B_0$ at a configuration", "sums over the edges", "springs just past the transition"),
    "configuration": ("the configuration of $\\sigma$", "$P$, one matrix for all directions", "the Hessian of springs"),
    "optimum": ("max $B_0$", "closed form", "L-BFGS from a random stress"),
}


def _times(ds, question):
    """Seconds by both ways, their ratio for every network, and the largest difference of the answers."""
    one = ds.sel(question=question)
    short, long = one.seconds_short.values, one.seconds_long.values
    return np.nanmedian(short), np.nanmedian(long), long / short, float(one.difference.max())


def ratio_figure(ds):
    """How many times less each short way costs, with the times of both and the difference of their answers."""
    rows = []
    for question in map(str, ds.question.values):
        short, long, ratio, difference = _times(ds, question)
        told = f"{_seconds(short)} instead of {_seconds(long)}; answers differ by {_shown(difference)}"
        rows.append((np.nanmedian(ratio), ratio, WORDS[question], told, COLOURS[0]))
    stored = (ds.bytes_of_all / ds.bytes_of_scalars).values
    kilobytes = [float(ds[name].median()) / 1000 for name in ("bytes_of_scalars", "bytes_of_all")]
    told = f"{kilobytes[0]:.2g} kB instead of {kilobytes[1]:.0f} kB; the same numbers"
    rows.append((np.median(stored), stored, ("stored of a member", "scalars", "all arrays"), told, COLOURS[2]))
    rows.sort(key=lambda row: row[0])

    figure = Figure(figsize=(11, 0.75 * len(rows) + 1.3), dpi=110, layout="constrained")
    axes = figure.subplots()
    ends = [max(1.0, row[0], *row[1]) for row in rows]
    for place, (middle, ratios, _, told, colour) in enumerate(rows):
        axes.barh(place, middle - 1, left=1, color=colour, height=0.55)
        axes.plot(ratios, np.full(len(ratios), place), "|", color="black", markersize=9)
        beside = {"xytext": (8, 0), "textcoords": "offset points"}
        axes.annotate(f"{middle:.3g}×", (ends[place], place), va="bottom", fontweight="bold", **beside)
        axes.annotate(told, (ends[place], place), va="top", fontsize=8.5, **beside)
    axes.set_yticks(
        range(len(rows)), [f"{what}: {short}\nnot {long}" for _, _, (what, short, long), *_ in rows], fontsize=9
    )
    axes.set(
        xscale="log",
        xlabel="cost of the long way over that of the short way",
        xlim=(min(1.0, *(row[1].min() for row in rows)), 60 * max(ends)),
    )
    axes.spines[["top", "right"]].set_visible(False)
    vertices = json.loads(ds.attrs["parameters"])["n_vertices"]
    networks = f"{ds.sizes['seed']} networks of {vertices} vertices"
    figure.suptitle(f"Asking for no more than is needed ({networks}; blue: time, orange: bytes)", fontsize=11)
    return figure


def read_claims(ds):
    """Whether every short way costs less on every network, and how far its answer is from that of the long one."""
    claims = []
    for question in map(str, ds.question.values):
        what, short, long = (text.replace("$", "").replace("\\sigma", "σ") for text in WORDS[question])
        seconds, instead, ratio, difference = _times(ds, question)
        cheaper = bool((ratio > 1).all())
        value = (
            f"{np.median(ratio):.3g} times less ({ratio.min():.3g} to {ratio.max():.3g}): {_seconds(seconds)} instead "
            f"of {_seconds(instead)}; answers differ by {_shown(difference)}"
        )
        because = "" if cheaper else "on some network the long way was not slower here: the network may be too small"
        statement = f"{what}: {short} costs less than {long}"
        claims.append(Claim(question, statement, "not stated", value, "holds" if cheaper else "differs", because))
    value = f"{int(ds.bytes_of_scalars.median())} bytes of {int(ds.bytes_of_all.median())} per configuration"
    claims.append(Claim("bytes", "scalars alone store no arrays", "not stated", value, "measured"))
    return claims


def summary(ds):
    """Medians over the networks: seconds by both ways, their ratio, the largest difference, and bytes."""
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
