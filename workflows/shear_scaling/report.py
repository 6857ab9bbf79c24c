"""Figure, claims and summary of the shear modulus against size, threshold and starts, from its dataset alone."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from critflow.figures.plot import COLOURS
from critflow.workflow import Claim

from ..shared.populations import LABELS
from ..shared.power_laws import exponent, shown
from ..shared.reports import parameters, series, spread, status_counts

# An objective within this relative distance of the best one found counts as the best.
BEST = 1e-6
STYLES = (":", "--", "-", "-.")


def scaling_figure(ds):
    """G_0 against size by population, against the threshold by size, and against the number of starts."""
    figure = Figure(figsize=(13, 4.4), dpi=110, layout="constrained")
    by_size, by_threshold, by_start = figure.subplots(1, 3, width_ratios=(1.25, 1, 1))
    _draw_sizes(by_size, ds)
    _draw_thresholds(by_threshold, ds)
    _draw_starts(by_start, ds)
    for axes, letter in zip(figure.axes, "ABC", strict=True):
        axes.set_title(letter, loc="left", fontweight="bold")
        axes.spines[["top", "right"]].set_visible(False)
    figure.suptitle(
        "Only networks optimised for it keep a shear modulus; lower thresholds raise it, more starts hardly do "
        f"({ds.sizes['seed']} networks a size)",
        fontsize=11,
    )
    return figure


def _draw_sizes(axes, ds):
    sizes = ds.n_vertices.values
    for place, population in enumerate(map(str, ds.population.values)):
        values = ds.shear_modulus_0.sel(population=population).transpose("n_vertices", "seed").values
        fit, optimised, style = exponent(sizes, values), population == "shear_modulus", series(place)
        axes.errorbar(
            sizes * (1 + 0.02 * (place - 3)), np.nanmean(values, 1), np.nanstd(values, 1) / np.sqrt(values.shape[1]),
            linestyle="none", **style, markersize=5, capsize=2,
            markerfacecolor="none" if optimised else style["color"],
            label=f"{LABELS[population]}: {fit[0]:.2f} [{fit[1]:.2f}, {fit[2]:.2f}]",
        )  # fmt: skip
    middle = np.nanmean(ds.shear_modulus_0.sel(population=_isotropic(ds)).isel(n_vertices=-1).values)
    axes.plot(sizes, middle * sizes[-1] / sizes, color="0.5", linestyle=":", zorder=0)
    axes.text(0.03, 0.03, "dotted: $\\propto 1/N_v$", color="0.35", transform=axes.transAxes)
    axes.set(xscale="log", yscale="log", xlabel="number of vertices $N_v$", ylabel="shear modulus $G_0$  [$k$]")
    low, high = axes.get_ylim()
    axes.set_ylim(low / 3, high * 150)
    axes.legend(
        fontsize=8, frameon=False, loc="upper right", ncols=2, columnspacing=1.0, handletextpad=0.2,
        title="exponent [95 %]", title_fontsize=8,
    )  # fmt: skip


def _draw_thresholds(axes, ds):
    sizes = ds.n_vertices.values
    axes.axhline(float(ds.bound.mean()), color="0.25", linestyle="--", linewidth=1.2)
    axes.text(ds.threshold.values.min(), 1.02 * float(ds.bound.mean()), "bound for any stress", fontsize=8.5)
    for colour, style, size in zip(COLOURS[::2], STYLES, _shown_sizes(sizes), strict=False):
        values = ds.shear_modulus_of_threshold.sel(n_vertices=size)
        mean, width = values.mean("seed"), values.std("seed")
        axes.fill_between(ds.threshold, mean - width, mean + width, color=colour, alpha=0.2, linewidth=0)
        axes.plot(ds.threshold, mean, style, color=colour, linewidth=1.8, label=f"$N_v$ = {size}")
    axes.set(
        xscale="log", xlabel="least stress $r$  (mean square 1)", ylabel="shear modulus $G_0$ of max $G_0$  [$k$]",
        ylim=(0, 1.15 * float(ds.bound.mean())),
    )  # fmt: skip
    axes.set_xticks([0.01, 0.03, 0.1, 0.3, 0.7], ["0.01", "0.03", "0.1", "0.3", "0.7"])
    axes.minorticks_off()
    axes.legend(fontsize=8.5, frameon=False, loc="center right")


def _draw_starts(axes, ds):
    sizes = ds.n_vertices.values
    for place, size in enumerate(sizes):
        objectives = ds.sel(n_vertices=size).objective_of_start.values
        deficit = 100 * (1 - expected_best(objectives[np.isfinite(objectives).all(axis=1)]))
        starts = np.arange(1, deficit.shape[1])
        axes.plot(
            starts, deficit.mean(0)[:-1], **series(place), markersize=4,
            label=f"$N_v$ = {size}",
        )  # fmt: skip
    axes.set(xlabel="number of starts", ylabel="mean deficit against the best of all  [%]", yscale="log")
    axes.set_ylim(1e-4, None)
    axes.legend(fontsize=8.5, frameon=False)


def _isotropic(ds):
    return [str(p) for p in ds.population.values if p != "shear_modulus"]


def _shown_sizes(sizes):
    """The three sizes of the paper, or the first three sizes of the run."""
    return [size for size in (100, 500, 1000) if size in sizes] or list(sizes[:3])


def expected_best(objectives):
    """Expected best of n random starts over the best of all, (networks, n): the mean over all orders of the starts."""
    order = np.sort(objectives, axis=1)
    n = order.shape[1]
    best = np.empty_like(order)
    for picked in range(1, n + 1):
        best[:, picked - 1] = order @ _largest_of(n, picked)
    return best / order[:, -1:]


def _largest_of(n, picked):
    """Probability that the i-th smallest of n is the largest of `picked` drawn without return, (n,)."""
    i = np.arange(1, n + 1)
    below = np.ones(n)
    for j in range(picked):
        below *= np.maximum(i - j, 0) / (n - j)
    return np.diff(np.concatenate([[0.0], below]))


def claims(ds):
    """The statements of the paper on the constrained shear modulus."""
    sizes = ds.n_vertices.values
    if len(sizes) > 1:
        yield from _size_claims(ds, sizes)
    mean = ds.shear_modulus_of_threshold.mean("seed")
    falling = bool((mean.diff("threshold") < 0).all())
    text = ", ".join(f"{float(mean.isel(n_vertices=-1, threshold=n)):.3g} at r = {r:g}" for n, r in _every_other(ds))
    yield Claim.tested(
        "ShearModulusScaling-B", "a lower threshold gives a larger shear modulus", "decreasing in r", text, falling,
        "the means are not in that order",
    )  # fmt: skip
    edge = ds.longest_edge_of_threshold.mean("seed").isel(n_vertices=-1)
    yield Claim.tested(
        "ShearModulusScaling-alignment", "a lower threshold lets the network align further: its longest edge grows",
        "increasing alignment", f"longest edge over the side of the box {float(edge[0]):.2g} at "
        f"r = {float(ds.threshold[0]):g}, {float(edge[-1]):.2g} at r = {float(ds.threshold[-1]):g}",
        bool(edge[0] > edge[-1]), "the longest edges do not grow",
    )  # fmt: skip
    if ds.sizes["start"] > 1 and np.isfinite(ds.objective_of_start).any():
        yield _start_claim(ds)
    if "shear_modulus" in ds.population.values:
        part = 100 * ds.shear_modulus_0.sel(population="shear_modulus") / ds.bound
        yield Claim(
            "ShearModulusScaling-bound", "how far the constrained optimum stays below the closed-form bound",
            "not stated", f"at r = {parameters(ds)['threshold']:g} it has {spread(part, 3)} % of the bound; "
            f"{spread(100 * ds.shear_modulus_of_threshold.isel(threshold=0) / ds.bound, 3)} % at "
            f"r = {float(ds.threshold[0]):g}", "measured",
        )  # fmt: skip


def _size_claims(ds, sizes):
    for population in map(str, ds.population.values):
        values = ds.shear_modulus_0.sel(population=population).transpose("n_vertices", "seed").values
        fit = exponent(sizes, values)
        if population == "shear_modulus":
            last = np.nanmean(values[-1])
            yield Claim.tested(
                "ShearModulusScaling-A-shear_modulus", "max G_0 keeps a finite shear modulus, independent of size",
                "exponent 0", f"exponent {shown(fit)}; {last:.4f} at N_v = {sizes[-1]}", abs(fit[0]) < 0.05,
                "it changes with size",
            )  # fmt: skip
        else:
            inside = fit[1] - 0.05 <= -1 <= fit[2] + 0.05
            yield Claim.tested(
                f"ShearModulusScaling-A-{population}", f"the shear modulus of {population} falls as 1/N_v",
                "exponent -1", f"exponent {shown(fit)}", inside,
                "the interval leaves −1 out; values spread over decades among networks, so few of them rule the mean",
            )  # fmt: skip


def _start_claim(ds):
    known = ds.dropna("seed", subset=["objective_of_start"])
    objectives = known.objective_of_start.transpose("n_vertices", "seed", "start").values
    best = objectives.max(axis=2, keepdims=True)
    share = 100 * np.mean(objectives > best * (1 - BEST), axis=(1, 2))
    spread = 100 * np.mean((best - objectives.min(axis=2, keepdims=True)) / best, axis=(1, 2))
    first = 100 * np.mean((best[..., 0] - objectives[..., 0]) / best[..., 0], axis=1)
    text = "; ".join(
        f"N_v = {size}: {part:.0f} % of starts reach the best, they differ by {wide:.1f} % at most, σ = 1 lies "
        f"{gap:.2f} % below it"
        for size, part, wide, gap in zip(ds.n_vertices.values, share, spread, first, strict=True)
    )
    return Claim(
        "ShearModulus+Constraint-starts", "how many starts find the best local optimum", "not stated",
        f"of {ds.sizes['start']} starts (means over {known.sizes['seed']} networks) {text}", "measured",
    )  # fmt: skip


def _every_other(ds):
    return [(n, float(r)) for n, r in enumerate(ds.threshold.values)][::2]


def summary(ds):
    """Scalars for tables: means by size, population and threshold, and how the solves ended."""
    return {
        "networks": ds.sizes["seed"],
        "parameters": parameters(ds),
        **{name: status_counts(ds[name].values) for name in ("population_status", "threshold_status")},
        "shear_modulus_0": {
            str(p): ds.shear_modulus_0.sel(population=p).mean("seed").values for p in ds.population.values
        },
        "shear_modulus_of_threshold": {
            f"{float(r):g}": ds.shear_modulus_of_threshold.sel(threshold=r).mean("seed").values
            for r in ds.threshold.values
        },
        "n_vertices": ds.n_vertices.values,
        "bound": ds.bound.mean("seed").values,
    }
