"""Worker processes by dask, local ones or those of a scheduler, and what follows if one dies.

If a worker dies, a trace file names the case that ran.  The task is submitted again with this case as its last one,
and the case fails after `ATTEMPTS` deaths.  A local cluster listens on the loopback address with temporary TLS
certificates.
"""

from __future__ import annotations

import logging
import math
import os
import signal
import threading
import time
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import CancelledError
from contextlib import contextmanager, suppress
from itertools import islice
from multiprocessing import resource_tracker
from pathlib import Path
from uuid import uuid4

import dask.config
from distributed import Client, Future, LocalCluster, as_completed
from distributed.comm.core import CommClosedError
from distributed.scheduler import KilledWorker, NoWorkerError
from distributed.security import Security
from distributed.system import MEMORY_LIMIT

from critflow.engine.settings import Workers
from critflow.engine.store import RESUME, Folder
from critflow.engine.tasks import Job, Outcome, compute_network, record_failure, take_trace
from critflow.result import EnvironmentFailure, InputError

Task = Sequence[Mapping[str, int | str]]  # axis values of the cases of one network

ATTEMPTS = 3
_GRACE = 60.0  # seconds beyond the time limit before the scheduler restarts a silent worker
_WORKERS_START = 60.0  # seconds: local workers that died are back earlier
_ANSWER = 10.0  # seconds in which a scheduler answers
_BUSY = 60.0  # the same of one that has much to do
_LOOK = 1.0  # seconds between two looks at the workers of a scheduler
_SUBMITTED = 1000  # tasks at the scheduler at once, where each takes 20 kB, and more where it has many threads
_TASKS = 2  # submitted for each thread, so that none waits for the command
_UNEXPLAINED = 20  # deaths in a row without a running case: the workers cannot start
_NO_CASE = ""  # of a death in which no case ran
# Of the workers; those of a scheduler elsewhere have settings of their own.
_SETTINGS = {
    "distributed.worker.profile.enabled": False,
    "distributed.scheduler.http.routes": [],
    "distributed.worker.http.routes": [],
    # A death is reported at once: trace files decide which case is tried again.
    "distributed.scheduler.allowed-failures": 0,
    # Arrays do not stay in workers: nothing to spill, and a paused worker would never continue.
    **dict.fromkeys((f"distributed.worker.memory.{name}" for name in ("target", "spill", "pause")), False),
    # Cases allocate the same arrays again and again: returning the memory each time costs 10 % of the time.
    "distributed.nanny.pre-spawn-environ.MALLOC_TRIM_THRESHOLD_": str(2**28),
    "distributed.nanny.pre-spawn-environ.MALLOC_MMAP_THRESHOLD_": str(2**28),
}


def compute_in_workers(
    job: Job, tasks: Sequence[Task], workers: Workers, stopped: threading.Event
) -> Iterator[list[Outcome]]:
    """Outcomes of the tasks in the order in which they end, empty while none ends; a stopped run ends earlier."""
    processes = min(workers.processes, len(tasks))
    connected = _scheduler_client(workers) if workers.scheduler else _local_client(workers, processes)
    with dask.config.set(_SETTINGS), _without_news(), connected as client:
        completed = as_completed([], loop=client.loop)  # `with_results` never returns a result that a death deleted
        running, deaths = dict[Future, Task](), Counter[str]()
        waiting, cancelled, wanted = iter(tasks), False, _tasks_wanted(client, workers.scheduler)

        def submit(task: Task, careful: bool = False) -> None:
            # A new key for every attempt: dask answers a known key with the stored result.
            future = client.submit(compute_network, job, task, careful, key=f"critflow-{uuid4().hex}", pure=False)
            running[future] = task
            completed.add(future)

        while True:
            # Submit as many tasks as the scheduler should have.
            if not stopped.is_set():
                for task in islice(waiting, max(0, next(wanted) - len(running))):
                    submit(task)
            if not running:
                return
            if stopped.is_set() and not cancelled:
                cancelled = True
                # Cancel those that no worker has begun; those that ended meanwhile are still to be counted.
                idle = list[Future]()
                with suppress(OSError):  # of a scheduler that ended, which is reported below
                    begun = {key for keys in client.processing().values() for key in keys}
                    begun |= {key for key, holders in client.who_has().items() if holders}
                    idle = [future for future in running if future.key not in begun]
                    client.cancel(idle)
                for future in idle:
                    del running[future]
            ended = completed.next_batch(block=False)
            if not ended:
                next(wanted)
                time.sleep(0.05)
                yield []
            # Count what ended, and submit again what died.
            for future in (future for future in ended if future in running):
                task, again = running.pop(future), list[Mapping[str, int | str]]()
                try:
                    outcomes = future.result(timeout=_ANSWER)
                    deaths[_NO_CASE] = 0
                except (KilledWorker, NoWorkerError, CancelledError) as error:
                    outcomes, again = ([], []) if stopped.is_set() else _explained(job, task, deaths, error)
                except TimeoutError:  # its worker died with the result, and no other one is there
                    running[future] = task
                    completed.add(future)
                    next(wanted)
                    continue
                yield outcomes
                if again:
                    submit(again, careful=True)


def _tasks_wanted(client: Client, address: str) -> Iterator[int]:
    """How many tasks the scheduler should have now: more with more threads, which a batch system adds.

    Raises `EnvironmentFailure` where a scheduler of the user had no worker for a time: a run would wait for ever.
    Local workers are restarted.
    """
    present, asked, threads = time.monotonic(), -math.inf, 0
    while True:
        now = time.monotonic()
        if address and now - asked >= _LOOK:
            asked = now
            try:
                threads = sum(client.nthreads(callback_timeout=_BUSY).values())
            except OSError as error:
                said = "does not answer" if isinstance(error, TimeoutError) else "ended"
                raise EnvironmentFailure(f"the scheduler {said}: {RESUME}") from error
            present = now if threads else present
            if now - present > _WORKERS_START:
                raise EnvironmentFailure(
                    f"the scheduler at {address} has had no worker for {_WORKERS_START:.0f} s: start some, and {RESUME}"
                )
        yield max(_SUBMITTED, _TASKS * threads)


def _explained(
    job: Job, task: Task, deaths: Counter[str], error: Exception
) -> tuple[list[Outcome], list[Mapping[str, int | str]]]:
    """Failed cases of a task without a result, and those to submit again; raises errors of the run.

    deaths  of each case, and those in a row without a case
    """
    if not isinstance(error, KilledWorker):
        ended = "all workers" if isinstance(error, NoWorkerError) else "the scheduler"
        raise EnvironmentFailure(f"{ended} ended: {RESUME}") from error
    selection, folder = job.selection(), Folder(Path(job.folder))
    failed, again, last = list[Outcome](), list[Mapping[str, int | str]](), list[Mapping[str, int | str]]()
    dead, reason = take_trace(folder.trace(selection.case(**task[0])))
    for values in task:
        case = selection.case(**values)
        deaths[case.id] += case.id == dead
        if case.id == dead and deaths[dead] == ATTEMPTS:
            failed.append(record_failure(job, selection.study, case, f"{reason}, in {ATTEMPTS} attempts"))
        else:
            (last if case.id == dead else again).append(values)
    # Without a trace the task waited in a worker that died, or the worker cannot start.
    deaths[_NO_CASE] = 0 if failed or last else deaths[_NO_CASE] + 1
    if deaths[_NO_CASE] == _UNEXPLAINED:
        raise EnvironmentFailure("the worker processes end before they begin a case: try fewer, or --workers 0")
    return failed, [*again, *last]


@contextmanager
def _local_client(workers: Workers, processes: int) -> Iterator[Client]:
    """A client of worker processes on this machine, which are killed where the run ends with an error."""
    settings = {
        # A worker that does not answer, for example a stopped process, is restarted.
        "distributed.scheduler.worker-ttl": f"{workers.case_seconds + _GRACE:.3f}s",
        "distributed.scheduler.no-workers-timeout": f"{_WORKERS_START}s",
        # The nanny restarts a worker as often as it dies; this would dismiss a slow one.
        "distributed.deploy.lost-worker-timeout": "365 days",
    }
    with dask.config.set(settings):
        try:
            with _without_interrupts():
                cluster = LocalCluster(
                    n_workers=processes,
                    threads_per_worker=1,
                    processes=True,
                    # The default of dask is the share of a core, which one worker of two cores would be half of.
                    memory_limit=int(workers.gigabytes * 1e9 if workers.gigabytes else MEMORY_LIMIT / processes),
                    host="127.0.0.1",
                    security=True,
                    scheduler_kwargs={"dashboard": False, "dashboard_address": "127.0.0.1:0"},
                    silence_logs=logging.CRITICAL,
                )
        except Exception as error:
            raise EnvironmentFailure(
                f"cannot start {processes} worker processes ({error}): try fewer, or --workers 0"
            ) from error
        try:
            with _without_interrupts():
                client = Client(cluster, set_as_default=False)
            with client:  # an open one delays the end of the interpreter by a minute
                yield client
        except BaseException:
            for nanny in cluster.workers.values():  # stored cases are complete
                nanny.auto_restart = False
                if nanny.pid is not None:
                    os.kill(nanny.pid, signal.SIGKILL)
            raise
        finally:
            with suppress(TimeoutError):  # its processes end with this one, and every case is stored
                cluster.close(timeout=10)


@contextmanager
def _scheduler_client(workers: Workers) -> Iterator[Client]:
    """A client of the scheduler of the user, which has a worker."""
    address, security = workers.scheduler, Security(require_encryption=not workers.insecure)
    # A client that fails without certificates is closed by the garbage collector, which may block the start of another.
    if address.startswith("tls://") and security.get_connection_args("client").get("ssl_context") is None:
        raise InputError(f"{address} needs certificates: set distributed.comm.tls in dask's configuration")
    try:
        with _without_interrupts():
            client = Client(address, timeout=10, security=security, set_as_default=False)
    except (OSError, ValueError) as error:
        raise EnvironmentFailure(f"no scheduler answers at {address}: start one, or give another address") from error
    with client:
        try:
            client.wait_for_workers(1, timeout=_WORKERS_START)
        except TimeoutError as error:
            raise EnvironmentFailure(f"the scheduler at {address} has no worker: start some") from error
        yield client


@contextmanager
def _without_news() -> Iterator[None]:
    """Silence dask's messages: what ends a run is one sentence, and broken connections are reported after it too."""
    names = [name for name in logging.root.manager.loggerDict if name.split(".")[0] in ("distributed", "asyncio")]
    enabled = [logger for logger in map(logging.getLogger, names) if not logger.disabled]
    for logger in enabled:
        logger.disabled = True
    try:
        yield
    except CommClosedError as error:
        raise EnvironmentFailure(f"the scheduler ended: {RESUME}") from error
    finally:
        for logger in enabled:
            logger.disabled = False


@contextmanager
def _without_interrupts() -> Iterator[None]:
    """Delay Ctrl-C until the end of the block; processes started in it, or by its threads, never receive one.

    A terminal sends Ctrl-C to every process of a command, but only the command responds.
    """
    resource_tracker.ensure_running()  # started inside, it would lift the mask
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
