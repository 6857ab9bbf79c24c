"""Clients of dask: of worker processes here, of a scheduler elsewhere, of jobs of a batch system."""

from __future__ import annotations

import importlib
import logging
import os
import shutil
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from multiprocessing import resource_tracker
from pathlib import Path
from tempfile import mkdtemp
from typing import Any

import dask.config
from distributed import Client, LocalCluster
from distributed.security import Security

from critflow.result import EnvironmentFailure, InputError
from critflow.workflow.errors import Interrupted
from critflow.workflow.jobs import Jobs, noting
from critflow.workflow.limits import Limits
from critflow.workflow.profiles import Cluster

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
    "distributed.worker.http.routes": [],
    # Cases allocate and free the same arrays again and again; memory given back to the system each time costs a tenth.
    "distributed.nanny.pre-spawn-environ.MALLOC_TRIM_THRESHOLD_": str(2**28),
    "distributed.nanny.pre-spawn-environ.MALLOC_MMAP_THRESHOLD_": str(2**28),
}
# Without an address dask would still listen on port 8787, and warn when a second run finds it taken.
NO_DASHBOARD: dict[str, Any] = {"dashboard": False, "dashboard_address": "127.0.0.1:0"}
_WAIT_FOR_SCHEDULER = 10.0  # seconds
_KEYS = ".keys-"
_SYSTEMS = {  # module and class of dask-jobqueue
    "slurm": ("slurm", "SLURMCluster"),
    "pbs": ("pbs", "PBSCluster"),
    "htcondor": ("htcondor", "HTCondorCluster"),
    "local": ("local", "LocalCluster"),
}


@contextmanager
def client_of(
    cluster: Cluster | None, workers: int, limits: Limits, shared: Path, stopped: Callable[[], bool]
) -> Iterator[tuple[Client, Jobs | None]]:
    """A client with at least one worker, and its jobs; these find their credentials in the `shared` folder."""
    if cluster is None:
        with _local_client(workers, limits) as client:
            yield client, None
    elif cluster.system == "scheduler":
        with _remote_client(cluster) as client:
            _wait_for_worker(client, None, cluster, stopped)
            yield client, None
    else:
        with _jobs_client(cluster, limits, shared, stopped) as (client, jobs):
            _wait_for_worker(client, jobs, cluster, stopped)
            yield client, jobs


def _wait_for_worker(client: Client, jobs: Jobs | None, cluster: Cluster, stopped: Callable[[], bool]) -> None:
    end = time.monotonic() + cluster.wait
    while not client.nthreads():
        if stopped():
            raise Interrupted("interrupted before a worker was there: run the same command again")
        if time.monotonic() > end:
            what = f"look at its queue, or raise `wait`{jobs.where}" if jobs else "start some"
            raise EnvironmentFailure(f"no worker of {cluster} came within {cluster.wait:.0f} s: {what}")
        if jobs:
            jobs.look()
        time.sleep(0.1)


@contextmanager
def _remote_client(cluster: Cluster) -> Iterator[Client]:
    files = {"ca_file": "tls_ca_file", "cert": "tls_client_cert", "key": "tls_client_key"}
    security = None
    if cluster.tls:
        security = Security(require_encryption=True, **{files[key]: path for key, path in cluster.tls.items()})

    def join() -> Client:
        try:
            return Client(cluster.address, timeout=_WAIT_FOR_SCHEDULER, security=security, set_as_default=False)
        except TypeError as error:  # for tls:// where neither the profile nor dask's settings have certificates
            sentence = f"{cluster.address} needs certificates: name ca_file, cert and key in a profile"
            raise InputError(sentence) from error
        except (OSError, ValueError) as error:
            sentence = f"no scheduler answers at {cluster.address}: start one, or name another cluster"
            raise EnvironmentFailure(sentence) from error

    with _joined(join) as client:
        yield client


@contextmanager
def _joined(join: Callable[[], Client]) -> Iterator[Client]:
    """A client that is closed whenever it was made: one left open holds up the end of the interpreter for a minute."""
    client = None
    try:
        with _interrupts_held_back():
            client = join()
        yield client
    finally:
        if client is not None:
            client.close()


@contextmanager
def _jobs_client(
    cluster: Cluster, limits: Limits, shared: Path, stopped: Callable[[], bool]
) -> Iterator[tuple[Client, Jobs]]:
    """Jobs of a batch system that work for this process, over TLS with credentials of this run alone."""
    settings = _DASK | limits.dask_config()
    logs = Path(cluster.options.get("log_directory") or shared.parent / "jobs").expanduser().absolute()
    for path in (shared.parent, logs):
        if len(str(path).split()) > 1:  # no batch system has the same rules for quotes as another
            raise InputError(f"batch jobs cannot write to {path}, which has a blank in it: choose another folder")
    with _credentials(shared) as (security, keys), dask.config.set(settings):
        options = job_options(cluster, security, settings, logs)
        dask_jobs = _jobs_begun(cluster, options, keys)
        try:
            jobs = Jobs(dask_jobs, cluster, keys, None if cluster.system == "local" else logs, stopped)
            with _joined(lambda: Client(dask_jobs, set_as_default=False)) as client:
                yield client, jobs
        finally:
            dask_jobs.close(timeout=10)


@contextmanager
def _credentials(shared: Path) -> Iterator[tuple[Security, Path]]:
    """Of this run alone: those of its jobs in a folder that only this user can read, as long as they are needed."""
    for left_over in shared.glob(f"{_KEYS}*"):  # of a run that was killed
        shutil.rmtree(left_over)
    security = Security.temporary()
    folder = Path(mkdtemp(prefix=_KEYS, dir=shared))
    try:
        for field in ("tls_ca_file", "tls_worker_cert", "tls_worker_key"):
            path = folder / field
            path.touch(mode=0o600)
            path.write_text(getattr(security, field))
            setattr(security, field, str(path))
        yield security, folder
    finally:
        for _ in range(9):  # a job that ends may leave a note meanwhile
            shutil.rmtree(folder, ignore_errors=True)


def _jobs_begun(cluster: Cluster, options: dict[str, Any], notes: Path) -> Any:
    try:
        kind = jobs_class(cluster.system)
        job = kind.job_cls if cluster.system == "local" else noting(kind.job_cls, notes)
        job("tls://head:1", name="probe", **options)  # what is wrong is told before there is a scheduler
        here = {"host": "127.0.0.1"} if cluster.system == "local" else {}
        with _interrupts_held_back():
            words = {"scheduler_options": NO_DASHBOARD | here, "silence_logs": logging.CRITICAL}
            return kind(job_cls=job, **words, **options)
    except ImportError as error:
        sentence = "batch systems need dask-jobqueue: install it with pip install dask-jobqueue"
        raise EnvironmentFailure(sentence) from error
    except Exception as error:
        raise EnvironmentFailure(f"cannot make jobs of profile {cluster.name!r}: {error}: mend the profile") from error


def jobs_class(system: str) -> Any:
    """The class of dask-jobqueue for a batch system."""
    module, name = _SYSTEMS[system]
    interrupt = signal.getsignal(signal.SIGINT)
    try:
        return getattr(importlib.import_module(f"dask_jobqueue.{module}"), name)
    finally:
        signal.signal(signal.SIGINT, interrupt)  # dask-jobqueue takes Ctrl-C for itself when it is imported


def job_options(cluster: Cluster, security: Security, settings: dict[str, object], logs: Path) -> dict[str, Any]:
    """What dask-jobqueue is told of a job: workers of one thread over TLS, and what the profile says."""
    words, options = ["--no-dashboard", "--dashboard-address", "127.0.0.1:0"], dict(cluster.options)
    if cluster.system == "local":
        words += ["--host", "127.0.0.1"]
    else:
        exports = [f"export {name}=1" for name in ONE_THREAD]
        exports.append(f"export DASK_INTERNAL_INHERIT_CONFIG={dask.config.serialize(settings)}")
        options["job_script_prologue"] = [*exports, *options.get("job_script_prologue", [])]
        options |= {"job_name": "critflow", "log_directory": str(logs)}
    if cluster.system == "htcondor":  # the only one whose directives are not lines
        directives = [line.partition("=") for line in options.get("job_extra_directives", [])]
        options["job_extra_directives"] = {key.strip(): value.strip() for key, _, value in directives}
    options |= {"cores": cluster.workers, "processes": cluster.workers, "worker_extra_args": words}
    return options | {"protocol": "tls://", "security": security}


@contextmanager
def _local_client(workers: int, limits: Limits) -> Iterator[Client]:
    """A cluster of one-thread worker processes that listens on this machine alone, and only to who has its key."""
    before = {name: os.environ.get(name) for name in ONE_THREAD}
    os.environ.update(dict.fromkeys(ONE_THREAD, "1"))  # read by the libraries when a worker imports them
    try:
        with dask.config.set(_DASK | limits.dask_config()):
            cluster = _local_cluster(workers, limits)
            try:
                with _joined(lambda: Client(cluster, set_as_default=False)) as client:
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
    with suppress(Exception):  # a worker that is killed while it starts may have been unlucky
        return _begun(workers, limits)
    try:
        return _begun(workers, limits)
    except Exception as error:
        sentence = f"cannot start {workers} worker processes ({error}): try fewer, or --workers 0"
        raise EnvironmentFailure(sentence) from error


def _begun(workers: int, limits: Limits) -> LocalCluster:
    with _interrupts_held_back():
        return LocalCluster(
            n_workers=workers,
            threads_per_worker=1,
            processes=True,
            memory_limit=limits.memory_limit,
            host="127.0.0.1",
            protocol="tls://",
            security=Security.temporary(),
            scheduler_kwargs=NO_DASHBOARD,
            silence_logs=logging.CRITICAL,
        )


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
