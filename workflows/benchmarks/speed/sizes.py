"""Figure and summary of the cost of every stage against size, from the dataset alone."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from critflow.figures.plot import COLOURS

from ...shared.figures import lettered
from ...shared.power_laws import exponent
from ...shared.reports import MARKERS, duration
from .charts import nothing
from .stages import STAGES, WORD

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


def stages_of(ds):
    """The stages at the sizes where they were timed, (contestant, n_vertices); None if there are none."""
    if WORD not in ds.task.values or not set(STAGES) <= set(ds.contestant.values):
        return None
    one = ds.sel(task=WORD, contestant=list(STAGES)).isel(level=0)
    one = one.isel(n_vertices=np.isfinite(one.wall_seconds).all("contestant").values)
    return one if one.sizes["n_vertices"] else None


def seconds(stages, name):
    """Wall time of a stage that is drawn, (n_sizes,)."""
    return stages.wall_seconds.sel(contestant=list(SHOWN[name][0])).sum("contestant").values


def fitted(stages, name):
    """Exponent of the time of a stage over the large sizes, NaN for fewer than two."""
    large = stages.isel(n_vertices=stages.n_vertices.values >= FIRST_FITTED)
    if large.sizes["n_vertices"] < 2:
        return np.nan
    return exponent(large.n_vertices.values, seconds(large, name)[:, None])[0]


def sizes_figure(ds):
    """Time against size with exponents, and memory against size."""
    stages = stages_of(ds)
    if stages is None:
        return nothing("no stage was timed")
    figure = Figure(figsize=(9.5, 4.8), dpi=130, layout="constrained")
    by_time, by_memory = figure.subplots(1, 2, width_ratios=(1.6, 1))
    _draw_times(by_time, stages)
    _draw_memory(by_memory, stages)
    lettered(*figure.axes)
    power, largest = fitted(stages, "configuration"), int(stages.n_vertices[-1])
    figure.suptitle(
        f"{largest:,} vertices: made in {duration(seconds(stages, 'generation')[-1], 2)}, a configuration in "
        f"{duration(seconds(stages, 'configuration')[-1], 2)}"
        + ("" if np.isnan(power) else f", which grows as $N_v^{{{power:.2f}}}$"),
        fontsize=11,
    )
    return figure


def _draw_times(axes, stages):
    sizes = stages.n_vertices.values
    slowest_first = sorted(SHOWN, key=lambda name: -seconds(stages, name)[-1])
    for name in slowest_first:
        power = fitted(stages, name)
        axes.plot(
            sizes, seconds(stages, name), marker=MARKERS[list(SHOWN).index(name)], color=COLOUR_OF[name], markersize=5,
            linewidth=2.6 if name == "configuration" else 1.4,
            label=SHOWN[name][1] + ("" if np.isnan(power) else f": {power:.2f}"),
        )  # fmt: skip
    axes.set(xscale="log", yscale="log", xlabel="number of vertices $N_v$", ylabel="wall time  [s]")
    low, high = axes.get_ylim()
    axes.set_ylim(low, high * 60)
    axes.legend(
        fontsize=8.5, frameon=False, loc="upper left", ncols=2, columnspacing=1.0, handletextpad=0.4,
        title_fontsize=8.5,
        title=f"exponent of $N_v$ from {FIRST_FITTED:,} on, slowest first" if sizes[-1] > FIRST_FITTED else None,
    )  # fmt: skip


def _draw_memory(axes, stages):
    sizes, memory = stages.n_vertices.values, stages.memory.max("contestant").values / 1e3
    axes.plot(sizes, memory, marker="o", color=COLOURS[0], linewidth=2)
    last = (sizes[-1], memory[-1])
    axes.annotate(f"{memory[-1]:.2g} GB", last, xytext=(-6, 6), textcoords="offset points", ha="right", fontsize=9)
    axes.set(xscale="log", yscale="log", xlabel="number of vertices $N_v$", ylabel="peak resident memory  [GB]")


def size_summary(ds):
    """Seconds of each stage and size, and exponents."""
    stages = stages_of(ds)
    if stages is None:
        return {}
    powers = {name: fitted(stages, name) for name in SHOWN}
    return {
        "n_vertices": stages.n_vertices.values,
        "seconds": {name: stages.wall_seconds.sel(contestant=name).values for name in STAGES},
        f"exponents_from_{FIRST_FITTED}": {name: power for name, power in powers.items() if np.isfinite(power)},
    }
