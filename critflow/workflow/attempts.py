"""Who was at work when a worker process died: a small file for each process, on the disk that holds the shards.

Its first line names the cases that the process computes now.  When the process dies the file stays as it was, with the
stack that the interpreter could still write behind that line, and tells whom to blame.  A case that takes longer than
its time limit ends its process: nothing gentler stops compiled code.  What times it is a thread without the
interpreter's lock, so that no case can hold it up.
"""

from __future__ import annotations

import faulthandler
import os
import shutil
import signal
import socket
import threading
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple
from uuid import uuid4

from critflow.result import EnvironmentFailure

_FOLDER = ".attempts"
_lock = threading.Lock()
_journals: dict[str, _Journal] = {}  # of this process, by run


class Death(NamedTuple):
    """One death of a worker process in the middle of some cases."""

    cases: tuple[str, ...]
    reason: str
    stack: str


class _Journal:
    """The file of this process, and the deadlines of the cases it names."""

    def __init__(self, run: str, shards: Path):
        folder = shards / _FOLDER
        folder.mkdir(exist_ok=True)
        path = folder / f"{run}-{socket.gethostname()}-{os.getpid()}-{uuid4().hex[:8]}"
        self.file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o666)
        self.deadlines: dict[str, float] = {}
        faulthandler.enable(self.file)
        if os.name == "posix":  # how dask ends a worker that takes too much memory
            faulthandler.register(signal.SIGTERM, self.file, chain=True)

    def note(self) -> None:
        os.ftruncate(self.file, 0)
        if self.deadlines:
            os.write(self.file, f"{' '.join(self.deadlines)}\n".encode())
            left = max(min(self.deadlines.values()) - time.monotonic(), 0.001)
            faulthandler.dump_traceback_later(left, exit=True, file=self.file)
        else:
            faulthandler.cancel_dump_traceback_later()


@contextmanager
def attempt(run: str, shards: Path, case_id: str, seconds: float) -> Iterator[None]:
    """The process computes this case in the block, and ends when that takes longer."""
    with _lock:
        journal = _journals.get(run) or _journals.setdefault(run, _Journal(run, shards))
        journal.deadlines[case_id] = time.monotonic() + seconds
        journal.note()
    try:
        yield
    finally:
        with _lock:
            del journal.deadlines[case_id]
            journal.note()


def deaths(run: str, shards: Path, case_ids: Iterable[str]) -> dict[str, list[Death]]:
    """The deaths in the middle of these cases, none of which runs now; a case without one is not named."""
    wanted, found = set(case_ids), dict[str, list[Death]]()
    for path in sorted((shards / _FOLDER).glob(f"{run}-*")):
        first, _, stack = path.read_text(encoding="utf-8", errors="replace").partition("\n")
        for case_id in wanted.intersection(names := tuple(first.split())):
            found.setdefault(case_id, []).append(Death(names, _reason(stack), _of_cases(stack)))
    return found


class Watch:
    """Ends a run in which no worker begins or ends a case for longer than the limits allow."""

    def __init__(self, run: str, shards: Path, seconds: float):
        self.pattern, self.folder, self.seconds = f"{run}-*", shards / _FOLDER, seconds
        self.signs: set[tuple[str, int, int]] = set()
        self.changed = self.looked = time.monotonic()

    def look(self) -> None:
        now = time.monotonic()
        if now - self.looked < self.seconds / 100:
            return
        self.looked = now
        stats = ((path.name, path.stat()) for path in self.folder.glob(self.pattern))
        signs = {(name, stat.st_mtime_ns, stat.st_size) for name, stat in stats}
        if signs != self.signs:
            self.signs, self.changed = signs, now
        elif now - self.changed > self.seconds:
            raise EnvironmentFailure(f"no worker did anything for {self.seconds:.0f} s: run the same command again")


def forget(shards: Path) -> None:
    """Remove what runs left here; none is at work."""
    shutil.rmtree(shards / _FOLDER, ignore_errors=True)


def _reason(stack: str) -> str:
    if stack.startswith("Timeout"):
        return "took longer than its time limit"
    if stack.startswith("Fatal Python error: "):
        return f"crashed: {stack.splitlines()[0].removeprefix('Fatal Python error: ')}"
    if stack:
        return "was ended from outside, as for taking more memory than its worker may"
    return "ended its worker process without a word: out of memory, or an exit in compiled code"


def _of_cases(stack: str) -> str:
    """The threads that compute cases, without those that wait for messages; all where none is known."""
    head, *threads = stack.partition("\n\nExtension modules")[0].split("\n\n")
    if head.startswith("Timeout"):
        head, _, first = head.partition("\n")
        threads = [first, *threads]
    told = [thread for thread in threads if "in _attempted" in thread]
    return "\n\n".join([head, *told]) if told else stack
