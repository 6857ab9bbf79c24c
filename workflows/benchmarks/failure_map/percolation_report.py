"""The percolation curve: figure, half points and claims on the spread of rest lengths at which edges fall slack."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from critflow.figures.plot import COLOURS
from critflow.workflow import Claim

# The spread that the paper prints as the largest with every edge stressed.
PRINTED_SPREAD = 0.3


def percolation_figure(ds):
    """Part of the networks with every edge stressed, part of slack edges, and the curves of all sizes rescaled."""
    figure = Figure(figsize=(13.5, 4.4), dpi=110, layout="constrained")
    curve = percolation_curve(ds)
    if curve is None:
        return figure
    full, slack, sizes, spreads, counts = curve
    whole, edges, collapse = figure.subplots(1, 3)
    halves = np.array([half_point(spreads, row) for row in full])
    for row, size in enumerate(sizes):
        style = {"color": COLOURS[row % len(COLOURS)], "marker": "osD^v<>"[row % 7], "markersize": 4, "linewidth": 1.3}
        half = halves[row]
        label = f"$N_v$ = {size}" + (f":  $s_{{1/2}}$ = {half:.3f}" if np.isfinite(half) else "")
        error = np.sqrt(np.maximum(full[row] * (1 - full[row]), 0.25 / counts[row]) / counts[row])
        whole.fill_between(spreads, full[row] - error, full[row] + error, color=style["color"], alpha=0.12, linewidth=0)
        whole.plot(spreads, full[row], label=label, **style)
        edges.plot(spreads, np.where(slack[row] > 0, slack[row], np.nan), **style)
        collapse.plot(spreads / half, full[row], **style)
    whole.axvline(PRINTED_SPREAD, color="0.3", linestyle="--", linewidth=1)
    whole.text(PRINTED_SPREAD + 0.005, 0.97, "printed in\nthe paper", fontsize=8.5, va="top")
    whole.set(xlabel="spread of rest lengths $s$", ylabel="networks with every edge stressed", ylim=(-0.03, 1.05))
    edges.set(xlabel="spread of rest lengths $s$", ylabel="slack edges", yscale="log")
    figure.legend(
        *whole.get_legend_handles_labels(), fontsize=9, frameon=False, loc="center right", bbox_to_anchor=(1, 0.55)
    )
    power = threshold_power(sizes, halves)
    collapse.axvline(1, color="0.6", linestyle=":", linewidth=1)
    collapse.set(xlabel="$s / s_{1/2}(N_v)$", ylabel="networks with every edge stressed", xlim=(0, 2.5))
    if np.isfinite(power):
        collapse.text(0.97, 0.95, rf"$s_{{1/2}} \propto N_v^{{{power:.2f}}}$", ha="right", va="top", fontsize=10,
                      transform=collapse.transAxes)  # fmt: skip
    for axes, letter in zip((whole, edges, collapse), "ABC", strict=True):
        axes.set_title(letter, loc="left", fontweight="bold")
        axes.spines[["top", "right"]].set_visible(False)
    figure.suptitle(
        "Full percolation of stress is lost at ever smaller spreads of rest lengths as networks grow",
        fontsize=11,
    )
    return figure


def percolation_curve(ds):
    """Part percolating and part slack (size, spread), sizes, spreads and networks (size, spread), over all seeds."""
    if "percolation" not in ds.difficulty.values:
        return None
    one = ds.sel(difficulty="percolation").transpose("seed", "size", "spread", ...)
    weights = one.networks_solved.values
    counts = weights.sum(axis=0)
    if not counts.all():
        return None
    full, stressed = (
        (one[name].values * weights).sum(axis=0) / counts for name in ("percolating", "stressed_fraction")
    )
    return full, 1 - stressed, ds["size"].values, ds.spread.values, counts


def half_point(spreads, full):
    """The spread at which half of the networks have every edge stressed, between two that were run; else NaN."""
    below = np.flatnonzero(full < 0.5)
    if not len(below) or below[0] == 0:
        return np.nan
    last = below[0] - 1
    part = (full[last] - 0.5) / (full[last] - full[last + 1])
    return float(spreads[last] + part * (spreads[last + 1] - spreads[last]))


def threshold_power(sizes, halves):
    """The power of N_v with which the half point falls, by least squares of logarithms; NaN for less than two."""
    known = np.isfinite(halves)
    if known.sum() < 2:
        return np.nan
    return float(np.polyfit(np.log(sizes[known]), np.log(halves[known]), 1)[0])


def percolation_claims(full, slack, sizes, spreads, counts):
    halves = np.array([half_point(spreads, row) for row in full])
    text = ", ".join(f"s = {half:.3f} at N_v = {size}" for half, size in zip(halves, sizes, strict=True))
    largest = float(halves[-1])
    agrees = bool(largest >= PRINTED_SPREAD)
    yield Claim(
        "percolation-threshold", "every edge is stressed up to a spread of rest lengths of 0.3",
        f"s = {PRINTED_SPREAD}", f"half of the networks lose it at {text}", "holds" if agrees else "differs",
        "" if agrees else "the text describes full percolation, which ends far below the spread it prints",
    )  # fmt: skip
    power = threshold_power(sizes, halves)
    yield Claim(
        "percolation-size", "how full percolation depends on size", "not stated",
        f"the spread at which half of the networks lose it changes as N_v^{power:.2f}", "measured",
    )  # fmt: skip
