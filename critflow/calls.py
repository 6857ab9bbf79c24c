"""How a public call runs: BLAS has one thread, and a line on a terminal has its name, how far it is, and its time.

The line appears after two seconds.  Nothing is written where standard error is no terminal or is redirected, in worker
processes and in other threads.
"""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable, Collection, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from functools import cache
from typing import Any, TypeVar

from threadpoolctl import ThreadpoolController

# Seconds before the line appears, and between its changes.
PATIENCE, PERIOD = 2.0, 0.5
_ERASE = "\r\x1b[K"
Item = TypeVar("Item")


class _Line:
    """The line of the outermost call, `what`, empty between calls; a thread writes it, which the first call starts."""

    def __init__(self) -> None:
        self.what, self.part, self.begun, self.written = "", "", 0.0, False
        self._lock, self._thread = threading.Lock(), threading.Thread(target=self._watch, daemon=True)

    def begin(self, what: str) -> None:
        self.what, self.part, self.begun = what, "", time.monotonic()
        if not self._thread.is_alive():
            self._thread.start()

    def end(self) -> None:
        with self._lock:
            if self.written:
                sys.stderr.write(_ERASE)
                sys.stderr.flush()
            self.what, self.written = "", False

    def say(self, sentence: str) -> None:
        with self._lock:
            sys.stderr.write(f"{_ERASE if self.written else ''}{sentence}\n")
            sys.stderr.flush()
            self.written = False

    def _watch(self) -> None:
        while True:
            time.sleep(PERIOD)
            with self._lock:
                seconds = time.monotonic() - self.begun
                if self.what and seconds > PATIENCE:
                    part = f": {self.part}" if self.part else ""
                    sys.stderr.write(f"{_ERASE}{self.what}{part}, {seconds:.0f} s")
                    sys.stderr.flush()
                    self.written = True


_LINE = _Line()


def _visible() -> bool:
    """Whether a user looks at standard error, no other display writes there, and this is no worker process."""
    terminal = sys.stderr is sys.__stderr__ and sys.stderr is not None and sys.stderr.isatty()
    # A worker has this module; to import it would take others longer than all of this file.
    processes = sys.modules.get("multiprocessing.process")
    worker = processes is not None and processes.parent_process() is not None
    return terminal and not worker and threading.current_thread() is threading.main_thread()


@contextmanager
def running(what: str) -> Iterator[Callable[[str], None]]:
    """Run a call, or a block, on one thread, and show its name unless a call around it is shown; yields `tell`."""
    shown = not _LINE.what and _visible()
    if shown:
        _LINE.begin(what)
    try:
        with _one_blas_thread():
            yield tell
    finally:
        if shown:
            _LINE.end()


def _one_blas_thread() -> AbstractContextManager[Any]:
    """A context in which BLAS uses one thread; calls inside it set nothing.

    Digits and times then do not depend on other processes: threads that wait for each other while processes are busy
    take seconds for the small dense matrices of this library.
    """
    controller = _controller()
    blas = (library.num_threads for library in controller.lib_controllers if library.user_api == "blas")
    return nullcontext() if all(n == 1 for n in blas) else controller.limit(limits=1, user_api="blas")


@cache
def _controller() -> ThreadpoolController:
    # To find the libraries takes milliseconds, to set their threads microseconds.
    return ThreadpoolController()


def tell(part: str) -> None:
    """Name the part that is computed, in the line of the call that is shown."""
    if _LINE.what and threading.current_thread() is threading.main_thread():
        _LINE.part = part


def rename(what: str) -> None:
    """Change the name of the call that is shown."""
    if _LINE.what and threading.current_thread() is threading.main_thread():
        _LINE.what = what


def say(sentence: str) -> None:
    """Print a line on standard error, above that of the call that is shown."""
    _LINE.say(sentence)


def counted(items: Collection[Item], what: str) -> Iterator[Item]:
    """The items, each with its number as the part that is shown, such as "point 3 of 11"."""
    for number, item in enumerate(items, start=1):
        tell(f"{what} {number} of {len(items)}")
        yield item
