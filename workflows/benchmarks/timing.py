"""Processor times and errors of methods for one problem, in one process on one core, in random order.

A task is one chart.  Other packages are imported by `peer` when a method runs; a method whose `package` is not
installed is not run.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from enum import IntEnum
from functools import partial
from importlib import import_module
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import numpy as np

from critflow import Status


class Backend(IntEnum):
    """The linear solver of a method or stage, as stored in data files: append, never renumber."""

    none = 0
    qdldl = 1
    pardiso = 2
    metis = 3
    superlu = 4
    single = 5
    dense = 6
    multigrid = 7
    other = 8


@dataclass(frozen=True)
class Answer:
    """The answer of a method: values for the error function of the method, and status."""

    values: Any
    status: Status = Status.ok


Run = Callable[[float], Answer]


@dataclass(frozen=True)
class Method:
    """A method for one problem, which its functions contain.

    prepare  makes what does not depend on the level from the bare problem, such as matrices and their symbolic
             analysis, and returns the run: level -> answer
    error    the error of the values of an answer against the reference, not timed
    levels   tolerances or other parameters of the accuracy, from rough to fine
    package  distribution whose version is stored with the time
    backend  linear solver, if the method has a choice
    """

    name: str
    prepare: Callable[[], Run]
    error: Callable[[Any], float]
    levels: tuple[float, ...] = (0.0,)
    package: str = "critflow"
    backend: str = ""

    def cold(self) -> Run:
        """The run after a first use, which begins with nothing prepared."""
        run = self.prepare()
        run(self.levels[0])
        return run


@dataclass(frozen=True)
class Task:
    """One chart of error against time.

    word     value of the axis, as in "strain_step"
    title    the computed quantity, as in "σ → configuration, with its gradient"
    error    definition of the error, for the axis of the chart, as in "largest relative error of a bond vector"
    sizes    sizes N_v of the task
    names    its methods at all sizes; methods of other packages begin with the name of the package
    default  the method of critflow without options
    methods  (n_vertices, seed) -> the methods at this size, with problem and reference in their closures; the
             reference is at least 1,000 times more accurate than the best method
    """

    word: str
    title: str
    error: str
    sizes: tuple[int, ...]
    names: tuple[str, ...]
    default: str
    methods: Callable[[int, int], Sequence[Method]]


# The level of the first use of a method.
COLD = -1


@dataclass(frozen=True)
class Timing:
    """Processor and wall seconds of every repeat at one level of one method, and the answer with its error.

    level   of the method, or `COLD`: its preparation and a run at the roughest level
    memory  peak resident memory in MB, of stages alone
    """

    method: Method
    level: int
    work: Callable[[], Any]
    status: Status = Status.missing
    error: float = np.nan
    seconds: tuple[float, ...] = ()
    wall: tuple[float, ...] = ()
    memory: float = np.nan

    @property
    def quartiles(self) -> tuple[float, float, float]:
        """Median, lower and upper quartile of the processor seconds."""
        return tuple(np.quantile(self.seconds, (0.5, 0.25, 0.75))) if self.seconds else (np.nan,) * 3

    def repeated(self, wall: float, busy: float) -> Timing:
        """The timing with one more repeat."""
        return replace(self, seconds=(*self.seconds, busy), wall=(*self.wall, wall))


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


def stopwatch(work: Callable[..., Any], *arguments: Any) -> tuple[Any, float, float]:
    """The result of a call, its wall seconds and its processor seconds.

    Processor time is the time of a run where nothing else uses the core, and is nearly the same where something does.
    """
    begin, begin_busy = time.perf_counter(), time.process_time()
    result = work(*arguments)
    return result, time.perf_counter() - begin, time.process_time() - begin_busy


def benchmark(
    methods: Sequence[Method], repeats: int = 7, patience: float = 2.0, budget: float = np.inf
) -> list[Timing]:
    """Time the first use and all levels of all methods in repeated rounds; the first round yields the errors alone.

    All levels of a method share one preparation, and a run before any is timed.  Each round has a random order, so that
    effects of a method on caches and threads are spread over all methods.  A method ends after `repeats` rounds or
    `patience` seconds; no round begins `budget` seconds after the first one.  If the first run of a level exceeds the
    patience, its time is used and finer levels are left out.  The status of a method that raises is `failed`; that of a
    method whose package is not installed is `missing`.
    """
    rng = np.random.default_rng(0)
    with one_core():
        timings = [timing for method in methods for timing in _first_round(method, patience)]
        begin = time.perf_counter()
        for n_round in range(repeats):
            for n in rng.permutation(len(timings)):
                known = timings[n]
                over = sum(known.seconds) > patience or known.status in (Status.failed, Status.missing)
                late = n_round and time.perf_counter() - begin > budget
                if not over and not late:
                    _, *spent = stopwatch(known.work)
                    timings[n] = known.repeated(*spent)
    return timings


def _first_round(method: Method, patience: float) -> Iterator[Timing]:
    """The first round of one method: its first use, then its levels from rough to fine."""
    first = Timing(method, COLD, method.cold)
    if not installed(method.package):
        yield first
        return
    try:
        run, wall, busy = stopwatch(method.cold)
    except Exception:  # other packages may raise any exception
        yield from (replace(first, status=Status.failed, level=n) for n in (COLD, 0))
        return
    first = replace(first, status=Status.ok)
    if busy > patience:  # perhaps because it imports a package
        run, wall, busy = stopwatch(method.cold)
        first = first.repeated(wall, busy)
    yield first
    busy = 0.0
    for n, level in enumerate(method.levels):
        timing = Timing(method, n, partial(run, level))
        if busy > patience:
            yield timing
            continue
        try:
            answer, wall, busy = stopwatch(timing.work)
            timing = replace(timing, status=answer.status, error=method.error(answer.values))
        except Exception:  # other packages may raise any exception
            yield replace(timing, status=Status.failed)
            continue
        yield timing.repeated(wall, busy) if busy > patience else timing
