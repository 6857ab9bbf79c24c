"""Figure, claims and summary of the cost of every stage against size, from the dataset alone."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from critflow.figures.plot import COLOURS
from critflow.result import Status
from critflow.workflow import Claim

from ...shared.power_laws import exponent
from ...shared.reports import MARKERS

# The stages that are drawn, their parts, and their names.
SHOWN = {
    "generation": (("points", "tessellation"), "generation"),
    "analysis": (("analysis",), "first analysis"),
    "configuration": (("configuration",), "configuration"),
    "checked": (("checked",), "… with error bound"),
    "gradient": (("gradient",), "gradient"),
    "optimum": (("optimum", "moduli"), "best $B_0$, certified"),
    "coefficients": (("coefficients",), "exact $C_B$, $C_G$"),
}
COLOUR_OF = dict(zip(SHOWN, COLOURS, strict=False))
# Exponents are fitted from this size on, where fixed costs are negligible.
FIRST_FITTED = 10_000
GENERATION, MEMORY, EXPONENT, GAP, MILLION = 10.0, 8000.0, 1.2, 1e-10, 1_000_000


def seconds(ds, stage):
    """Wall time of a stage that is drawn, (n_sizes, n_networks)."""
    return ds.seconds.sel(stage=list(SHOWN[stage][0])).sum("stage", skipna=False).transpose("n_vertices", "seed").values


def fitted(ds, stage, first=FIRST_FITTED):
    """Exponent of the time of a stage over the sizes from `first` on, NaN for fewer than two."""
    large = ds.sel(n_vertices=ds.n_vertices >= first)
    if large.sizes["n_vertices"] < 2:
        return np.nan
    return exponent(large.n_vertices.values, seconds(large, stage), np.nanmedian)[0]


def scale_figure(ds):
    """Time against size with exponents, memory against size, and the shares of the stages at the ends."""
    figure = Figure(figsize=(13, 5.2), dpi=110, layout="constrained")
    by_time, by_memory, by_share = figure.subplots(1, 3, width_ratios=(1.25, 0.75, 1.1))
    _draw_times(by_time, ds)
    _draw_memory(by_memory, ds)
    _draw_shares(by_share, ds)
    for axes, letter in zip(figure.axes, "ABC", strict=True):
        axes.set_title(letter, loc="left", fontweight="bold")
        axes.spines[["top", "right"]].set_visible(False)
    by_share.spines["left"].set_visible(False)
    power, largest = fitted(ds, "configuration"), int(ds.n_vertices[-1])
    figure.suptitle(
        f"{largest:,} vertices: made in {_time(np.median(seconds(ds, 'generation')[-1]))}, a configuration in "
        f"{_time(np.median(seconds(ds, 'configuration')[-1]))}"
        + ("" if np.isnan(power) else f", which grows as $N_v^{{{power:.2f}}}$"),
        fontsize=11,
    )
    return figure


def _draw_times(axes, ds):
    sizes = ds.n_vertices.values
    for stage, marker in zip(SHOWN, MARKERS, strict=True):
        power = fitted(ds, stage)
        label = SHOWN[stage][1] + ("" if np.isnan(power) else f": {power:.2f}")
        axes.plot(
            sizes, np.median(seconds(ds, stage), axis=1), marker=marker, color=COLOUR_OF[stage], markersize=5,
            linewidth=2.6 if stage == "configuration" else 1.4, label=label,
        )  # fmt: skip
    axes.set(xscale="log", yscale="log", xlabel="number of vertices $N_v$", ylabel="wall time  [s]")
    low, high = axes.get_ylim()
    axes.set_ylim(low, high * 60)
    handles, labels = axes.get_legend_handles_labels()
    last = [np.median(seconds(ds, stage)[-1]) for stage in SHOWN]
    order = np.argsort(last)[::-1]
    axes.legend(
        [handles[n] for n in order], [labels[n] for n in order], fontsize=8.5, frameon=False, loc="upper left",
        ncols=2, columnspacing=1.0, handletextpad=0.4, title_fontsize=8.5,
        title=f"exponent of $N_v$ from {FIRST_FITTED:,} on, slowest first" if sizes[-1] > FIRST_FITTED else None,
    )  # fmt: skip


def _draw_memory(axes, ds):
    sizes = ds.n_vertices.values
    memory = ds.memory.max("stage").max("seed").values / 1e3
    axes.plot(sizes, memory, marker="o", color=COLOURS[0], linewidth=2)
    axes.axhline(MEMORY / 1e3, color="0.25", linestyle="--", linewidth=1.2)
    axes.text(sizes[0], 1.08 * MEMORY / 1e3, f"allowed: {MEMORY / 1e3:g} GB", fontsize=9)
    axes.annotate(
        f"{memory[-1]:.2g} GB", (sizes[-1], memory[-1]), xytext=(-6, 6), textcoords="offset points", ha="right",
        fontsize=9,
    )  # fmt: skip
    axes.set(
        xscale="log", yscale="log", xlabel="number of vertices $N_v$", ylabel="peak resident memory  [GB]",
        ylim=(None, 2.2 * MEMORY / 1e3),
    )  # fmt: skip


def _draw_shares(axes, ds):
    sizes = ds.n_vertices.values
    ends = list(dict.fromkeys((0, len(sizes) - 1)))
    for row, n in enumerate(ends):
        shares, left = share(ds, n), 0.0
        for stage, part in shares.items():
            axes.barh(row, 100 * part, left=100 * left, height=0.55, color=COLOUR_OF[stage], edgecolor="white")
            if part > 0.045:
                axes.text(
                    100 * (left + part / 2), row, f"{100 * part:.0f}", ha="center", va="center", fontsize=9,
                    color="white" if _dark(COLOUR_OF[stage]) else "black",
                )  # fmt: skip
            if part > 0.1:
                axes.text(
                    100 * (left + part / 2), row + 0.31, SHOWN[stage][1], ha="left", va="bottom", fontsize=8.5,
                    rotation=35, rotation_mode="anchor",
                )  # fmt: skip
            left += part
        axes.text(
            0, row - 0.31, f"$N_v$ = {sizes[n]:,}: {_time(sum(np.median(seconds(ds, s)[n]) for s in SHOWN))} in all",
            va="top", fontsize=9.5,
        )  # fmt: skip
    axes.set(xlim=(0, 100), ylim=(-0.6, len(ends) - 0.1), yticks=[], xlabel="part of the time of all stages  [%]")


def share(ds, n):
    """Part of the time of all stages that each takes at the n-th size."""
    times = {stage: float(np.median(seconds(ds, stage)[n])) for stage in SHOWN}
    return {stage: taken / sum(times.values()) for stage, taken in times.items()}


def claims(ds):
    """The required and the measured exponents, times, memory and certificates."""
    sizes = ds.n_vertices.values
    most = int(sizes[-1])
    if not np.isnan(power := fitted(ds, "configuration")):
        solvers = _solvers(ds, "configuration")
        yield Claim.tested(
            "Scale-configuration", "the time of a configuration grows at most as N_v^1.2",
            f"at most {EXPONENT} required", f"exponent {power:.2f} from {_first(sizes):,} to {most:,} vertices "
            f"({solvers})", power <= EXPONENT, f"the factorisation fills in more with {solvers}",
        )  # fmt: skip
    made = float(np.median(seconds(ds, "generation")[-1]))
    busy = sum(_median(ds, stage, "processor_seconds") for stage in SHOWN["generation"][0])
    if most == MILLION:
        yield Claim.tested(
            "Scale-generation", "a network of a million vertices is made in ten seconds", f"{GENERATION:g} s required",
            f"{made:.1f} s, of which points {_median(ds, 'points'):.1f} s and tessellation "
            f"{_median(ds, 'tessellation'):.1f} s; {busy:.1f} s of the processor", made <= GENERATION,
            "the trials of random sequential addition and one call of Qhull take most of it, in addition to "
            "other work of the machine",
        )  # fmt: skip
    memory = float(ds.memory.max())
    yield Claim.tested(
        "Scale-memory", f"all stages up to {most:,} vertices fit in memory", f"{MEMORY / 1e3:g} GB required",
        f"{memory / 1e3:.2g} GB, most of it for {_largest_stage(ds)}", memory <= MEMORY,
        "the factor of that stage is too large",
    )  # fmt: skip
    gap = float(np.abs(ds.gap).max())
    yield Claim.tested(
        "Scale-certificate", "the optimum of B_0 meets its closed-form bound at every size", "equal",
        f"largest gap {gap:.1g}", gap < GAP, "rounding keeps them apart",
    )  # fmt: skip
    good = bool((ds.stage_status == Status.ok).all())
    yield Claim.tested(
        "Scale-status", "every stage ends well at every size", "ok", "all ok" if good else _troubles(ds), good,
        "some stages return another status",
    )  # fmt: skip
    yield Claim(
        "Scale-digits", "the error of a configuration by rounding", "not stated",
        f"bond vectors of the plain solve differ from the checked ones by at most {_worst(ds.change_by_refinement)}"
        + ("" if np.isnan(ds.error_bound).all() else f", whose coordinates are bounded to {_worst(ds.error_bound)}"),
        "measured",
    )  # fmt: skip
    for n in dict.fromkeys((0, len(sizes) - 1)):
        ranked = sorted(share(ds, n).items(), key=lambda item: -item[1])
        yield Claim(
            f"Scale-profile-{sizes[n]}", f"shares of the stages at {sizes[n]:,} vertices", "not stated",
            ", ".join(f"{stage} {100 * part:.1f} %" for stage, part in ranked), "measured",
        )  # fmt: skip


def summary(ds):
    """Medians over the networks: seconds, MB and solvers of each stage and size, exponents, and moduli."""
    stages = [str(stage) for stage in ds.stage.values]
    powers = {
        f"exponents_from_{first}": {stage: power for stage in SHOWN if np.isfinite(power := fitted(ds, stage, first))}
        for first in (1000, FIRST_FITTED)
    }
    shares = {str(size): share(ds, n) for n, size in enumerate(ds.n_vertices.values)}
    return {
        "networks": ds.sizes["seed"],
        "n_vertices": ds.n_vertices.values,
        "seconds": {stage: ds.seconds.sel(stage=stage).median("seed").values for stage in stages},
        "processor_seconds": {stage: ds.processor_seconds.sel(stage=stage).median("seed").values for stage in stages},
        "memory_MB": {stage: ds.memory.sel(stage=stage).max("seed").values for stage in stages},
        "error": {stage: ds.error.sel(stage=stage).max("seed").values for stage in stages},
        "solver": {
            stage: [_solver(ds, stage, n) for n in range(ds.sizes["n_vertices"])]
            for stage in stages
            if (ds.backend.sel(stage=stage) > 0).any()
        },
        "share_of_time": shares,
        **powers,
        **{name: ds[name].median("seed").values for name in ("bulk_modulus", "shear_modulus", "C_B", "C_G")},
        **{name: ds[name].max("seed").values for name in ("gap", "error_bound", "change_by_refinement")},
    }


def _worst(values):
    """The largest over the networks, at each size."""
    return ", ".join(f"{value:.1g} at {size:,}" for size, value in values.max("seed").to_series().items())


def _first(sizes):
    return int(sizes[sizes >= FIRST_FITTED][0])


def _median(ds, stage, name="seconds"):
    """Seconds of a stage at the largest size."""
    return float(ds[name].sel(stage=stage).isel(n_vertices=-1).median())


def _largest_stage(ds):
    return str(ds.stage.values[int(ds.memory.isel(n_vertices=-1).max("seed").values.argmax())])


def _solver(ds, stage, n):
    """Name of the solver behind a stage at the n-th size."""
    attributes = ds.backend.attrs
    names = dict(zip(np.atleast_1d(attributes["flag_values"]), attributes["flag_meanings"].split(), strict=True))
    return names[int(ds.backend.sel(stage=stage).isel(n_vertices=n, seed=0))]


def _solvers(ds, stage):
    return ", ".join(dict.fromkeys(_solver(ds, stage, n) for n in range(ds.sizes["n_vertices"])))


def _troubles(ds):
    stages = [str(s) for s in ds.stage.values if (ds.stage_status.sel(stage=s) != Status.ok).any()]
    return f"not so: {', '.join(stages)}"


def _time(value):
    if value < 0.1:
        return f"{1e3 * value:.2g} ms"
    return f"{value:.2g} s" if value < 99.5 else f"{value:.0f} s"


def _dark(colour):
    red, green, blue = (int(colour[k : k + 2], 16) for k in (1, 3, 5))
    return 0.3 * red + 0.59 * green + 0.11 * blue < 150
