"""Handing batches to workers: in this process, in local worker processes, or through a scheduler elsewhere.

Every way is a function of a list of batches that yields each batch with its outcomes as it ends, or with None when the
worker process died on it.
"""

from __future__ import annotations

import itertools
import os
import queue
import signal
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import contextmanager
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from types import FrameType
from uuid import uuid4

from distributed import Client, Future, KilledWorker

from critflow.result import EnvironmentFailure
from critflow.workflow import batch as work
from critflow.workflow.attempts import Watch
from critflow.workflow.clusters import client_of
from critflow.workflow.groups import Batch, Groups
from critflow.workflow.jobs import Jobs
from critflow.workflow.limits import Limits
from critflow.workflow.profiles import Cluster

FanOut = Callable[[Sequence[Batch]], Iterator[tuple[Batch, list[work.Outcome] | None]]]

_WITHOUT_WORKERS = 60.0  # seconds: a worker that died is replaced sooner
_FETCHED_WITHIN = 10.0  # seconds: results are a few words


class Interruption:
    """First Ctrl-C or SIGTERM: what runs finishes and nothing new begins.  Second: `KeyboardInterrupt` at once."""

    def __init__(self, run: str):
        self.run = run
        self.asked = False

    def __enter__(self) -> Interruption:
        self.before = {}
        if threading.current_thread() is threading.main_thread():  # only there can signals be caught
            self.before = {number: signal.signal(number, self._ask) for number in (signal.SIGINT, signal.SIGTERM)}
        return self

    def __exit__(self, *_: object) -> None:
        for number, handler in self.before.items():
            signal.signal(number, handler)

    def _ask(self, number: int, frame: FrameType | None) -> None:
        if self.asked:
            raise KeyboardInterrupt
        self.asked = True
        work.stop(self.run)
        # Not through the console: its lock or buffer may be held by the very line that was interrupted.
        os.write(2, b"\nstopping: what runs now finishes and is stored; press Ctrl-C again to stop at once\n")


@contextmanager
def fan_out(job: work.Job, interruption: Interruption, workers: int, cluster: Cluster | None) -> Iterator[FanOut]:
    """The way of computing batches that the command line asked for."""
    if cluster is not None or workers > 0:
        limits = job.limits or Limits()
        with client_of(cluster, workers, limits, Path(job.shards), lambda: interruption.asked) as (client, jobs):
            yield lambda batches: _through_dask(client, job, interruption, batches, jobs)
    else:
        yield lambda batches: ((batch, _outcomes(work.run_batch(job, batch))) for batch in batches)


def _outcomes(plain: list[tuple]) -> list[work.Outcome]:
    return [work.Outcome(*fields) for fields in plain]


def _through_dask(
    client: Client, job: work.Job, interruption: Interruption, batches: Sequence[Batch], jobs: Jobs | None = None
) -> Iterator[tuple[Batch, list[work.Outcome] | None]]:
    ended: queue.SimpleQueue[Future] = queue.SimpleQueue()
    running: dict[str, tuple[Future, list[Batch]]] = {}
    groups, crew, told = Groups(batches), _Crew(client, jobs), False
    watch = Watch(job.run, Path(job.shards), (job.limits or Limits()).silence)
    while True:
        # Two tasks for each worker: none waits for the next, and the times of the first decide about the others.
        size = crew.size()  # looked at when interrupted too: what runs may never end where no worker is left
        while not interruption.asked and len(running) < 2 * size and (group := groups.next(size)):
            # A key of its own for every try: dask would answer a known key with the result it has.
            key = f"critflow-{job.run}-{uuid4().hex[:12]}"
            future = client.submit(_timed, job, [values for batch in group for values in batch], key=key, pure=False)
            running[key] = future, group
            future.add_done_callback(ended.put)
        if not running and (interruption.asked or not groups.cases_left):
            return
        if interruption.asked and not told:
            client.run(work.stop, job.run, on_error="ignore")
            told = True
        try:
            future = ended.get(timeout=0.1)  # wakes up to look at the interruption
        except queue.Empty:
            watch.look()
            continue
        _, group = running[str(future.key)]
        try:
            seconds, plain = future.result(timeout=_FETCHED_WITHIN)
        except TimeoutError:  # the worker died before it gave the result away, and another computes it again
            future.add_done_callback(ended.put)
            watch.look()
            continue
        except KilledWorker:
            del running[str(future.key)]
            yield from ((batch, None) for batch in group)
            continue
        except CancelledError as error:
            raise EnvironmentFailure("the scheduler went away: run the same command again to resume") from error
        del running[str(future.key)]
        groups.note(len(plain), seconds)
        outcomes = iter(_outcomes(plain))
        for batch in group:
            yield batch, list(itertools.islice(outcomes, len(batch)))


def _timed(job: work.Job, batch: Batch) -> tuple[float, list[tuple]]:
    """In a worker: the outcomes, and how long they took with all that surrounds the cases."""
    start = time.perf_counter()
    outcomes = work.run_batch(job, batch)
    return time.perf_counter() - start, outcomes


class _Crew:
    """How many workers a client has; some may come later or leave."""

    def __init__(self, client: Client, jobs: Jobs | None):
        self.client, self.jobs = client, jobs
        self.looked, self.workers = -1.0, dict[str, int]()
        self.seen = time.monotonic()

    def size(self) -> int:
        """The number, not older than a second; an error when there has been none for long."""
        now = time.monotonic()
        if now - self.looked > 1.0:
            before, self.workers, self.looked = self.workers, self.client.nthreads(), now
            if new := list(self.workers.keys() - before):
                self._greet(new)
            if self.workers:
                self.seen = now
            elif now - self.seen > (self.jobs.patience if self.jobs else _WITHOUT_WORKERS):
                where = self.jobs.where if self.jobs else ""
                raise EnvironmentFailure(f"all workers went away: run the same command again to resume{where}")
            if self.jobs:
                self.jobs.look()
        return sum(self.workers.values())

    def _greet(self, workers: list[str]) -> None:
        """A task would kill a worker that cannot read it, and its nanny would start another, and so on."""
        answers = self.client.run(version, "critflow", workers=workers, on_error="return")
        if any(isinstance(answer, PackageNotFoundError) for answer in answers.values()):
            raise EnvironmentFailure("a worker has no critflow: install it in the Python of all workers")
