"""One chart of speed against accuracy: error against cost, cost against the distance to the transition, profiles."""

from textwrap import fill

import numpy as np
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator, NullFormatter

from critflow.pictures import COLOURS

from ...shared.figures import TEXT, lettered, page
from .curves import TARGET, approaches, finest, middle, of_task, profiles
from .tasks import MAIN_GAMMA, TASKS

# The tasks of the overview: mechanics, response and design.
FIRST, STRAINED = ("strain_step", "moduli", "min_V_L"), ("strain_step", "moduli")
# Errors of the two profiles, and where an error of exactly zero is drawn.
PROFILES, FLOOR = (TARGET, 1e-8), 1e-17
# The title states the error of the default in the time that the next method needs for the first, if below the second.
_ROUGH, _FINE = 1e-1, 1e-6
_FAMILIES = {"LAMMPS": "#D55E00", "SciPy": "#009E73", "matscipy": "#CC79A7", "jax_fdm": "#8C510A", "pyamg": "#666666"}
_MARKERS = "^v<>sDPX"
_TITLES = {"strain_step": "strain step", "moduli": "moduli B and G"}
_KINDS = {"seconds": "processor time  [s]", "calls": "number of calls"}


def overview_figure(ds):
    """Rows of tasks, of the distance to the transition, and of profiles; the methods of each row beside it."""
    shown = [(word, found) for word in FIRST if word in ds.task.values and (found := of_task(ds, word))]
    if not shown:
        return nothing()
    paths = {word: found for word in STRAINED if (found := approaches(ds, word))}
    n_rows = len(shown) + 2 * bool(paths) + 1
    figure = page(0.6 + 1.5 * n_rows)
    grid = figure.subplots(n_rows, 3, squeeze=False, width_ratios=(1, 1, 0.85))
    for (word, found), row in zip(shown, grid, strict=False):
        _draw_task(row, word, *found)
    if paths:
        _draw_approaches(grid[-3:-1], paths)
    _draw_profiles(grid[-1], ds)
    lettered(*grid[:, :2].ravel(), letters="ABCDEFGHIJKLMNOP")
    figure.suptitle("\n".join(finding(shown, paths)), fontsize=TEXT + 1)
    return figure


def nothing(text="nothing was timed"):
    """A figure without data, with the reason."""
    figure = page(3)
    axes = figure.subplots()
    axes.set_axis_off()
    axes.text(0.5, 0.5, text, ha="center")
    return figure


def finding(shown, paths) -> list[str]:
    """What the chart says, as far as it does: the error of others in the time of the default, and where they end."""
    found = []
    times = {curve.name: curve.costs(_ROUGH) for curve in shown[0][1][2]}
    name = min(times, key=lambda name: middle(times[name]), default="")
    if name and np.isfinite(middle(times[name])):
        default = shown[0][1][1]
        # The power of ten that the default reaches in that time in most networks.
        errors = np.where(default.seconds <= times[name][:, None], default.errors, 1).min(axis=1)
        reached = 10.0 ** np.ceil(np.log10(middle(errors)))
        if reached <= _FINE:
            name, method = f"{name}, the next,", {"Newton": "Newton's method"}.get(default.name, "the default")
            found.append(f"{method} reaches {_power(reached)} in the time that {name} needs for {_power(_ROUGH)}")
    for word, its in list(paths.items())[:1]:
        default = its[TASKS[word].default]
        ends = [one.gamma[~one.failed].min(initial=1.0) for name, one in its.items() if one is not default]
        if ends and not default.failed.any() and default.gamma.min() < min(ends):
            found.append(f"Below γ = {_power(min(ends))} no other method comes to within {100 * TARGET:g} %")
    if not found:
        return ["Error against cost, and cost against the distance γ to the transition: lower left is better"]
    return [line[0].upper() + line[1:] for line in found]


def _power(value):
    return f"$10^{{{np.log10(value):.0f}}}$"


def _styles(names, default):
    """Colour and marker of each method: dark blue the default, light blue other methods, one colour a package."""
    styles, seen = {}, {}
    for name in names:
        colour = COLOURS[0] if name == default else _FAMILIES.get(name.split()[0], COLOURS[1])
        colour = "black" if name.upper() == "FIRE" else colour
        place = seen[colour] = seen.get(colour, -1) + 1
        wide = {"marker": "o", "markersize": 4.5, "linewidth": 2.0, "zorder": 3}
        thin = {"marker": _MARKERS[place % len(_MARKERS)], "markersize": 3.5, "linewidth": 0.9}
        styles[name] = {"color": colour, **(wide if name == default else thin)}
    return styles


def _draw_task(row, word, size, default, others):
    """Median error against median cost of each level, with quartiles, of levels that half of the networks have."""
    times = {curve.name: finest(default, curve) for curve in others}
    ordered = [default, *sorted(others, key=lambda c: times[c.name].warm if times[c.name] else np.inf)]
    styles = _styles([curve.name for curve in ordered], default.name)
    for axes, kind in zip(row, _KINDS, strict=False):
        for curve in ordered:
            cost, errors = getattr(curve, kind), np.maximum(curve.errors, FLOOR)
            errors[np.isinf(errors)] = np.nan
            half = 2 * np.isfinite(cost + errors).sum(axis=0) >= len(cost)
            if half.any():
                x, y = (np.nanquantile(part[:, half], (0.5, 0.25, 0.75), axis=0) for part in (cost, errors))
                axes.errorbar(x[0], y[0], _bars(y), _bars(x), elinewidth=0.6, **styles[curve.name])
        _logarithmic(axes, _KINDS[kind], fill(TASKS[word].error, 26) if kind == "seconds" else "")
    row[0].set_title(_TITLES.get(word, TASKS[word].title))
    row[1].set_title((f"γ = {_power(MAIN_GAMMA)}, " if TASKS[word].strained else "") + f"$N_v$ = {size:,}")
    labels = {name: f"{name}: {ratio}" if ratio else name for name, ratio in times.items()}
    _legend(row[2], [(labels.get(c.name, c.name), styles[c.name]) for c in ordered])


def _bars(quartiles):
    return np.maximum([quartiles[0] - quartiles[1], quartiles[2] - quartiles[0]], 0)


def _draw_approaches(rows, paths):
    """Cost of a fixed error against γ, one column a task; a cross where most networks fail."""
    for column, (word, its) in enumerate(paths.items()):
        styles = _styles(its, TASKS[word].default)
        for axes, kind in zip(rows[:, column], _KINDS, strict=True):
            for name, one in its.items():
                cost, works = getattr(one, kind), ~one.failed
                axes.errorbar(one.gamma[works], cost[works, 0], _bars(cost[works].T), elinewidth=0.6, **styles[name])
                axes.plot(one.gamma[~works], cost[~works, 0], "x", color=styles[name]["color"], markersize=5)
            _logarithmic(axes, "distance to the transition γ", "" if column else _KINDS[kind])
            axes.invert_xaxis()
        rows[0, column].set_title(f"{_TITLES[word]}, to {100 * TARGET:g} %")
        _legend(rows[column, 2], [(name, styles[name]) for name in its], f"{_TITLES[word]}; cross: fails")


def _draw_profiles(row, ds):
    """Part of the problems that each family solves within a multiple of the least time."""
    for axes, error in zip(row, PROFILES, strict=False):
        for name, found in profiles(ds, error).items():
            solved = np.sort(found[np.isfinite(found)])
            x, y = np.append(solved, 1e4), np.append(np.arange(1, len(solved) + 1), len(solved)) / len(found)
            axes.step(x, y, where="post", **_family(name))
        axes.set(xscale="log", xlim=(0.9, 1e3), ylim=(-0.03, 1.03), xlabel="time over the least")
        axes.set_title(f"problems solved to {_power(error)}")
    row[0].set_ylabel("part of the problems")
    sizes = {name: len(found) for name, found in profiles(ds, PROFILES[0]).items()}
    _legend(row[2], [(f"{name}: {size:,} problems", _family(name)) for name, size in sizes.items()])


def _family(name):
    colour = COLOURS[0] if name == "critflow" else _FAMILIES.get(name, "black" if name == "FIRE" else "0.7")
    return {"color": colour, "linewidth": 2.2 if name == "critflow" else 1.2}


def _logarithmic(axes, xlabel, ylabel):
    axes.set(xscale="log", yscale="log", xlabel=xlabel, ylabel=ylabel)
    axes.margins(0.08)
    axes.xaxis.set_major_locator(LogLocator(numticks=5))
    axes.yaxis.set_major_locator(LogLocator(numticks=6))
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.yaxis.set_minor_formatter(NullFormatter())
    axes.grid(which="major", color="0.92", linewidth=0.6, zorder=0)


def _legend(axes, entries, title=None):
    """The methods of a row, beside it."""
    axes.set_axis_off()
    handles = [Line2D([], [], label=label, **style) for label, style in entries]
    axes.legend(
        handles=handles, loc="center left", fontsize=TEXT - 2, frameon=False, borderaxespad=0, handlelength=1.2,
        handletextpad=0.4, labelspacing=0.25, title=title, title_fontsize=TEXT - 2, alignment="left",
    )  # fmt: skip
