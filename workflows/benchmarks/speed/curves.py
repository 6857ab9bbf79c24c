"""Curves of error against time from the dataset, and ratios of times at equal errors.

A method has an error when the cheapest of its settings has one that is not larger.  Its time is warm, with everything
prepared that does not depend on the stress, or cold, with the preparation in it: of the network, of patterns and their
symbolic analysis, of a compiled function.
"""

from typing import NamedTuple

import numpy as np

from .tasks import TASKS

# Errors at which methods are compared.
ERRORS = (1e-2, 1e-4, 1e-6, 1e-8, 1e-10)
# Times closer than this are the same.
SAME = 1.1
# The size of the charts that show one size.
MAIN_SIZE = 1_000
OWN = 1


class Curve(NamedTuple):
    """One method: seconds with quartiles and errors of the levels that were timed, and seconds of its preparation."""

    name: str
    own: bool
    seconds: np.ndarray
    low: np.ndarray
    high: np.ndarray
    errors: np.ndarray
    preparation: float

    def time_to(self, error: float) -> float:
        """Least time of a setting with at most this error, prepared; infinity without one."""
        return float(self.seconds[self.errors <= error].min(initial=np.inf))


class Ratio(NamedTuple):
    """Time of another method over that of the default at the same error; zero where the default has no such error."""

    error: float
    warm: float
    cold: float

    def __str__(self) -> str:
        return f"{number(self.warm)} / {number(self.cold)} ×"


def number(ratio):
    """A ratio with two digits, as text."""
    return f"{ratio:,.0f}" if ratio >= 9.95 else f"{ratio:.2g}"


def ratios(default: Curve, rival: Curve) -> list[Ratio]:
    """The ratios at all errors that the rival has, from rough to fine."""
    compared = []
    for error in ERRORS:
        mine, other = default.time_to(error), rival.time_to(error)
        if np.isfinite(other):
            compared.append(Ratio(error, other / mine, (other + rival.preparation) / (mine + default.preparation)))
    return compared


def finest(default: Curve, rival: Curve) -> Ratio | None:
    """The ratio at the finest error that both have."""
    return next((ratio for ratio in reversed(ratios(default, rival)) if ratio.warm), None)


def curves(one) -> list[Curve]:
    """The methods of a task at a size that have a time and an error."""
    timed = []
    for name, presence in zip(map(str, one.contestant.values), one.presence.values, strict=True):
        at = one.sel(contestant=name)
        known = np.isfinite(at.seconds.values) & np.isfinite(at.error.values)
        if known.any():
            values = (at[part].values[known] for part in ("seconds", "seconds_low", "seconds_high", "error"))
            timed.append(Curve(name, bool(presence == OWN), *values, float(at.preparation_seconds)))
    return timed


def cases(ds):
    """Task, size, default and other methods of each case in which the default was timed."""
    for word in (str(word) for word in ds.task.values if word in TASKS):
        for size in map(int, ds.n_vertices.values):
            methods = {curve.name: curve for curve in curves(ds.sel(task=word, n_vertices=size))}
            if default := methods.pop(TASKS[word].default, None):
                yield word, size, default, list(methods.values())
