"""Processor times and errors of methods for one problem, in one process on one core, in random order.

A task is one chart.  The modules of `speed_accuracy` define them as `TASKS = (Task(...), ...)`.  Other packages are
imported by `peer` when a method runs; a method whose `package` is not installed is not run.
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
class Accuracy:
    """Accuracy of an answer: error against the reference, status, iterations and error bound returned by the method."""

    error: float
    status: Status = Status.ok
    iterations: int = 0
    bound: float = np.nan


@dataclass(frozen=True)
class Method:
    """A method for one problem, which its functions contain.

    run       the answer at a level, timed
    accuracy  the accuracy of an answer, not timed
    levels    tolerances or other parameters of the accuracy, from rough to fine
    package   distribution whose version is stored with the time
    backend   linear solver, if the method has a choice
    """

    name: str
    run: Callable[[float], Any]
    accuracy: Callable[[Any], Accuracy]
    levels: tuple[float, ...] = (0.0,)
    package: str = "critflow"
    backend: str = ""


@dataclass(frozen=True)
class Task:
    """One chart of error against time.

    word     value of the axis, as in "strain_step"
    title    the computed quantity, as in "σ → configuration, with its gradient"
    error    definition of the error, for the axis of the chart, as in "largest relative error of a bond vector"
    sizes    sizes N_v of the task; larger ones are left out
    names    its methods at all sizes; methods of other packages begin with the name of the package
    default  the method of critflow without options
    methods  (n_vertices, seed) -> the methods at this size, with problem and reference in their closures; the
             reference is at least 1,000 times more accurate than the best method
    useful   largest error that is compared
    """

    word: str
    title: str
    error: str
    sizes: tuple[int, ...]
    names: tuple[str, ...]
    default: str
    methods: Callable[[int, int], Sequence[Method]]
    useful: float = 1e-2


@dataclass(frozen=True)
class Timing:
    """Processor seconds of every repeat at one level of one method, and the accuracy of the answer."""

    method: Method
    level: int
    seconds: tuple[float, ...] = ()
    accuracy: Accuracy = field(default_factory=lambda: Accuracy(np.nan, Status.missing))
    note: str = ""

    @property
    def median(self) -> float:
        return float(np.median(self.seconds)) if self.seconds else np.nan

    @property
    def quartiles(self) -> tuple[float, float]:
        """Lower and upper quartile of the seconds."""
        return tuple(np.quantile(self.seconds, (0.25, 0.75))) if self.seconds else (np.nan, np.nan)


def installed(package: str) -> str:
    """The version of a distribution, or an empty string if it is not installed."""
    try:
        return version(package)
    except PackageNotFoundError:
        return ""


def peer(module: str) -> Any:
    """A module of an optional package, imported at first use."""
    return import_module(module)


@contextmanager
def one_core() -> Iterator[None]:
    """Bind this thread and the threads started by it to one core, where the system supports it."""
    if not hasattr(os, "sched_setaffinity"):
        yield
        return
    before = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {max(before)})
    try:
        yield
    finally:
        os.sched_setaffinity(0, before)


def benchmark(
    methods: Sequence[Method], repeats: int = 7, patience: float = 2.0, budget: float = np.inf
) -> list[Timing]:
    """Time all levels of all methods in repeated rounds; the first round yields the accuracy and is not timed.

    Each round has a random order, so that effects of a method on caches and threads are spread over all methods.  A
    method ends after `repeats` rounds or `patience` seconds; no round begins after `budget` seconds.  If the first run
    of a level exceeds the patience, its time is used and finer levels are left out.  The status of a method that raises
    is `failed`; that of a method whose package is not installed is `missing`.
    """
    begin, rng = time.perf_counter(), np.random.default_rng(0)
    timings: dict[tuple[str, int], Timing] = {}
    with one_core():
        for method in methods:
            for timing in _first_round(method, patience):
                timings[method.name, timing.level] = timing
        keys = list(timings)
        for n_round in range(repeats):
            for key in (keys[n] for n in rng.permutation(len(keys))):
                known = timings[key]
                over = sum(known.seconds) > patience or known.accuracy.status in (Status.failed, Status.missing)
                late = n_round and time.perf_counter() - begin > budget
                if not over and not late:
                    spent, _ = _timed(known.method, known.level)
                    timings[key] = replace(known, seconds=(*known.seconds, spent))
    return list(timings.values())


def _first_round(method: Method, patience: float) -> Iterator[Timing]:
    """The first round of one method, from rough to fine levels."""
    nothing = Accuracy(np.nan, Status.missing)
    if not installed(method.package):
        note = f"{method.package} is not installed: `pip install 'critflow[peers]'`"
        yield from (Timing(method, n, accuracy=nothing, note=note) for n in range(len(method.levels)))
        return
    spent = 0.0
    for n in range(len(method.levels)):
        if spent > patience:
            yield Timing(method, n, accuracy=nothing, note=f"the previous level took {spent:.2g} s")
            continue
        try:
            spent, answer = _timed(method, n)
            accuracy = method.accuracy(answer)
        except Exception as error:  # other packages may raise any exception
            note = f"{type(error).__name__}: {error}"
            yield Timing(method, n, accuracy=Accuracy(np.nan, Status.failed), note=note)
            continue
        yield Timing(method, n, (spent,) if spent > patience else (), accuracy)


def _timed(method: Method, level: int) -> tuple[float, Any]:
    # Processor time is the time of a run where nothing else uses the core, and is nearly the same where something does.
    begin = time.process_time()
    answer = method.run(method.levels[level])
    return time.process_time() - begin, answer
