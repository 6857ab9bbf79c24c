"""Charts, claims and summary of speed against accuracy, from the dataset; titles are those of the tasks.

A method is as accurate as another if its error is not larger.  Errors within a factor `DIGIT` of the least error of a
method depend on rounding; they count as equal to errors that are smaller by at most this factor.
"""

from __future__ import annotations

import json
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from matplotlib.ticker import NullFormatter

from critflow.plot import COLOURS
from critflow.result import Status
from critflow.workflow import Claim

from .tasks import TASKS

DIGIT = 10.0
# Times closer than this are the same.
SAME = 1.1
MAIN_SIZE = 1_000
# Where an error of exactly zero is drawn, if nothing is below.
FLOOR = 1e-17
OWN, PEER, MISSING = 1, 2, 3
_DEFAULT_COLOUR, _OWN_COLOUR, _PEER_COLOURS = COLOURS[0], COLOURS[1], (*COLOURS[2:6], "#8C510A", "#666666", "#B2182B")


class Curve(NamedTuple):
    """One method: seconds with quartiles, and errors, of the levels that were timed, from rough to fine.

    `cut` if finer levels were left out because of the time of the previous one.
    """

    name: str
    own: bool
    cut: bool
    seconds: np.ndarray
    low: np.ndarray
    high: np.ndarray
    errors: np.ndarray


def curves(one) -> list[Curve]:
    """The methods of a task at a size that have a time and an error."""
    found = []
    for name, presence in zip(map(str, one.contestant.values), one.presence.values, strict=True):
        at = one.sel(contestant=name)
        known = np.isfinite(at.seconds.values) & np.isfinite(at.error.values)
        if known.any():
            values = (at[v].values[known] for v in ("seconds", "seconds_low", "seconds_high", "error"))
            cut = (np.isfinite(at.level_value) & (at.outcome == Status.missing)).any()
            found.append(Curve(name, presence == OWN, bool(cut), *values))
    return found


def pareto_front(seconds, errors):
    """Places of the points that no other beats in both, from fast to slow; of equal points the first."""
    order = np.lexsort((errors, seconds))
    least = np.minimum.accumulate(np.concatenate([[np.inf], errors[order][:-1]]))
    return order[errors[order] < least]


def reaches(curve, error):
    """The points of a method with at most this error, up to the factor `DIGIT` near its least error."""
    last = (curve.errors <= DIGIT * curve.errors.min()) & (curve.errors <= DIGIT * error)
    return (curve.errors <= error) | last


def time_to(curve_list, error):
    """Least time of any of these methods for an error not above this, or infinity."""
    times = [curve.seconds[reaches(curve, error)] for curve in curve_list]
    return min((float(t.min()) for t in times if len(t)), default=np.inf)


def behind(some, others, useful):
    """Ratio of the times of some methods to those of others on the front of the others: (ratios, points).

    The points are (method, point).  Errors above `useful` are left out, and errors that the methods may reach at levels
    that were cut.
    """
    points = [(c, n) for c in others for n in range(len(c.errors)) if c.errors[n] < useful]
    if not points:
        return np.empty(0), []
    seconds, errors = (np.array([getattr(c, part)[n] for c, n in points]) for part in ("seconds", "errors"))
    front = pareto_front(seconds, errors)
    ratios = np.array([time_to(some, errors[n]) / seconds[n] for n in front])
    known = np.isfinite(ratios) | (not any(curve.cut for curve in some))
    return ratios[known], [points[n] for n in front[known]]


def gain(default, rival):
    """Time of another method for its best accuracy over the time of the default for at least this accuracy."""
    best = int(np.argmin(rival.errors))
    return float(rival.seconds[best] / time_to([default], rival.errors[best]))


def detour(default, everyone, useful):
    """Largest ratio of the time of the default to that of the fastest method, over all accuracies of the default."""
    ratios, _ = behind([default], everyone, useful)
    return float(ratios[np.isfinite(ratios)].max(initial=1.0))


def cases(ds):
    """Task, size, curves and default of each case in which something was timed."""
    for word in map(str, ds.task.values):
        for size in map(int, ds.n_vertices.values):
            all_curves = curves(ds.sel(task=word, n_vertices=size))
            default = next((curve for curve in all_curves if curve.name == TASKS[word].default), None)
            if all_curves:
                yield word, size, all_curves, default


# Figures


def main_figure(ds):
    """A chart a task, at the size in the middle."""
    shown = {}
    for word, size, all_curves, default in cases(ds):
        if word not in shown or abs(np.log(size / MAIN_SIZE)) < abs(np.log(shown[word][0] / MAIN_SIZE)):
            shown[word] = size, all_curves, default
    columns = min(3, len(shown))
    rows = -(-len(shown) // max(columns, 1))
    figure = Figure(figsize=(5.4 * max(columns, 1), 4.3 * max(rows, 1) + 0.7), dpi=100, layout="constrained")
    if not shown:
        figure.text(0.5, 0.5, "nothing was timed", ha="center")
        return figure
    places = figure.subplots(rows, columns, squeeze=False).flat
    for axes, (word, (size, all_curves, default)) in zip(places, shown.items(), strict=False):
        _chart(axes, all_curves, default, labels=True)
        axes.set_ylabel(TASKS[word].error, fontsize=9)
        axes.set_title(
            f"{TASKS[word].title}, $N_v$ = {size:,}\n{_comparison(default, all_curves)}", loc="left", fontsize=9.5
        )
    for axes in list(places):
        axes.set_axis_off()
    for axes in figure.axes[len(shown) :]:
        axes.set_axis_off()
    _explain(figure)
    return figure


def all_sizes_figure(ds):
    """Tasks down, sizes across."""
    drawn = {(word, size): (all_curves, default) for word, size, all_curves, default in cases(ds)}
    words, sizes = (list(dict.fromkeys(part)) for part in zip(*drawn, strict=True)) if drawn else ([], [])
    sizes = sorted(sizes)
    figure = Figure(figsize=(3.9 * max(len(sizes), 1), 2.9 * max(len(words), 1) + 0.8), dpi=80, layout="constrained")
    if not drawn:
        figure.text(0.5, 0.5, "nothing was timed", ha="center")
        return figure
    grid = figure.subplots(len(words), len(sizes), squeeze=False, sharey="row")
    for row, word in enumerate(words):
        for column, size in enumerate(sizes):
            axes = grid[row, column]
            if (word, size) not in drawn:
                axes.set_axis_off()
                continue
            all_curves, default = drawn[word, size]
            _chart(axes, all_curves, default, labels=column == 0)
            if column == 0:
                axes.set_ylabel(word.replace("_", " "), fontsize=9)
            factor = detour(default, all_curves, TASKS[word].useful) if default else np.nan
            chosen = f"{default.name}: {factor:.2g} × the front" if default else ""
            axes.set_title(f"$N_v$ = {size:,}    {chosen}", fontsize=8.5, loc="left")
    _explain(figure)
    return figure


def _explain(figure):
    figure.suptitle(
        "Error against time of every method, one core: down and to the left is better\n"
        "dark blue: what critflow chooses, light blue: its other methods, squares: peers, grey: the front",
        fontsize=11 if figure.get_figwidth() > 9 else 8,
    )


def _chart(axes, all_curves, default, labels):
    positive = np.concatenate([c.errors[c.errors > 0] for c in all_curves])
    floor = min(FLOOR, positive.min(initial=FLOOR))
    seconds = np.concatenate([c.seconds for c in all_curves])
    errors = np.maximum(np.concatenate([c.errors for c in all_curves]), floor)
    front = pareto_front(seconds, errors)
    axes.step(
        np.append(seconds[front], 3 * seconds.max()), np.append(errors[front], errors[front][-1]), where="post",
        color="0.8", linewidth=5, solid_capstyle="butt", zorder=0,
    )  # fmt: skip
    peers, ends = iter(_PEER_COLOURS * 3), []
    for curve in sorted(all_curves, key=lambda curve: curve is default):
        chosen = curve is default
        colour = _DEFAULT_COLOUR if chosen else _OWN_COLOUR if curve.own else next(peers)
        y = np.maximum(curve.errors, floor)
        spread = np.stack([curve.seconds - curve.low, curve.high - curve.seconds])
        axes.errorbar(
            curve.seconds, y, xerr=np.maximum(spread, 0), color=colour, marker="o" if curve.own else "s",
            markersize=6.5 if chosen else 3.5, linewidth=2.2 if chosen else 1.0, elinewidth=0.8, zorder=3 + chosen,
        )  # fmt: skip
        last = int(np.argmin(y))
        ends.append((curve.seconds[last], y[last], curve.name, colour, chosen))
    axes.set(xscale="log", yscale="log")
    axes.set_xlim(0.6 * seconds.min(), (9 if labels else 2) * seconds.max())
    axes.set_xlabel("time of a run  [s]", fontsize=9)
    axes.tick_params(labelsize=8)
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.spines[["top", "right"]].set_visible(False)
    if labels:
        _name(axes, ends)


def _name(axes, ends):
    """Names next to the most accurate points, shifted where they would overlap."""
    low, high = np.log10(axes.get_ylim())
    left, right = np.log10(axes.get_xlim())
    taken = []
    for x, y, name, colour, chosen in sorted(ends, key=lambda end: end[1]):
        point = (np.log10(x) - left) / (right - left), (np.log10(y) - low) / (high - low)
        across, up = point[0] + 0.015, point[1] - 0.03
        width = 0.021 * len(name)
        while any(abs(up - b) < 0.052 and across < a + w and a < across + width for a, b, w in taken):
            up += 0.013
        taken.append((across, up, width))
        if up > point[1] + 0.02:
            axes.plot(
                (point[0], across),
                (point[1], up + 0.02),
                color=colour,
                linewidth=0.5,
                transform=axes.transAxes,
                zorder=2,
            )
        axes.annotate(
            name, (across, up), xycoords="axes fraction", fontsize=8, color=colour, va="bottom",
            fontweight="bold" if chosen else "normal", zorder=6,
            path_effects=[withStroke(linewidth=2, foreground="white")],
        )  # fmt: skip


def _comparison(default, all_curves):
    """The default against the slowest and the fastest other method at their best accuracy."""
    if default is None:
        return ""
    ratios = {curve.name: gain(default, curve) for curve in all_curves if curve is not default}
    if not ratios:
        return "alone"
    slowest, fastest = max(ratios, key=ratios.__getitem__), min(ratios, key=ratios.__getitem__)
    parts = [f"{default.name}: {_times(ratios[slowest])} {slowest}"]
    if fastest != slowest:
        parts.append(f"{_times(ratios[fastest])} {fastest}" if ratios[fastest] else f"less accurate than {fastest}")
    text = ", ".join(parts)
    return text if len(text) < 62 else ",\n".join(parts)


def _times(ratio):
    if 1 / SAME < ratio < SAME:
        return "as fast as"
    return f"{ratio:,.0f} × faster than" if ratio >= 9.95 else f"{ratio:.2g} × the speed of"


# Claims and summary


def claims(ds):
    """Claims on every task against other packages, and on the default against the front."""
    everything = list(cases(ds))
    for word in map(str, ds.task.values):
        of_task = [(size, all_curves, default) for w, size, all_curves, default in everything if w == word]
        if of_task:
            yield _against_peers(ds, word, of_task)
    worst = [
        (detour(default, all_curves, TASKS[word].useful), word, size)
        for word, size, all_curves, default in everything
        if default
    ]
    if worst:
        off = sorted((entry for entry in worst if entry[0] > SAME), reverse=True)
        value = f"{len(worst) - len(off)} of {len(worst)} charts; at worst {_place(max(worst))}"
        yield Claim(
            "speed-accuracy-auto", "auto lies within 10 % of the front at every size and tolerance",
            "within 10 %", value, "differs" if off else "holds",
            f"times over the front: {', '.join(map(_place, off))}" if off else "",
        )  # fmt: skip
    for name, package in _missing(ds):
        yield Claim(
            f"speed-accuracy-missing-{name.replace(' ', '-')}", f"{name} takes part", "not stated",
            f"{package} is not installed: `pip install 'critflow[peers]'`", "measured",
        )  # fmt: skip


def _against_peers(ds, word, of_task):
    nearest, ahead = (0.0, ""), []
    for size, all_curves, _ in of_task:
        own = [curve for curve in all_curves if curve.own]
        for rival in (curve for curve in all_curves if not curve.own):
            ratios, points = behind(own, [rival], TASKS[word].useful)
            nearest = max(nearest, (float(ratios.max(initial=0.0)), f"{rival.name} at N_v = {size:,}"))
            if ratios.max(initial=0.0) > SAME:
                n = points[int(ratios.argmax())][1]
                needs = ratios.max() * rival.seconds[n]
                mine = f"critflow needs {_milliseconds(needs)}" if np.isfinite(needs) else "critflow does not get there"
                ahead.append(
                    f"{rival.name} has {rival.errors[n]:.0e} in {_milliseconds(rival.seconds[n])} at N_v = {size:,}, "
                    f"{mine}"
                )
    missing = sorted({name for name, _ in _missing(ds.sel(task=[word]))})
    absent = f"; not installed: {', '.join(missing)}" if missing else ""
    key, statement = f"speed-accuracy-{word}", f"{TASKS[word].title}: critflow beats every peer at every accuracy"
    ratio, where = nearest
    if not ratio:
        return Claim(key, statement, "not stated", f"no peer took part{absent}", "measured")
    most = f"takes at most {ratio:.2g} × the time" if np.isfinite(ratio) else "does not reach the accuracy"
    value = f"critflow {most} of a peer, {where}{absent}"
    if ahead:
        return Claim(key, statement, "faster", value, "differs", "; ".join(ahead))
    return Claim(key, statement, "faster", value, "holds")


def _milliseconds(seconds):
    return f"{1e3 * seconds:.3g} ms"


def _place(entry):
    return f"{entry[0]:.3g} ({entry[1]}, N_v = {entry[2]:,})"


def _missing(ds):
    """Methods whose package is not installed, with the package, once each."""
    gone = (ds.presence == MISSING).any(("task", "n_vertices")).values
    return [
        (str(name), str(name).split()[0]) for name, missing in zip(ds.contestant.values, gone, strict=True) if missing
    ]


def summary(ds):
    """For each task and size the front, the default's points and its distance from the front; outcomes counted."""
    tables = {}
    for word, size, all_curves, default in cases(ds):
        seconds, errors = (np.concatenate([getattr(c, part) for c in all_curves]) for part in ("seconds", "errors"))
        names = np.concatenate([[c.name] * len(c.seconds) for c in all_curves])
        front = pareto_front(seconds, errors)
        table = {"front": [[str(names[n]), _short(seconds[n]), _short(errors[n])] for n in front]}
        if default:
            table["auto"] = [[_short(t), _short(e)] for t, e in zip(default.seconds, default.errors, strict=True)]
            table["auto_over_front"] = _short(detour(default, all_curves, TASKS[word].useful))
            table["gain"] = {c.name: _short(gain(default, c)) for c in all_curves if c is not default}
        tables.setdefault(word, {})[str(size)] = table
    codes, numbers = np.unique(ds.outcome.values, return_counts=True)
    return {
        "parameters": json.loads(ds.attrs["parameters"]),
        "outcomes": {Status(int(code)).name: int(number) for code, number in zip(codes, numbers, strict=True)},
        "tasks": {
            word: {"title": TASKS[word].title, "error": TASKS[word].error, "auto": TASKS[word].default, "sizes": its}
            for word, its in tables.items()
        },
    }


def _short(number):
    return float(f"{number:.3g}")
