"""One line on a terminal about a call that takes more than two seconds: its name, how far it is, and its time.

Nothing is written where standard error is no terminal or is redirected, in worker processes and in other threads.
"""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from typing import TypeVar

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
    """Show what is computed, unless a call around it is shown; the function that it yields names a part."""
    if _LINE.what or not _visible():
        yield tell
        return
    _LINE.begin(what)
    try:
        yield tell
    finally:
        _LINE.end()


def tell(part: str) -> None:
    """Name the part that is computed, in the line of the call that is shown."""
    if _LINE.what and threading.current_thread() is threading.main_thread():
        _LINE.part = part


def counted(items: Collection[Item], what: str) -> Iterator[Item]:
    """The items, each told by its number as a part, such as "point 3 of 11"."""
    for number, item in enumerate(items, start=1):
        tell(f"{what} {number} of {len(items)}")
        yield item
