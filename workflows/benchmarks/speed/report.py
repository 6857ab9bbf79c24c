"""Claims and summary of speed against accuracy and of sizes, from the dataset."""

import numpy as np

from critflow.workflow import Claim
from critflow.workflow.study import plural

from ...shared.reports import duration, parameters, status_counts
from .curves import SAME, behind, cases, detour, fastest, gain
from .sizes import size_claims, size_summary
from .tasks import TASKS

MISSING = 3


def claims(ds):
    """Claims on every task against other packages, on the default against the front, and on sizes."""
    return [*_speed_claims(ds), *size_claims(ds)]


def _speed_claims(ds):
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
            f"{SAME:g} times the front, every chart", plural(len(worst), "chart"),
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
                needs, steps = fastest(own, rival.errors[n])
                mine = f"needs {duration(needs)} and {steps}" if np.isfinite(needs) else "does not get there"
                ahead.append(
                    f"{rival.name} has {rival.errors[n]:.0e} in {duration(rival.seconds[n])} and {rival.steps[n]} "
                    f"steps at N_v = {size:,}, critflow {mine}"
                )
    missing = sorted({name for name, _ in _missing(ds.sel(task=[word]))})
    absent = f"; not installed: {', '.join(missing)}" if missing else ""
    key, statement = f"speed-accuracy-{word}", f"{TASKS[word].title}: critflow beats every peer at every accuracy"
    ratio, where = nearest
    if not ratio:
        return Claim(key, statement, "not stated", f"no peer took part{absent}", "measured")
    most = f"takes at most {ratio:.2g} × the time" if np.isfinite(ratio) else "does not reach the accuracy"
    value = f"critflow {most} of a peer, {where}{absent}"
    criterion, sample = f"{SAME:g} times the time, every peer and error", plural(len(of_task), "size")
    if ahead:
        return Claim(key, statement, "faster", value, "differs", "; ".join(ahead), criterion, sample)
    return Claim(key, statement, "faster", value, "holds", "", criterion, sample)


def _place(entry):
    return f"{entry[0]:.3g} ({entry[1]}, N_v = {entry[2]:,})"


def _missing(ds):
    """Methods whose package is not installed, with the package, once each."""
    gone = (ds.presence == MISSING).any(("task", "n_vertices")).values
    return [
        (str(name), str(name).split()[0]) for name, missing in zip(ds.contestant.values, gone, strict=True) if missing
    ]


def summary(ds):
    """For each task and size the default's points and its distance from the front; stages."""
    tables = {}
    for word, size, all_curves, default in cases(ds):
        table = tables.setdefault(word, {})[str(size)] = {}
        if default:
            table["auto"] = [[_short(t), _short(e)] for t, e in zip(default.seconds, default.errors, strict=True)]
            table["auto_over_front"] = _short(detour(default, all_curves, TASKS[word].useful))
            table["gain"] = {c.name: _short(gain(default, c)) for c in all_curves if c is not default}
    return {
        "parameters": parameters(ds),
        "outcomes": status_counts(ds.outcome.values),
        "tasks": {
            word: {"title": TASKS[word].title, "error": TASKS[word].error, "auto": TASKS[word].default, "sizes": its}
            for word, its in tables.items()
        },
        "stages": size_summary(ds),
    }


def _short(number):
    return float(f"{number:.3g}")
