"""Methods timed against each other: one process, one core, in turn, and beside each time the error of its answer.

A task is one chart.  Its module `_contest_<...>.py` ends with `TASKS = (Task(...), ...)`, which `speed_accuracy`
gathers.  Contestants import their peers by `peer`, when they run; one whose `package` is not installed is not run.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from importlib import import_module
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import numpy as np

from critflow import Status


@dataclass(frozen=True)
class Verdict:
    """What an answer is worth: its error against the reference, how the method says it ended, its own error bound."""

    error: float
    status: Status = Status.ok
    iterations: int = 0
    bound: float = np.nan


@dataclass(frozen=True)
class Contestant:
    """A method for one problem, which its functions hold already.

    levels  tolerances, or whatever makes it more accurate, from rough to fine
    run     what is timed: the answer at a level
    judge   what is not timed: the worth of an answer
    package the distribution whose version stands beside the time; one that is not installed is said to be missing
    backend what factorises, where that is a choice
    """

    name: str
    run: Callable[[float], Any]
    judge: Callable[[Any], Verdict]
    levels: tuple[float, ...] = (0.0,)
    package: str = "critflow"
    backend: str = ""


@dataclass(frozen=True)
class Task:
    """One chart of error against time.

    word         its name on the axis, as in "strain_step"
    title        what is computed, as in "σ → configuration, with its gradient"
    error        what the error is, for the axis of the chart, as in "largest relative error of a bond vector"
    sizes        sizes N_v that make sense; beyond the largest the task is left out
    names        all its contestants at any size; an own method says what it does, a peer its package
    default      the contestant that is critflow called without choosing anything, the one to lie on the front
    contestants  (n_vertices, seed) -> those that take part at a size, with problem and reference in their closures;
                 the reference is at least 1,000 times better than the best of them
    useful       with a larger error an answer is none
    """

    word: str
    title: str
    error: str
    sizes: tuple[int, ...]
    names: tuple[str, ...]
    default: str
    contestants: Callable[[int, int], Sequence[Contestant]]
    useful: float = 1e-2


@dataclass(frozen=True)
class Timing:
    """Seconds of every repeat at one level of one contestant, and the worth of the answer."""

    contestant: Contestant
    level: int
    seconds: tuple[float, ...] = ()
    verdict: Verdict = field(default_factory=lambda: Verdict(np.nan, Status.missing))
    note: str = ""

    @property
    def median(self) -> float:
        return float(np.median(self.seconds)) if self.seconds else np.nan

    @property
    def quartiles(self) -> tuple[float, float]:
        """Lower and upper quartile of the seconds."""
        return tuple(np.quantile(self.seconds, (0.25, 0.75))) if self.seconds else (np.nan, np.nan)


def installed(package: str) -> str:
    """The version of a distribution, or nothing where it is missing."""
    try:
        return version(package)
    except PackageNotFoundError:
        return ""


def peer(module: str) -> Any:
    """A module of a package that need not be installed, imported when first used."""
    return import_module(module)


@contextmanager
def one_core() -> Iterator[None]:
    """Keep this thread, and all that it starts, on one core, where the system can."""
    if not hasattr(os, "sched_setaffinity"):
        yield
        return
    before = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {max(before)})
    try:
        yield
    finally:
        os.sched_setaffinity(0, before)


def contest(
    contestants: Sequence[Contestant], repeats: int = 7, patience: float = 2.0, budget: float = np.inf
) -> list[Timing]:
    """Time all levels of all contestants in turn, round after round, after one round that is judged and not timed.

    Every round has an order of its own: what a contestant leaves behind, in caches and threads, is borne by all alike.
    Nobody is run again after `repeats` rounds or `patience` seconds, and no round begins after `budget` seconds.
    Whoever takes longer than the patience in the first round has that time counted, and its finer levels are left out.
    Whoever raises has failed; one whose package is not installed is missing.
    """
    begin, rng = time.perf_counter(), np.random.default_rng(0)
    timings: dict[tuple[str, int], Timing] = {}
    with one_core():
        for contestant in contestants:
            for timing in _judged(contestant, patience):
                timings[contestant.name, timing.level] = timing
        keys = list(timings)
        for n_round in range(repeats):
            for key in (keys[n] for n in rng.permutation(len(keys))):
                known = timings[key]
                over = sum(known.seconds) > patience or known.verdict.status in (Status.failed, Status.missing)
                late = n_round and time.perf_counter() - begin > budget
                if not over and not late:
                    spent, _ = _timed(known.contestant, known.level)
                    timings[key] = replace(known, seconds=(*known.seconds, spent))
    return list(timings.values())


def _judged(contestant: Contestant, patience: float) -> Iterator[Timing]:
    """The first round of one contestant, from its rough to its fine levels."""
    nothing = Verdict(np.nan, Status.missing)
    if not installed(contestant.package):
        note = f"{contestant.package} is not installed: `pip install 'critflow[peers]'`"
        yield from (Timing(contestant, n, verdict=nothing, note=note) for n in range(len(contestant.levels)))
        return
    spent = 0.0
    for n in range(len(contestant.levels)):
        if spent > patience:
            yield Timing(contestant, n, verdict=nothing, note=f"the level before took {spent:.2g} s")
            continue
        try:
            spent, answer = _timed(contestant, n)
            verdict = contestant.judge(answer)
        except Exception as error:  # a peer may raise anything, and that is its outcome
            note = f"{type(error).__name__}: {error}"
            yield Timing(contestant, n, verdict=Verdict(np.nan, Status.failed), note=note)
            continue
        yield Timing(contestant, n, (spent,) if spent > patience else (), verdict)


def _timed(contestant: Contestant, level: int) -> tuple[float, Any]:
    begin = time.perf_counter()
    answer = contestant.run(contestant.levels[level])
    return time.perf_counter() - begin, answer
