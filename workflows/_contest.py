"""Methods timed against each other: one process, one core, in turn, and beside each time the error of its answer."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
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


def contest(contestants: Sequence[Contestant], repeats: int = 7, patience: float = 2.0) -> list[Timing]:
    """Time all levels of all contestants in turn, round after round, after one round that is judged and not timed.

    Nobody is run again after `repeats` rounds or `patience` seconds; whoever takes longer in the first round has that
    time counted, whoever raises has failed.
    """
    entries = [(c, n) for c in contestants for n in range(len(c.levels))]
    timings = {}
    for contestant, n in entries:
        begin = time.perf_counter()
        try:
            answer = contestant.run(contestant.levels[n])
        except Exception as error:  # a peer may raise anything, and that is its outcome
            timings[contestant.name, n] = Timing(
                contestant, n, verdict=Verdict(np.nan, Status.failed), note=f"{type(error).__name__}: {error}"
            )
            continue
        spent = time.perf_counter() - begin
        first = (spent,) if spent > patience else ()
        timings[contestant.name, n] = Timing(contestant, n, first, contestant.judge(answer))
    for _ in range(repeats):
        for contestant, n in entries:
            known = timings[contestant.name, n]
            if known.verdict.status is Status.failed or sum(known.seconds) > patience:
                continue
            begin = time.perf_counter()
            contestant.run(contestant.levels[n])
            spent = time.perf_counter() - begin
            timings[contestant.name, n] = Timing(contestant, n, (*known.seconds, spent), known.verdict)
    return [timings[c.name, n] for c, n in entries]
