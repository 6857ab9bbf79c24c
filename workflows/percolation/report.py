"""Figures and claims on the spread of rest lengths: stressed edges by size, bulk modulus and C_B by both methods."""

import numpy as np
from matplotlib.figure import Figure

from critflow.result import Status
from critflow.workflow import Claim, stable_rng

from ..shared.figures import legend_below, lettered, panels
from ..shared.power_laws import shown
from ..shared.reports import series

# The spread that the paper prints as the largest with every edge stressed.
PRINTED_SPREAD = 0.3
# B_0 of random rest lengths over the largest: the "about 10 %" below it of the paper, with half of that as margin.
PRINTED_BULK, BULK_TOLERANCE = 0.9, 0.05
_RESAMPLED = 500  # ensembles behind the interval of the power


def curve(ds):
    """Part of the networks with every edge stressed, mean part of slack edges and networks, (size, spread) each."""
    stressed = ds.stressed_fraction.transpose("n_vertices", "spread", "seed")
    return percolating(ds).mean("seed").values, 1 - stressed.mean("seed").values, stressed.count("seed").values


def percolating(ds):
    """Whether every edge of a network is stressed, (size, spread, network)."""
    full = (ds.solve_status == Status.ok).where(ds.stressed_fraction.notnull())
    return full.transpose("n_vertices", "spread", "seed")


def half_point(spreads, full):
    """The spread at which half of the networks have every edge stressed, between two that were run; else NaN."""
    below = np.flatnonzero(full < 0.5)
    if not len(below) or below[0] == 0:
        return np.nan
    last = below[0] - 1
    part = (full[last] - 0.5) / (full[last] - full[last + 1])
    return float(spreads[last] + part * (spreads[last + 1] - spreads[last]))


def threshold_interval(ds):
    """The 95 % interval of this power when the networks are drawn again with repetition."""
    full, spreads = percolating(ds).values, ds.spread.values
    picks = stable_rng(full.shape[2], "threshold").integers(0, full.shape[2], (_RESAMPLED, full.shape[2]))
    powers = []
    for pick in picks:
        rows = np.nanmean(full[:, :, pick], axis=2)
        powers.append(threshold_power(ds.n_vertices.values, np.array([half_point(spreads, row) for row in rows])))
    return tuple(np.nanquantile(powers, (0.025, 0.975)))


def threshold_power(sizes, halves):
    """The power of N_v with which the half point falls, by least squares of logarithms; NaN for less than two."""
    known = np.isfinite(halves)
    if known.sum() < 2:
        return np.nan
    return float(np.polyfit(np.log(sizes[known]), np.log(halves[known]), 1)[0])


def percolation_figure(ds):
    """Part of the networks with every edge stressed, and part of slack edges."""
    figure = Figure(figsize=(11, 4.4), dpi=110, layout="constrained")
    whole, edges = figure.subplots(1, 2)
    full, slack, counts = curve(ds)
    sizes, spreads = ds.n_vertices.values, ds.spread.values
    halves = np.array([half_point(spreads, row) for row in full])
    for row, (size, half) in enumerate(zip(sizes, halves, strict=True)):
        style = {**series(row), "markersize": 4, "linewidth": 1.3}
        label = f"$N_v$ = {size}" + (f":  $s_{{1/2}}$ = {half:.3f}" if np.isfinite(half) else "")
        error = np.sqrt(np.maximum(full[row] * (1 - full[row]), 0.25 / counts[row]) / counts[row])
        whole.fill_between(spreads, full[row] - error, full[row] + error, color=style["color"], alpha=0.12, linewidth=0)
        whole.plot(spreads, full[row], label=label, **style)
        edges.plot(spreads, np.where(slack[row] > 0, slack[row], np.nan), **style)
    whole.axvline(PRINTED_SPREAD, color="0.3", linestyle="--", linewidth=1)
    whole.text(PRINTED_SPREAD + 0.005, 0.97, "printed in\nthe paper", fontsize=8.5, va="top")
    whole.set(xlabel="spread of rest lengths $s$", ylabel="networks with every edge stressed", ylim=(-0.03, 1.05))
    edges.set(xlabel="spread of rest lengths $s$", ylabel="part of slack edges", yscale="log")
    lines = whole.get_legend_handles_labels()
    figure.legend(*lines, fontsize=9, frameon=False, loc="center right", bbox_to_anchor=(1, 0.4))
    lettered(*figure.axes)
    figure.suptitle(
        "Full percolation of stress is lost at ever smaller spreads of rest lengths as networks grow",
        fontsize=11,
    )
    return figure


SPREAD_PANELS = {
    "bulk": "$B_0$ / largest possible", "stressed_fraction": "part of stressed edges", "C_B": "$C_B$  [k]"
}  # fmt: skip


def of_largest(ds):
    """The largest networks, those that were strained."""
    large = ds.isel(n_vertices=int(ds.n_vertices.values.argmax()))
    strained = large.strained_solve_status.isin([Status.missing]).all("spread")
    return large.isel(seed=np.flatnonzero(~strained.values))


def spread_figure(ds):
    """B_0, stressed part and C_B against the spread, by the cone program and by the protocol of the paper."""
    large, spreads = of_largest(ds), ds.spread.values
    size, count = int(large.n_vertices), large.sizes["seed"]
    figure, panels_ = panels(3, f"Random rest lengths by two methods: {count} networks, $N_v$ = {size:,}", height=3.9)
    for axes, (name, label) in zip(panels_, SPREAD_PANELS.items(), strict=True):
        for n, (prefix, method) in enumerate((("", "cone program"), ("strained_", "strain protocol of the paper"))):
            values = large[prefix + name].transpose("spread", "seed").values
            known = np.isfinite(values).any(axis=1)
            low, middle, high = np.nanquantile(values[known], (0.1, 0.5, 0.9), axis=1)
            style = {**series(n), "markersize": 4, "linewidth": 1.3, "linestyle": ("-", "--")[n]}
            axes.plot(spreads[known], middle, label=method, **style)
            axes.fill_between(spreads[known], low, high, color=style["color"], alpha=0.15, linewidth=0)
        axes.axvline(PRINTED_SPREAD, color="0.3", linestyle=":", linewidth=1)
        axes.set(xlabel="spread of rest lengths $s$", ylabel=label, xlim=(0, spreads.max()))
    left, middle, right = panels_
    left.axhline(PRINTED_BULK, color="0.3", linestyle=":", linewidth=1)
    left.text(0.98, PRINTED_BULK + 0.01, "paper: 0.9", fontsize=8.5, ha="right", transform=left.get_yaxis_transform())
    left.text(PRINTED_SPREAD + 0.01, 0.02, "paper: $s$ = 0.3", fontsize=8.5, transform=left.get_xaxis_transform())
    left.set_ylim(0, 1)
    right.axhline(0, color="0.6", linewidth=0.8)
    lettered(*panels_)
    legend_below(figure, left, ncols=2)
    return figure


def claims(ds):
    """The bulk modulus and the stressed part at the printed spread, and the largest spread with every edge stressed."""
    yield from printed_claims(ds)
    sizes = ds.n_vertices.values
    halves = np.array([half_point(ds.spread.values, row) for row in curve(ds)[0]])
    text = ", ".join(f"s = {half:.3f} at N_v = {size}" for half, size in zip(halves, sizes, strict=True))
    yield Claim.tested(
        "percolation-threshold", "every edge is stressed up to a spread of rest lengths of 0.3",
        f"s = {PRINTED_SPREAD}", f"half of the networks lose it at {text}", halves[-1] >= PRINTED_SPREAD,
        "the text describes full percolation, which ends far below the spread it prints",
        criterion=f"half of the largest networks percolate at {PRINTED_SPREAD}", kind="paper",
    )  # fmt: skip
    yield Claim(
        "percolation-size", "how full percolation depends on size", "not stated",
        "the spread at which half of the networks lose it changes as N_v^p, p = "
        + shown((threshold_power(sizes, halves), *threshold_interval(ds))), "measured",
        sample=f"{ds.sizes['seed']} networks a size",
    )  # fmt: skip


def printed_claims(ds):
    """What the paper says of its printed spread, by both methods, and the spread at which the bulk modulus agrees."""
    large, sample = of_largest(ds), of_largest(ds).sizes["seed"]
    size, spreads = int(large.n_vertices), ds.spread.values
    found = {
        name: large[name].median("seed").values for name in ("bulk", "strained_bulk", "strained_stressed_fraction")
    }
    at = int(np.argmin(np.abs(spreads - PRINTED_SPREAD)))
    below = found["bulk"] < PRINTED_BULK - BULK_TOLERANCE
    agreeing = (spreads[: int(np.argmax(below))] if below.any() else spreads).max(initial=0.0)
    networks = f"{sample} networks, N_v = {size}"
    yield Claim.tested(
        "percolation-bulk", "at a spread of 0.3 B_0 is about 10 % below its largest value", f"{PRINTED_BULK}",
        f"cone program {found['bulk'][at]:.2f}, strain protocol {found['strained_bulk'][at]:.2f}; within "
        f"{BULK_TOLERANCE} of {PRINTED_BULK} up to s = {agreeing:g}",
        abs(found["strained_bulk"][at] - PRINTED_BULK) <= BULK_TOLERANCE,
        "both methods agree, so that the value belongs to a narrower spread than the one printed",
        criterion=f"median by the protocol of the paper within {BULK_TOLERANCE}", sample=networks, kind="paper",
    )  # fmt: skip
    stressed = found["strained_stressed_fraction"][at]
    yield Claim.tested(
        "percolation-protocol", "the strain protocol of the paper stresses every edge at a spread of 0.3", "all edges",
        f"{100 * stressed:.1f} % of the edges", stressed == 1,
        "the other edges are slack at the transition and slightly compressed where the protocol stops",
        criterion="every edge of the median network", sample=networks, kind="paper",
    )  # fmt: skip
