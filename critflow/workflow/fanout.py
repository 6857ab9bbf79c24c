"""Handing batches to workers: in this process, in local worker processes, or through a scheduler elsewhere.

Every way is a function of a list of batches that yields each batch with its outcomes as it ends, or with None when the
worker process died on it.
"""

from __future__ import annotations

import logging
import os
import queue
import signal
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import CancelledError
from contextlib import contextmanager
from multiprocessing import resource_tracker
from pathlib import Path
from types import FrameType
from uuid import uuid4

import dask.config
from distributed import Client, Future, KilledWorker, LocalCluster

from critflow.result import EnvironmentFailure
from critflow.workflow import batch as work
from critflow.workflow.attempts import Watch
from critflow.workflow.limits import Limits

Batch = Sequence[Mapping[str, int | str]]
FanOut = Callable[[Sequence[Batch]], Iterator[tuple[Batch, list[work.Outcome] | None]]]

ONE_THREAD = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "VECLIB_MAXIMUM_THREADS",
    "NUMEXPR_NUM_THREADS",
)

_DASK = {
    "distributed.worker.profile.enabled": False,
    "distributed.scheduler.http.routes": [],
    # Cases allocate and free the same arrays again and again; memory given back to the system each time costs a tenth.
    "distributed.nanny.pre-spawn-environ.MALLOC_TRIM_THRESHOLD_": str(2**28),
    "distributed.nanny.pre-spawn-environ.MALLOC_MMAP_THRESHOLD_": str(2**28),
}
# Without an address dask would still listen on port 8787, and warn when a second run finds it taken.
_NO_DASHBOARD = {"dashboard": False, "dashboard_address": "127.0.0.1:0"}
_WAIT_FOR_SCHEDULER = 10.0  # seconds
_WAIT_FOR_WORKERS = 60.0  # seconds: a batch system may be slow to give them


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
def fan_out(job: work.Job, interruption: Interruption, workers: int, scheduler: str | None) -> Iterator[FanOut]:
    """The way of computing batches that the command line asked for."""
    if scheduler is not None:
        with _remote_client(scheduler) as client:
            yield lambda batches: _through_dask(client, job, interruption, batches)
    elif workers > 0:
        with _local_client(workers, job.limits or Limits()) as client:
            yield lambda batches: _through_dask(client, job, interruption, batches)
    else:
        yield lambda batches: ((batch, _outcomes(work.run_batch(job, batch))) for batch in batches)


def _outcomes(plain: list[tuple]) -> list[work.Outcome]:
    return [work.Outcome(*fields) for fields in plain]


def _through_dask(
    client: Client, job: work.Job, interruption: Interruption, batches: Sequence[Batch]
) -> Iterator[tuple[Batch, list[work.Outcome] | None]]:
    ended: queue.SimpleQueue[Future] = queue.SimpleQueue()
    running: dict[str, tuple[Future, Batch]] = {}
    for batch in batches:
        # A key of its own for every try: dask would answer a known key with the result it has.
        key = f"critflow-{job.run}-{uuid4().hex[:12]}"
        future = client.submit(work.run_batch, job, batch, key=key, pure=False)
        running[key] = future, batch
        future.add_done_callback(ended.put)
    told, watch = False, Watch(job.run, Path(job.shards), (job.limits or Limits()).silence)
    while running:
        if interruption.asked and not told:
            client.run(work.stop, job.run, on_error="ignore")
            told = True
        try:
            future = ended.get(timeout=0.1)  # wakes up to look at the interruption
        except queue.Empty:
            watch.look()
            continue
        _, batch = running.pop(str(future.key))
        try:
            yield batch, _outcomes(future.result())
        except KilledWorker:
            yield batch, None
        except CancelledError as error:
            raise EnvironmentFailure("the scheduler went away: run the same command again to resume") from error


@contextmanager
def _remote_client(address: str) -> Iterator[Client]:
    try:
        client = Client(address, timeout=_WAIT_FOR_SCHEDULER, set_as_default=False)
    except (OSError, ValueError) as error:
        raise EnvironmentFailure(f"no scheduler answers at {address}: start one, or leave --scheduler out") from error
    with client:
        try:
            client.wait_for_workers(1, timeout=_WAIT_FOR_WORKERS)
        except TimeoutError as error:
            raise EnvironmentFailure(f"the scheduler at {address} has no workers: start some") from error
        yield client


@contextmanager
def _local_client(workers: int, limits: Limits) -> Iterator[Client]:
    """A cluster of one-thread worker processes that listens on this machine alone."""
    before = {name: os.environ.get(name) for name in ONE_THREAD}
    os.environ.update(dict.fromkeys(ONE_THREAD, "1"))  # read by the libraries when a worker imports them
    try:
        with dask.config.set(_DASK | limits.dask_config()):
            cluster = _local_cluster(workers, limits)
            try:
                with Client(cluster, set_as_default=False) as client:
                    yield client
            except BaseException:
                _kill_workers(cluster)
                raise
            finally:
                cluster.close(timeout=10)
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def _local_cluster(workers: int, limits: Limits) -> LocalCluster:
    try:
        with _interrupts_held_back():
            return LocalCluster(
                n_workers=workers,
                threads_per_worker=1,
                processes=True,
                memory_limit=limits.memory_limit,
                host="127.0.0.1",
                scheduler_kwargs=_NO_DASHBOARD,
                silence_logs=logging.CRITICAL,
            )
    except Exception as error:
        sentence = f"cannot start {workers} worker processes ({error}): try fewer, or --workers 0"
        raise EnvironmentFailure(sentence) from error


@contextmanager
def _interrupts_held_back() -> Iterator[None]:
    """Answer a Ctrl-C after the block; processes born in it, or later by threads born in it, never see one.

    A terminal sends Ctrl-C to every process of a command, but it is for the command to decide what happens.
    """
    resource_tracker.ensure_running()  # starting it inside would lift the mask
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _kill_workers(cluster: LocalCluster) -> None:
    """End the workers in the middle of what they do; stored cases are complete, so nothing is lost."""
    # From here on dask has only news of connections that this breaks, some with tracebacks.
    logging.getLogger("distributed").handlers = [logging.NullHandler()]
    for nanny in cluster.workers.values():
        nanny.auto_restart = False
        if nanny.pid is not None:
            os.kill(nanny.pid, signal.SIGKILL)
