"""Processor times, calls and errors of methods for one problem, in one process on one core.

A task is one row of the chart.  Other packages are imported by `peer` when a method runs; a method whose `package` is
not installed is not run.
"""

from __future__ import annotations

import os
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from enum import IntEnum
from importlib import import_module
from importlib.metadata import PackageNotFoundError, version
from typing import Any
from unittest.mock import patch

import numpy as np

from critflow import Status
from critflow.sparse import Factor, FixedPattern
from critflow.springs import SpringState


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
    """One task: its chart is a row of error against cost.

    word     value of the axis, as in "strain_step"
    title    the computed quantity, as in "σ → configuration"
    error    definition of the error, for the axis of the chart, as in "largest relative error of a bond vector"
    sizes    sizes N_v of the task
    names    its methods at all sizes; methods of other packages begin with the name of the package
    default  the method of critflow without options
    methods  (n_vertices, seed, gamma) -> the methods, with problem and reference in their closures; the reference is at
             least 1,000 times more accurate than the best method
    strained whether it is past the transition, at each γ > 0; else at γ = 0
    """

    word: str
    title: str
    error: str
    sizes: tuple[int, ...]
    names: tuple[str, ...]
    default: str
    methods: Callable[[int, int, float], Sequence[Method]]
    strained: bool = False


# The level of the first use of a method.
COLD = -1
# Calls that no machine changes, of which a run is made, and the functions of critflow that are one each.  Methods of
# other packages add theirs to the tally.
CALLS = {
    "factorisations": "factorisations of a run",
    "solves": "solves with a factor in a run",
    "evaluations": "evaluations of forces, and products with a matrix, in a run",
}
_COUNTED = ((FixedPattern, "factorize"), (Factor, "solve"), (SpringState, "moved"))
TALLY: Counter[str] = Counter()


@dataclass(frozen=True)
class Timing:
    """Processor and wall seconds of every repeat at one level of one method, and the answer with its error and calls.

    level   of the method, or `COLD`: its preparation and a run at the roughest level
    memory  peak resident memory in MB, of stages alone
    """

    method: Method
    level: int
    status: Status = Status.missing
    error: float = np.nan
    seconds: tuple[float, ...] = ()
    wall: tuple[float, ...] = ()
    calls: dict[str, int] = field(default_factory=dict)
    memory: float = np.nan

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


@contextmanager
def counting() -> Iterator[None]:
    """Count the calls of functions of critflow."""
    TALLY.clear()
    with ExitStack() as patches:
        for kind, (owner, name) in zip(CALLS, _COUNTED, strict=True):
            patches.enter_context(patch.object(owner, name, _counted(getattr(owner, name), kind)))
        yield


def _counted(function: Callable[..., Any], kind: str) -> Callable[..., Any]:
    def call(*arguments: Any, **options: Any) -> Any:
        TALLY[kind] += 1
        return function(*arguments, **options)

    return call


def benchmark(methods: Sequence[Method], patience: float = 2.0, least: float = 0.0) -> list[Timing]:
    """Time the first use and the levels of all methods, from rough to fine.

    All levels of a method share one preparation, and a run before any is timed.  A run is repeated until `least`
    seconds are spent.  The sweep of a method ends at the first level that it does not reach, or after a run that takes
    longer than the patience: the next level then counts as beyond its step limit.  The status of a method that raises
    is `failed`; that of a method whose package is not installed is `missing`.
    """
    with one_core():
        return [timing for method in methods for timing in _swept(method, patience, least)]


def _swept(method: Method, patience: float, least: float) -> Iterator[Timing]:
    first = Timing(method, COLD)
    if not installed(method.package):
        yield first
        return
    try:
        run, *spent = stopwatch(method.cold)
    except Exception:  # other packages may raise any exception
        yield from (replace(first, status=Status.failed, level=n) for n in (COLD, 0))
        return
    yield replace(first, status=Status.ok).repeated(*spent)
    for n, level in enumerate(method.levels):
        timing = Timing(method, n)
        try:
            with counting():
                answer, *spent = stopwatch(run, level)
            timing = replace(timing, status=answer.status, error=method.error(answer.values), calls=dict(TALLY))
            timing = timing.repeated(*spent)
            while sum(timing.seconds) < least:
                timing = timing.repeated(*stopwatch(run, level)[1:])
        except Exception:  # other packages may raise any exception
            timing = replace(timing, status=Status.failed)
        yield timing
        if timing.status is not Status.ok:
            return
        if timing.seconds[0] > patience:
            if n + 1 < len(method.levels):
                yield Timing(method, n + 1, Status.step_limit)
            return
