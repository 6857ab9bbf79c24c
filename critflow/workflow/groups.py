"""Batches put together into tasks that are long enough: a task costs the scheduler some milliseconds, whatever it does.

The first tasks are single batches, and their times say how many make a task.  Towards the end tasks shrink, so that
all workers end together.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

Batch = Sequence[Mapping[str, int | str]]

TASK_SECONDS = 2.0  # aimed at, so that a task seldom has less than one second
LEAST_SECONDS = 0.2  # of a task near the end


class Groups:
    """The batches that are still to be handed out, in order."""

    def __init__(self, batches: Sequence[Batch]):
        self.batches = batches
        self.begun = 0
        self.cases_left = sum(map(len, batches))
        self.case_seconds: float | None = None

    def note(self, cases: int, seconds: float) -> None:
        """A task with so many cases took so long; newer times count for more, as the first ones hold imports."""
        if cases:
            each = seconds / cases
            self.case_seconds = each if self.case_seconds is None else (self.case_seconds + each) / 2

    def next(self, workers: int) -> list[Batch]:
        """The batches of the next task: one at least, while there are any."""
        group: list[Batch] = []
        cases, most = 0, self._most(workers)
        while self.begun < len(self.batches):
            batch = self.batches[self.begun]
            if group and cases + len(batch) > most:
                break
            group.append(batch)
            cases += len(batch)
            self.begun += 1
        self.cases_left -= cases
        return group

    def _most(self, workers: int) -> float:
        """Cases that fit into one task."""
        if self.case_seconds is None:
            return 0.0
        share = self.case_seconds * self.cases_left / (2 * max(workers, 1))  # seconds, so that all end together
        return min(TASK_SECONDS, max(LEAST_SECONDS, share)) / max(self.case_seconds, 1e-9)
