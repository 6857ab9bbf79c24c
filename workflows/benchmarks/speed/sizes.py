"""Figure, claims and summary of the cost of every stage against size, from the dataset alone."""

import numpy as np

from critflow.engine import Claim
from critflow.pictures import COLOURS
from critflow.result import Status

from ...shared.figures import TEXT, lettered, page
from ...shared.reports import MARKERS, duration, exponent
from ..timing import Backend
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
GENERATION, MEMORY, EXPONENT, GAP, MILLION = 10.0, 8000.0, 1.2, 1e-10, 1_000_000


def stages_of(ds):
    """The stages at the sizes where they were timed, (contestant, n_vertices); None if there are none."""
    if WORD not in ds.task.values or not set(STAGES) <= set(ds.contestant.values):
        return None
    one = ds.sel(task=WORD, contestant=list(STAGES)).isel(level=0, gamma=0, seed=0)
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
    figure = page(3.9)
    by_time, by_memory = figure.subplots(1, 2, width_ratios=(1.6, 1))
    _draw_times(by_time, stages)
    _draw_memory(by_memory, stages)
    lettered(*figure.axes)
    power, largest = fitted(stages, "configuration"), int(stages.n_vertices[-1])
    made, taken = (duration(seconds(stages, name)[-1], 2) for name in ("generation", "configuration"))
    growth = "" if np.isnan(power) else f": time grows as $N_v^{{{power:.2f}}}$"
    figure.suptitle(f"{largest:,} vertices: made in {made}, one configuration in {taken}{growth}", fontsize=TEXT + 1)
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
    axes.set_ylim(low, high * 400)
    axes.legend(
        fontsize=TEXT, frameon=False, loc="upper left", ncols=2, columnspacing=1.0, handletextpad=0.4,
        title_fontsize=TEXT,
        title=f"exponent of $N_v$ from {FIRST_FITTED:,} on, slowest first" if sizes[-1] > FIRST_FITTED else None,
    )  # fmt: skip


def _draw_memory(axes, stages):
    sizes, memory = stages.n_vertices.values, stages.memory.max("contestant").values / 1e3
    axes.plot(sizes, memory, marker="o", color=COLOURS[0], linewidth=2)
    last = (sizes[-1], memory[-1])
    axes.annotate(f"{memory[-1]:.2g} GB", last, xytext=(-6, 6), textcoords="offset points", ha="right", fontsize=TEXT)
    axes.set(
        xscale="log",
        xlabel="number of vertices $N_v$",
        ylabel="peak resident memory  [GB]",
        ylim=(0, 1.15 * memory.max()),
    )


def size_claims(ds):
    """The required and the measured exponents, times, memory and certificates."""
    stages = stages_of(ds)
    if stages is None:
        return
    sizes, last = stages.n_vertices.values, stages.isel(n_vertices=-1)
    most = int(sizes[-1])
    if not np.isnan(power := fitted(stages, "configuration")):
        codes = stages.backend.sel(contestant="configuration").values
        solvers = ", ".join(dict.fromkeys(Backend(int(code)).name for code in codes))
        yield Claim.tested(
            "Scale-configuration", "the time of a configuration grows at most as N_v^1.2",
            f"at most {EXPONENT} required", f"exponent {power:.2f} from {sizes[sizes >= FIRST_FITTED][0]:,} to "
            f"{most:,} vertices ({solvers})", power <= EXPONENT, f"the factorisation fills in more with {solvers}",
            criterion=f"exponent ≤ {EXPONENT}", sample="one network a size", kind="check",
        )  # fmt: skip
    if most == MILLION:
        points, tessellation = (float(last.wall_seconds.sel(contestant=name)) for name in SHOWN["generation"][0])
        busy = float(last.seconds.sel(contestant=list(SHOWN["generation"][0])).sum())
        yield Claim.tested(
            "Scale-generation", "a network of a million vertices is made in ten seconds", f"{GENERATION:g} s required",
            f"{points + tessellation:.1f} s, of which points {points:.1f} s and tessellation {tessellation:.1f} s; "
            f"{busy:.1f} s of the processor", points + tessellation <= GENERATION,
            "the trials of random sequential addition and one call of Qhull take most of it, in addition to "
            "other work of the machine", criterion=f"{GENERATION:g} s", sample="one network", kind="check",
        )  # fmt: skip
    memory, stage = float(stages.memory.max()), STAGES[int(last.memory.values.argmax())]
    yield Claim.tested(
        "Scale-memory", f"all stages up to {most:,} vertices fit in memory", f"{MEMORY / 1e3:g} GB required",
        f"{memory / 1e3:.2g} GB, most of it for {stage}", memory <= MEMORY, "the factor of that stage is too large",
        criterion=f"{MEMORY / 1e3:g} GB", sample="one network a size", kind="check",
    )  # fmt: skip
    gap = float(stages.error.sel(contestant="optimum").max())
    yield Claim.tested(
        "Scale-certificate", "the optimum of B_0 meets its closed-form bound at every size", "equal",
        f"largest gap {gap:.1g}", gap < GAP, "rounding keeps them apart", criterion=f"{GAP:g}",
        sample="one network a size", kind="check",
    )  # fmt: skip
    wrong = [name for name in STAGES if (stages.outcome.sel(contestant=name) != Status.ok).any()]
    yield Claim.tested(
        "Scale-status", "every stage ends well at every size", "ok",
        f"not so: {', '.join(wrong)}" if wrong else "all ok", not wrong, "some stages return another status",
        criterion="every stage", sample="one network a size", kind="check",
    )  # fmt: skip


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
