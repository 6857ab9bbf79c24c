"""Workers: this process, local worker processes, a dask scheduler, or jobs of a batch system.

One task is the cases of one value of the first axis.
"""

from __future__ import annotations

import math
import os
import signal
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from types import FrameType

from critflow.extensions import named
from critflow.result import InputError
from critflow.workflow.study import nearest
from critflow.workflow.tasks import HOUR, Job, Outcome, run_cases

Task = Sequence[Mapping[str, int | str]]  # axis values of some cases

# Modules of dask-jobqueue; the jobs of "local" are processes of this machine, for a trial without a queue.
CLUSTERS = ("slurm", "pbs", "sge", "lsf", "oar", "moab", "htcondor", "local")


@contextmanager
def interruption(stop: Path) -> Iterator[threading.Event]:
    """An event that the first Ctrl-C or SIGTERM sets: running cases finish and no other begins.

    Workers look for the file `stop` before each case.  A second signal raises `KeyboardInterrupt`.
    """
    requested = threading.Event()

    def request(number: int, frame: FrameType | None) -> None:
        if requested.is_set():
            raise KeyboardInterrupt
        requested.set()
        with suppress(OSError):
            stop.touch()
        # Not through the console: the interrupted line may own its lock.
        os.write(2, b"\nstopping: running cases finish and are stored; press Ctrl-C again to stop at once\n")

    main = threading.current_thread() is threading.main_thread()  # signals are handled only there
    before = {number: signal.signal(number, request) for number in (signal.SIGINT, signal.SIGTERM) if main}
    try:
        yield requested
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@dataclass(frozen=True)
class Workers:
    """Where cases are computed, and their limits; `InputError` for contradicting options."""

    processes: int = 0  # local worker processes; 0 is this process
    scheduler: str = ""  # address
    cluster: str = ""  # batch system, a name of `CLUSTERS`
    jobs: int = 1  # batch jobs
    insecure: bool = False  # allows a scheduler without encryption
    case_seconds: float = HOUR
    gigabytes: float | None = None  # memory of a local worker; an equal share by default

    def __post_init__(self) -> None:
        for option, value in (("--time-limit", self.case_seconds), ("--memory-limit", self.gigabytes)):
            if value is not None and not 0 < value < math.inf:
                raise InputError(f"{option} {value:g} must be a number above zero")
        limited = (self.case_seconds, self.gigabytes) != (HOUR, None)
        if self.processes < 0 or self.jobs < 1:
            raise InputError("--workers must not be negative, and --jobs must be positive")
        if self.scheduler and self.cluster:
            raise InputError("--scheduler and --cluster exclude each other: give one of them")
        if self.cluster not in ("", *CLUSTERS):
            raise InputError(f"there is no cluster {self.cluster!r}: {nearest(self.cluster, CLUSTERS, 'clusters')}")
        if self.scheduler and not self.scheduler.startswith("tls://") and not self.insecure:
            raise InputError(f"the scheduler at {self.scheduler!r} is not encrypted: use tls://, or add --insecure")
        if limited and not self.processes and not self.remote:
            raise InputError("limits need worker processes: give --workers 1")
        if self.remote and self.gigabytes is not None:
            raise InputError("--memory-limit applies to local workers: leave it out")

    @property
    def remote(self) -> bool:
        return bool(self.scheduler or self.cluster)

    @property
    def place(self) -> str:
        """Where the cases are computed, without addresses."""
        if self.remote:
            return f"{self.jobs} jobs of {self.cluster}" if self.cluster else "a dask scheduler"
        return f"{self.processes} worker process{'es' * (self.processes > 1)}" if self.processes else "one process"

    @property
    def options(self) -> tuple[str, ...]:
        """Words that give one case alone the same limits."""
        limits = [] if self.case_seconds == HOUR else [f"--time-limit={self.case_seconds:g}"]
        return ("--workers=1", *limits, *([] if self.gigabytes is None else [f"--memory-limit={self.gigabytes:g}"]))


def compute(job: Job, tasks: Sequence[Task], workers: Workers, stopped: threading.Event) -> Iterator[list[Outcome]]:
    """Outcomes of the tasks in the order in which they end, empty while none ends; a stopped run ends earlier."""
    if workers.processes or workers.remote:
        # A run in this process needs no import of dask's scheduler.
        yield from named("critflow.workflow.distribution:compute_in_workers")(job, tasks, workers, stopped)
        return
    for task in tasks:
        if stopped.is_set():
            return
        yield run_cases(job, task)
