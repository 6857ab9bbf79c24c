"""Whether the disk has room for what a run will write, told while there is little to lose."""

from __future__ import annotations

import shutil
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path

from critflow.result import EnvironmentFailure

MARGIN = 1.2  # cases differ in size


class Room:
    """Shards that are stored tell how large the others and the dataset of all will be."""

    def __init__(self, shards: Path, todo: int, cases: int):
        self._shards, self._left, self._cases = shards, todo, cases
        self._bytes = self._seen = 0
        self._next = 1

    def look(self, case_ids: Iterable[str], *, computed: bool) -> None:
        """These are stored; an `EnvironmentFailure` when the rest will not fit.

        The disk is asked each time that twice as many cases are known.
        """
        for case_id in case_ids:
            self._left -= computed
            with suppress(FileNotFoundError):  # not seen yet, as on a shared disk just after another machine wrote it
                self._bytes += (self._shards / f"{case_id}.nc").stat().st_size
                self._seen += 1
        if self._seen < self._next:
            return
        self._next = 2 * self._seen
        needed = MARGIN * self._bytes / self._seen * (self._left + self._cases)
        free = shutil.disk_usage(self._shards).free
        if needed > free:
            raise EnvironmentFailure(
                f"{self._left} cases and the dataset will need about {_words(needed)}, and {_words(free)} are free "
                f"in {self._shards.parent}: make room and run the same command again, or give --out elsewhere"
            )


def _words(size: float) -> str:
    scale, unit = next((pair for pair in ((1e9, "GB"), (1e6, "MB")) if size >= pair[0]), (1e3, "kB"))
    return f"{size / scale:.1f} {unit}"
