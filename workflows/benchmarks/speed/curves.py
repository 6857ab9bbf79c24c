"""Curves of error against time from the dataset, their front, and ratios of times at equal accuracy.

A method is as accurate as another if its error is not larger.  Errors within a factor `DIGIT` of the least error of a
method depend on rounding; they count as equal to errors that are smaller by at most this factor.
"""

from typing import NamedTuple

import numpy as np

from critflow.result import Status

from .tasks import TASKS

DIGIT = 10.0
# Times closer than this are the same.
SAME = 1.1
# The size of the charts that show one size.
MAIN_SIZE = 1_000
OWN = 1


class Curve(NamedTuple):
    """One method: seconds with quartiles, errors and steps of the levels that were timed, from rough to fine.

    `cut` if finer levels were left out because of the time of the previous one.
    """

    name: str
    own: bool
    cut: bool
    seconds: np.ndarray
    low: np.ndarray
    high: np.ndarray
    errors: np.ndarray
    steps: np.ndarray


def curves(one) -> list[Curve]:
    """The methods of a task at a size that have a time and an error."""
    timed = []
    for name, presence in zip(map(str, one.contestant.values), one.presence.values, strict=True):
        at = one.sel(contestant=name)
        known = np.isfinite(at.seconds.values) & np.isfinite(at.error.values)
        if known.any():
            parts = ("seconds", "seconds_low", "seconds_high", "error", "iterations")
            values = (at[part].values[known] for part in parts)
            cut = (np.isfinite(at.level_value) & (at.outcome == Status.missing)).any()
            timed.append(Curve(name, presence == OWN, bool(cut), *values))
    return timed


def pareto_front(seconds, errors):
    """Places of the points that no other beats in both, from fast to slow; of equal points the first."""
    order = np.lexsort((errors, seconds))
    least = np.minimum.accumulate(np.concatenate([[np.inf], errors[order][:-1]]))
    return order[errors[order] < least]


def reaches(curve, error):
    """The points of a method with at most this error, up to the factor `DIGIT` near its least error."""
    last = (curve.errors <= DIGIT * curve.errors.min()) & (curve.errors <= DIGIT * error)
    return (curve.errors <= error) | last


def fastest(curve_list, error):
    """Least time of any of these methods for an error not above this, with its steps; infinity without one."""
    points = [(c.seconds[n], c.steps[n]) for c in curve_list for n in np.flatnonzero(reaches(c, error))]
    return min(points, default=(np.inf, 0))


def behind(methods, rivals, useful):
    """Ratio of the times of methods to those of their rivals on the front of the rivals: (ratios, points).

    The points are (method, point).  Errors above `useful` are left out, and errors that the methods may reach at levels
    that were cut.
    """
    points = [(c, n) for c in rivals for n in range(len(c.errors)) if c.errors[n] < useful]
    if not points:
        return np.empty(0), []
    seconds, errors = (np.array([getattr(c, part)[n] for c, n in points]) for part in ("seconds", "errors"))
    front = pareto_front(seconds, errors)
    ratios = np.array([fastest(methods, errors[n])[0] / seconds[n] for n in front])
    known = np.isfinite(ratios) | (not any(curve.cut for curve in methods))
    return ratios[known], [points[n] for n in front[known]]


def gain(default, rival):
    """Time of another method for its best accuracy over the time of the default for at least this accuracy."""
    best = int(np.argmin(rival.errors))
    return float(rival.seconds[best] / fastest([default], rival.errors[best])[0])


def detour(default, everyone, useful):
    """Largest ratio of the time of the default to that of the fastest method, over all accuracies of the default."""
    ratios, _ = behind([default], everyone, useful)
    return float(ratios[np.isfinite(ratios)].max(initial=1.0))


def cases(ds):
    """Task, size, curves and default of each case in which something was timed."""
    for word in (str(word) for word in ds.task.values if word in TASKS):
        for size in map(int, ds.n_vertices.values):
            all_curves = curves(ds.sel(task=word, n_vertices=size))
            default = next((curve for curve in all_curves if curve.name == TASKS[word].default), None)
            if all_curves:
                yield word, size, all_curves, default
