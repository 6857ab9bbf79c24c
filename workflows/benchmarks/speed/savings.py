"""Cost saved by computing only the requested numbers: a short and a long route to the same ones, from the dataset."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure

from critflow.figures.plot import COLOURS
from critflow.workflow import Claim

from ...shared.reports import duration
from .curves import MAIN_SIZE, curves


class Question(NamedTuple):
    """A quantity, and two methods of a task that compute it; of the long one the first or the most accurate level."""

    quantity: str
    task: str
    short: str
    long: str
    short_words: str
    long_words: str
    first: bool = False


QUESTIONS = {
    "growth": Question(
        "$C_B$", "coefficients", "exact", "line through 16",
        "exact, at the transition", "a line fitted to a strain path", first=True,
    ),
    "member": Question(
        "a member of the ensemble", "member", "C_B alone", "all variables", "$B_0$ and exact $C_B$ alone",
        "all variables",
    ),
    "moduli": Question(
        "$B_0$ at a configuration", "transition_moduli", "closed form", "linear response at γ → 0",
        "sums over the edges", "springs just past the transition",
    ),
    "configuration": Question(
        "the configuration of $\\sigma$", "configuration", "auto", "Hessian of springs",
        "$P$, one matrix for all directions", "the Hessian of springs",
    ),
    "optimum": Question(
        "max $B_0$", "bulk_modulus", "auto", "lbfgs", "closed form", "L-BFGS from a random stress",
    ),
}  # fmt: skip


class Saving(NamedTuple):
    """Sizes, seconds by both routes (n_sizes,), and the error of the answer by the long one (n_sizes,)."""

    sizes: np.ndarray
    short: np.ndarray
    long: np.ndarray
    difference: np.ndarray

    @property
    def ratio(self) -> np.ndarray:
        return self.long / self.short

    @property
    def main(self) -> str:
        """Both times at the main size, and the difference of the answers."""
        n = main_place(self.sizes)
        difference = self.difference[n]
        text = f"{100 * difference:.2g} %" if difference > 0.01 else f"{difference:.0e}" if difference else "nothing"
        return f"{duration(self.short[n])} instead of {duration(self.long[n])}; answers differ by {text}"


def main_place(sizes):
    """The place of the size nearest to the main one."""
    return int(np.abs(np.log(np.asarray(sizes) / MAIN_SIZE)).argmin())


def savings(ds):
    """The savings on every question of which both routes were timed."""
    for name, question in QUESTIONS.items():
        rows = []
        for size, routes in _routes(ds, question.task):
            if {question.short, question.long} <= routes.keys():
                short, long = routes[question.short], routes[question.long]
                level = 0 if question.first else -1
                rows.append((size, short.seconds[-1], long.seconds[level], long.errors[level]))
        if rows:
            yield name, question, Saving(*np.array(rows).T)


def _routes(ds, task):
    """The sizes of a task, and its curves by method at each of them."""
    for size in map(int, ds.n_vertices.values if task in ds.task.values else ()):
        yield size, {curve.name: curve for curve in curves(ds.sel(task=task, n_vertices=size))}


def stored_bytes(ds):
    """Bytes of all numbers and of all variables of one member of the ensemble at the main size, or None."""
    names = ["all numbers", "all variables"]
    if "member" not in ds.task.values or not set(names) <= set(ds.contestant.values):
        return None
    stored = ds.answer_bytes.sel(task="member", contestant=names).transpose("n_vertices", ...).values
    known = stored.all(axis=1)
    return tuple(map(int, stored[known][main_place(ds.n_vertices.values[known])])) if known.any() else None


def savings_figure(ds):
    """Cost of the long over the short route to each quantity, with both times and the error of the long one."""
    rows = []
    for _, question, saving in savings(ds):
        label = f"{question.quantity}: {question.short_words}\nnot {question.long_words}"
        rows.append((saving.ratio[main_place(saving.sizes)], saving.ratio, label, saving.main, COLOURS[0]))
    if stored := stored_bytes(ds):
        ratio = stored[1] / stored[0]
        note = f"{stored[0] / 1000:.2g} kB instead of {stored[1] / 1000:.0f} kB; the same numbers"
        rows.append((ratio, np.array([ratio]), "stored of a member: numbers\nnot all arrays", note, COLOURS[2]))
    rows.sort(key=lambda row: row[0])

    figure = Figure(figsize=(11, 0.75 * len(rows) + 1.3), dpi=110, layout="constrained")
    axes = figure.subplots()
    for place, (middle, ratios, _, note, colour) in enumerate(rows):
        axes.barh(place, middle - 1, left=1, color=colour, height=0.55)
        axes.plot(ratios, np.full(len(ratios), place), "|", color="black", markersize=9)
        offset = {"xytext": (8, 0), "textcoords": "offset points"}
        end = max(1.0, middle, *ratios)
        axes.annotate(f"{middle:.3g}×", (end, place), va="bottom", fontweight="bold", **offset)
        axes.annotate(note, (end, place), va="top", fontsize=8.5, **offset)
    axes.set_yticks(range(len(rows)), [label for _, _, label, *_ in rows], fontsize=9)
    ratios = np.concatenate([[1.0], *(row[1] for row in rows)])
    limits = ratios.min(), 60 * ratios.max()
    axes.set(xscale="log", xlabel="cost of the long route over that of the short route", xlim=limits)
    axes.spines[["top", "right"]].set_visible(False)
    figure.suptitle(
        f"Cost saved by computing only the requested numbers at $N_v$ ≈ {MAIN_SIZE:,} (lines: at every size; blue: "
        "time, orange: bytes)", fontsize=11,
    )  # fmt: skip
    return figure


def saving_claims(ds):
    """The cost of every short route at every size, and the error of the long route."""
    for name, question, saving in savings(ds):
        quantity, short, long = (
            text.replace("$", "").replace("\\sigma", "σ")
            for text in (question.quantity, question.short_words, question.long_words)
        )
        n, ratio = main_place(saving.sizes), saving.ratio
        yield Claim.tested(
            name, f"{quantity}: {short} costs less than {long}", "not stated",
            f"{ratio[n]:.3g} times less at N_v = {saving.sizes[n]:,.0f} ({ratio.min():.3g} to {ratio.max():.3g} at "
            f"{len(ratio)} sizes): {saving.main}", bool((ratio > 1).all()),
            "at some size the long route was not slower: the network may be too small",
        )  # fmt: skip
    if stored := stored_bytes(ds):
        value = f"{stored[0]} bytes of {stored[1]} per configuration"
        yield Claim("bytes", "numbers alone store no arrays", "not stated", value, "measured")


def saving_summary(ds):
    """Sizes, seconds of both routes and the error of the long one, and bytes."""
    questions = {
        name: {
            "n_vertices": saving.sizes.astype(int), "seconds_short": saving.short, "seconds_long": saving.long,
            "ratio": saving.ratio, "difference": saving.difference,
        }
        for name, _, saving in savings(ds)
    }  # fmt: skip
    numbers, everything = stored_bytes(ds) or (None, None)
    return {"questions": questions, "bytes_of_numbers": numbers, "bytes_of_all": everything}
