"""How far a run is, in networks: a bar on a terminal, a line every tenth of the way elsewhere."""

from __future__ import annotations

import time
from types import TracebackType

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn


class RunProgress:
    """Counts finished units on stderr; `say` prints a line without disturbing the bar."""

    def __init__(self, title: str, noun: str, total: int):
        self.title, self.noun, self.total = title, noun, total
        self.console = Console(stderr=True, highlight=False, soft_wrap=True)
        self.done = 0
        self.start = time.monotonic()
        self.bar: Progress | None = None
        if self.console.is_terminal and total:
            columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TextColumn(noun))
            self.bar = Progress(
                *columns, TimeElapsedColumn(), TextColumn("left"), TimeRemainingColumn(), console=self.console
            )

    def __enter__(self) -> RunProgress:
        if self.bar:
            self.bar.start()
            self.task = self.bar.add_task(self.title, total=self.total)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, where: TracebackType | None
    ) -> None:
        if self.bar:
            self.bar.stop()

    def say(self, line: str) -> None:
        self.console.print(line, markup=False)

    def advance(self) -> None:
        """One more unit is finished."""
        self.done += 1
        if self.bar:
            self.bar.advance(self.task)
        elif self.done * 10 // self.total > (self.done - 1) * 10 // self.total:
            elapsed = time.monotonic() - self.start
            left = elapsed / self.done * (self.total - self.done)
            ending = f"about {left:.0f} s left" if self.done < self.total else f"in {elapsed:.1f} s"
            self.say(f"{self.title}: {self.done}/{self.total} {self.noun}, {ending}")
