"""Named points of a run where a test lets it fail; passing one costs nothing unless CRITFLOW_FAULTS arms some.

    CRITFLOW_FAULTS="store.closed@seed1-* kill; case.begun term 3 /tmp/struck"

A fault is a point, after an @ a pattern of the file or case it waits for, the kind, at which passage in its process it
strikes (the first one when left out), and a file that it makes when it does: where the file exists it strikes no more,
in no process.
"""

from __future__ import annotations

import errno
import os
import signal
from collections import Counter
from dataclasses import dataclass
from fnmatch import fnmatchcase
from functools import cache
from pathlib import Path

VARIABLE = "CRITFLOW_FAULTS"
POINTS = (
    "store.opening",  # nothing of the file is there
    "store.half",  # half of its bytes are
    "store.closed",  # all are, but the disk may not have them
    "store.synced",  # the disk has them, beside the place of the file
    "store.replaced",  # in its place, which the disk may not know
    "store.done",
    "merge.declared",  # the dataset has its head and no data
    "merge.slab",  # a slab of them is written
    "case.begun",
    "case.computed",
    "case.stored",
    "batch.ended",
    "run.begun",  # the lock is held and the note written
    "run.planned",
    "run.logged",  # lines of the log are written but not flushed
    "run.computed",
    "run.written",  # the dataset is in its place
    "run.reported",
)
KINDS = ("kill", "term", "interrupt", "raise")


@dataclass(frozen=True)
class Fault:
    """What happens at a point; see the head of this file."""

    point: str
    about: str
    kind: str
    passage: int = 1
    once: str = ""

    def __post_init__(self) -> None:
        if self.point not in POINTS or self.kind not in KINDS:
            raise ValueError(f"{VARIABLE} has {self.point} {self.kind}: see critflow/workflow/faults.py")

    def strike(self) -> None:
        if self.once:
            try:
                os.close(os.open(self.once, os.O_CREAT | os.O_EXCL))
            except FileExistsError:
                return
        if self.kind == "raise":
            raise OSError(errno.EIO, os.strerror(errno.EIO))
        number = {"kill": signal.SIGKILL, "term": signal.SIGTERM, "interrupt": signal.SIGINT}[self.kind]
        os.kill(os.getpid(), number)


_passed: Counter[Fault] = Counter()


def passing(point: str, about: str = "") -> None:
    """The run is at this point, at work on the file or case `about`."""
    for fault in _due(point, about) if _armed() else ():
        fault.strike()


def half_written(path: Path, about: str) -> None:
    """The point `store.half`: the file is all there, and is cut to what it was, for as long as the fault strikes."""
    for fault in _due("store.half", about) if _armed() else ():
        whole = path.read_bytes()
        path.write_bytes(whole[: len(whole) // 2])
        fault.strike()
        path.write_bytes(whole)


def _due(point: str, about: str) -> list[Fault]:
    here = [fault for fault in _armed() if fault.point == point and fnmatchcase(about, fault.about)]
    _passed.update(here)
    return [fault for fault in here if _passed[fault] == fault.passage and not os.path.exists(fault.once)]


@cache
def _armed() -> tuple[Fault, ...]:
    """The faults of this process; read once."""
    return tuple(_fault(words.split()) for words in os.environ.get(VARIABLE, "").split(";") if words.strip())


def _fault(words: list[str]) -> Fault:
    where, kind, *others = words
    point, _, about = where.partition("@")
    return Fault(point, about or "*", kind, int(others[0]) if others else 1, others[1] if len(others) > 1 else "")
