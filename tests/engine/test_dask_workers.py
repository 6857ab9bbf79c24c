"""Worker processes: failing cases, schedulers, the program for batch systems, and who can reach a run."""

import json
import os
import re
import shlex
import signal
import socket
import ssl
import subprocess
import sys
import threading
import time
from contextlib import nullcontext, suppress
from copy import deepcopy
from http.client import HTTPException
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import Mock
from urllib.error import HTTPError
from urllib.request import urlopen

import dask.config
import numpy as np
import psutil
import pytest
import xarray as xr
from distributed import Client, LocalCluster
from distributed.security import Security
from distributed.system import MEMORY_LIMIT
from disturbed import begun, ended, messages, numbers_of, stored_files, stored_whole, wait_until
from problems import forbidden

from critflow.command.main import main
from critflow.engine import dask_workers
from critflow.engine.code_digest import load_file
from critflow.engine.settings import Workers, select
from critflow.result import EnvironmentFailure, Status

pytestmark = pytest.mark.timeout(300)

POISONED = Path(__file__).with_name("poisoned_study.py")
RAISING = {  # kinds, and a word of their records
    "raises": "acts",
    "unprintable": "Unprintable",
    "outside": "Outside",
    "surrogate": "ValueError",
    "long": "xxx",
    "exits": "SystemExit",
    "returns_function": "object",
    "returns_list": "dict",
    "recurses": "RecursionError",
}


def case_of(kind, *settings):
    return select(load_file(POISONED).study, [f"kinds={kind}", *settings]).case(kind=kind, seed=1)


def record(folder, kind, *settings):
    return (folder / "failed" / f"{case_of(kind, *settings).id}.txt").read_text()


def assert_only_the_bad_cases_failed(folder, kinds):
    """Of the three cases of every kind the middle one failed."""
    with xr.open_dataset(folder / "poisoned.nc") as dataset:
        status = dataset.status.transpose("kind", "seed").values
    assert (status == np.array([Status.ok, Status.failed, Status.ok])).all(), status
    assert len(list((folder / "failed").iterdir())) == len(kinds)
    assert len(list((folder / "shards").iterdir())) == len(kinds)  # one for each value of the first axis


def test_local_workers_share_the_memory_of_the_machine():
    """By default of dask one worker of two cores would have half."""
    processes = 1
    with dask.config.set(dask_workers._SETTINGS), dask_workers._local_client(Workers(processes), processes) as client:
        workers = client.scheduler_info()["workers"].values()
        assert sum(worker["memory_limit"] for worker in workers) == pytest.approx(MEMORY_LIMIT, rel=1e-3)


def test_whatever_a_case_raises_or_returns_the_others_are_computed(tmp_path, output_of):
    err = output_of(tmp_path, f"kinds={','.join(RAISING)}", study="poisoned", code=3).err
    assert f"{len(RAISING)} cases failed" in err
    assert max(map(len, err.splitlines())) < 400
    assert_only_the_bad_cases_failed(tmp_path, RAISING)
    for kind, word in RAISING.items():
        assert word in record(tmp_path, kind)
        assert len(record(tmp_path, kind)) < 25_000


DEADLY = {"kills_itself": "SIGKILL|died|ended", "leaks": "memory", "hangs_in_compiled_code": "time limit"}


def test_whatever_a_case_does_to_its_worker_the_others_are_computed(tmp_path, output_of, monkeypatch, forked):
    """Also of tasks that are submitted when others have ended."""
    monkeypatch.setattr(dask_workers, "_SUBMITTED", 2)
    limits = ("--time-limit=2", "--memory-limit=0.6")
    kinds = f"kinds={','.join(DEADLY)}"
    assert "Traceback" not in output_of(tmp_path, kinds, workers=2, more=limits, study="poisoned", code=3).err
    assert_only_the_bad_cases_failed(tmp_path, DEADLY)
    for kind, words in DEADLY.items():
        assert any(word in record(tmp_path, kind) for word in words.split("|")), record(tmp_path, kind)


def test_a_case_whose_worker_died_once_is_computed(tmp_path, run, monkeypatch):
    monkeypatch.setenv("CRITFLOW_TEST_MARKS", str(tmp_path))
    assert run(tmp_path / "out", "kinds=kills_itself_once", workers=1, study="poisoned") == 0
    assert (tmp_path / "kills_itself_once").exists()
    assert (xr.load_dataset(tmp_path / "out" / "poisoned.nc").status == Status.ok).all()


def test_deaths_are_counted_by_case_and_stored_cases_are_not_computed_again(tmp_path, run, source, forked):
    """Seeds 1 and 2 kill their worker. The first death loses seed 0; then each case is stored at once."""
    begins, bad = '    if kind != "none" and seed', 'seed == parameters["bad"]'
    tally = tmp_path / "tally.txt"
    counted = f"    with open({str(tally)!r}, 'a') as file:\n        file.write(str(seed))\n"
    study = source(bad, bad.replace("==", ">="), begins, counted + begins, study="poisoned")
    assert run(tmp_path / "out", "kinds=kills_itself", workers=1, study=study) == 3
    assert tally.read_text() == "01021212"  # a case that died is the last one of its task
    dataset = xr.load_dataset(tmp_path / "out" / "poisoned.nc")
    assert dataset.status.values.ravel().tolist() == [Status.ok, Status.failed, Status.failed]


def test_a_cluster_that_is_slow_to_close_ends_no_run(monkeypatch):
    """All cases are stored then; the dataset is to be written."""
    closed = []

    def close(timeout):
        closed.append(timeout)
        raise TimeoutError

    monkeypatch.setattr(dask_workers, "LocalCluster", lambda **_: SimpleNamespace(close=close, workers={}))
    monkeypatch.setattr(dask_workers, "Client", lambda *_, **__: nullcontext())
    with dask_workers._local_client(Workers(1), 1):
        assert not closed
    assert closed == [10]


def fatal():
    """In the process of a run: a case fails at the first death of its worker."""
    dask_workers.ATTEMPTS = 1


def test_a_worker_that_is_killed_while_the_run_stops_fails_no_case(tmp_path):
    out = tmp_path / "out"
    run = begun(out, ["seeds=0:3"], workers=1, environment={"CRITFLOW_TEST_PAUSE": "20"}, prepare=fatal)
    # A trace without a name is of a task that has begun no case, and would begin none after the signal.
    traces = wait_until(
        lambda: [path for path in (out / "shards").glob(".*.trace") if path.stat().st_size],
        run.is_alive,
        lambda: messages(out),
    )
    os.kill(run.pid, signal.SIGINT)
    wait_until((out / ".stop").exists, run.is_alive, lambda: messages(out))
    time.sleep(0.5)
    children = psutil.Process(run.pid).children(recursive=True)

    def tracing():
        return [one for one in children if str(traces[0]) in {file.path for file in one.open_files()}]

    wait_until(tracing, run.is_alive, lambda: messages(out))[0].kill()
    assert ended(run, 60.0) == 130, messages(out)
    assert not list((out / "failed").glob("*.txt")) and not stored_whole(out, ["seeds=0:3"])


def test_the_record_of_a_failed_case_contains_its_parameters_and_the_command_that_runs_it_alone(tmp_path, run):
    setting = "label=a b's"
    assert run(tmp_path / "out", "kinds=none,raises", setting, study="poisoned") == 3
    text = record(tmp_path / "out", "raises", setting)
    assert "Traceback" in text and text.rstrip().endswith("acts")
    assert all(line in text for line in ("kind = raises", "seed = 1", "bad = 1", "label = a b's"))
    (command,) = [line.lstrip("# $") for line in text.splitlines() if "critflow run" in line]
    words = shlex.split(command)[1:]
    chosen = [word.removeprefix("--set=") for word in words if word.startswith("--set=")]
    assert [case.id for case in select(load_file(POISONED).study, chosen).cases] == [case_of("raises", setting).id]
    assert main([*(word for word in words if not word.startswith("--workers")), "--workers=0"]) == 3


def test_a_report_that_fails_with_a_failed_case_does_not_hide_it(tmp_path, output_of, source):
    claims = "return [Claim"
    broken = "broken: set[int] = set()"
    path = source(broken, "broken = {1}", claims, f"assert ds.total.notnull().all(); {claims}", study="plain")
    err = output_of(tmp_path / "out", study=path, code=3).err
    assert "claims" in err and "1 case failed" in err


NO_DASHBOARD = {"dashboard": False, "dashboard_address": "127.0.0.1:0"}


def listening(processes):
    """Addresses at which the processes listen."""
    found = set()
    for process in processes:
        with suppress(psutil.Error):  # it has ended
            ends = process.net_connections("inet")
            found |= {(end.laddr.ip, end.laddr.port) for end in ends if end.status == psutil.CONN_LISTEN}
    return found


def test_a_scheduler_with_certificates_gives_the_same_bits(tmp_path, run, forked):
    """Its worker has several threads, which must take turns with the libraries; one is killed during the run."""
    security = Security.temporary()
    texts = {"ca-file": security.tls_ca_file, "cert": security.tls_client_cert, "key": security.tls_client_key}
    for name, text in texts.items():
        (tmp_path / name).write_text(text)
    keys = {"ca-file": "ca-file", "cert": "client.cert", "key": "client.key"}
    tls = {f"distributed.comm.tls.{key}": str(tmp_path / name) for name, key in keys.items()}
    options = {"protocol": "tls://", "security": security, "scheduler_kwargs": NO_DASHBOARD}
    with LocalCluster(n_workers=1, threads_per_worker=3, **options) as cluster:
        more = ("--scheduler", cluster.scheduler_address)
        with pytest.MonkeyPatch.context() as patch:  # refused before there is a client, which nothing would close
            patch.setattr("critflow.engine.dask_workers.Client", forbidden)
            assert run(tmp_path / "refused", workers=None, more=more, study="algebra") == 2
        with dask.config.set(tls):
            assert run(tmp_path / "out", workers=None, more=more, study="algebra") == 0
    assert run(tmp_path / "serial", study="algebra") == 0
    assert numbers_of(tmp_path / "out") == numbers_of(tmp_path / "serial")
    history = xr.load_dataset(tmp_path / "out" / "algebra.nc").attrs["history"]
    assert cluster.scheduler_address.split("://")[1] not in history


OTHER_LIBRARY = """
from critflow.engine import code_digest
code_digest._versions = lambda: {"scipy": "0.1"}
code_digest.libraries.cache_clear()
"""


def test_a_plain_scheduler_needs_a_flag_and_equal_libraries(tmp_path, output_of, forked):
    options = {"n_workers": 1, "threads_per_worker": 1, "preload": OTHER_LIBRARY}
    with LocalCluster(scheduler_kwargs=NO_DASHBOARD, **options) as cluster:
        address = cluster.scheduler_address
        for word in (address, address.removeprefix("tcp://")):
            more = ("--scheduler", word)
            assert "--insecure" in output_of(tmp_path / "out", workers=None, more=more, study="algebra", code=2).err
        assert not (tmp_path / "out").exists()
        more = ("--scheduler", address, "--insecure")
        assert "scipy 0.1" in output_of(tmp_path / "out", workers=None, more=more, study="algebra", code=6).err
    assert not list((tmp_path / "out" / "shards").glob("*.nc"))


def test_a_scheduler_without_workers_is_reported(tmp_path, output_of, monkeypatch):
    monkeypatch.setattr("critflow.engine.dask_workers._WORKERS_START", 1.0)
    with LocalCluster(n_workers=0, scheduler_kwargs=NO_DASHBOARD) as cluster:
        more = ("--scheduler", cluster.scheduler_address, "--insecure")
        assert "no worker" in output_of(tmp_path / "out", workers=None, more=more, study="algebra", code=6).err


def test_more_tasks_are_submitted_where_the_scheduler_has_more_threads(monkeypatch):
    """Twice its threads, at least a thousand."""
    monkeypatch.setattr(dask_workers, "_LOOK", 0.0)
    nodes = {"first": 32}
    wanted = dask_workers._tasks_wanted(SimpleNamespace(nthreads=lambda callback_timeout: nodes), "tls://head")
    assert next(wanted) == 1000
    nodes |= {f"node {n}": 32 for n in range(99)}
    assert next(wanted) == 6400


@pytest.mark.parametrize(
    ("error", "words"), [(OSError("Timed out trying to connect"), "ended"), (TimeoutError(), "does not answer")]
)
def test_a_scheduler_that_ends_while_it_is_asked_is_reported(error, words):
    def nthreads(callback_timeout):
        raise error

    with pytest.raises(EnvironmentFailure, match=f"the scheduler {words}: .*again"):
        next(dask_workers._tasks_wanted(SimpleNamespace(nthreads=nthreads), "tls://head"))


def test_an_interrupt_after_the_end_of_the_scheduler_reports_that_end(monkeypatch):
    """Which tasks are idle is then unknown, and nothing is there to cancel them."""

    gone, workers = OSError("Timed out trying to connect"), {"worker": 1}
    client = Mock(nthreads=Mock(side_effect=[workers, workers, gone]), processing=Mock(side_effect=gone))
    monkeypatch.setattr(dask_workers, "_LOOK", 0.0)
    monkeypatch.setattr(dask_workers, "_scheduler_client", lambda _: nullcontext(client))
    monkeypatch.setattr(dask_workers, "as_completed", lambda *_, **__: Mock(next_batch=lambda block: []))
    stopped = threading.Event()
    outcomes = dask_workers.compute_in_workers(None, [[]], Workers(1, scheduler="tls://head"), stopped)
    assert next(outcomes) == [] and client.submit.call_count == 1
    stopped.set()
    with pytest.raises(EnvironmentFailure, match=r"the scheduler ended: .*again"):
        next(outcomes)
    assert client.processing.called


PAGE = Path(__file__).parents[2] / "docs" / "command.md"


class Jobs(LocalCluster):
    """In place of a batch system: jobs that are processes of this machine."""

    def __init__(self, *, protocol, security, cores, processes, scheduler_options, **node):
        assert cores == processes  # a worker computes one case at a time
        assert {*node} == {"memory", "interface", "walltime", "queue", "shared_temp_directory"}
        options = {"scheduler_kwargs": NO_DASHBOARD | scheduler_options, "host": "127.0.0.1"}
        super().__init__(n_workers=0, threads_per_worker=1, protocol=protocol, security=security, **options)

    def adapt(self, minimum_jobs, maximum_jobs):
        assert minimum_jobs == maximum_jobs
        self.scale(2)


def test_the_program_of_the_page_on_batch_systems_gives_the_same_bits(tmp_path, run, forked, monkeypatch):
    (program,) = re.findall(r"```text\n(import dask\n.*?)```", PAGE.read_text(), re.S)
    assert program.count('"ensemble"') == 1
    study = Path(__file__).with_name("algebra_study.py")
    program = program.replace('"ensemble"', f'"{study}", "--out={tmp_path / "out"}"')
    monkeypatch.setitem(sys.modules, "dask_jobqueue", SimpleNamespace(SLURMCluster=Jobs))
    with dask.config.set({"distributed.comm.tls": deepcopy(dask.config.get("distributed.comm.tls"))}):
        exec(program, {})
    assert run(tmp_path / "serial", study="algebra") == 0
    assert numbers_of(tmp_path / "out") == numbers_of(tmp_path / "serial")
    assert "in a dask scheduler" in xr.load_dataset(tmp_path / "out" / "algebra.nc").attrs["history"]


def answer(page):
    try:
        with urlopen(page, timeout=0.5) as response:
            return str(response.status)
    except HTTPError as error:
        return str(error.code)
    except (OSError, HTTPException):
        return "none"


def accepts_a_stranger(port):
    """Whether a TLS connection without the certificate of the run receives anything."""
    context = ssl.create_default_context()
    context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
    with socket.create_connection(("127.0.0.1", port), timeout=1) as plain:
        try:
            with context.wrap_socket(plain) as encrypted:
                return bool(encrypted.recv(1))
        except OSError:  # "certificate required", or no TLS at all
            return False


@pytest.mark.sweep
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL])
def test_a_local_run_listens_on_loopback_and_answers_nobody_without_its_key(tmp_path, start, number):
    """Another user of the machine reaches the ports, and gets neither a connection nor a page."""
    process = start(tmp_path, "seeds=0:60", workers=1, study="plain", environment={"CRITFLOW_TEST_PAUSE": "2"})
    wait_until(lambda: stored_files(tmp_path), lambda: process.poll() is None, process.communicate)
    command = psutil.Process(process.pid)
    found = listening([command, *command.children(recursive=True)])
    assert len(found) >= 2  # the scheduler and a worker at least
    assert {ip for ip, _ in found} == {"127.0.0.1"}
    pages = [f"http://127.0.0.1:{port}/{page}" for _, port in found for page in ("status", "health")]
    assert {answer(page) for page in pages} <= {"404", "none"}
    assert not [port for _, port in found if accepts_a_stranger(port)]
    family = command.children(recursive=True)
    for _ in range(2):  # the second one stops the workers at once
        process.send_signal(number)
        time.sleep(0.5)
    assert "Traceback" not in process.communicate()[1]
    assert process.returncode == {signal.SIGINT: 130, signal.SIGKILL: -9}[number]
    assert psutil.wait_procs(family, timeout=60)[1] == []  # no worker outlives the command


DASK = (sys.executable, "-m", "dask")


@pytest.fixture
def remote(tmp_path):
    """A scheduler and its only worker, processes of their own: the address, and the two processes by name."""
    file, options = tmp_path / "scheduler.json", {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    words = ("--host=127.0.0.1", "--port=0", "--no-dashboard", "--no-show", f"--scheduler-file={file}")
    processes = {"scheduler": subprocess.Popen([*DASK, "scheduler", *words], **options)}
    wait_until(file.exists, lambda: processes["scheduler"].poll() is None)
    words = (f"--scheduler-file={file}", "--nthreads=1", "--no-nanny", "--no-dashboard")
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(path for path in sys.path if path)}
    environment["CRITFLOW_TEST_PAUSE"] = "0.1"
    processes["worker"] = subprocess.Popen([*DASK, "worker", *words], **options, env=environment)
    address = json.loads(file.read_text())["address"]
    with Client(address, set_as_default=False) as client:
        client.wait_for_workers(1, timeout=100)  # which takes seconds to start
    yield address, processes
    for process in processes.values():
        process.kill()
        process.wait()


@pytest.mark.parametrize(
    ("dead", "words"),
    [("scheduler", "scheduler ended"), pytest.param("worker", "no worker for", marks=pytest.mark.sweep)],
)
def test_a_scheduler_or_its_last_worker_that_dies_ends_the_run_in_one_sentence(tmp_path, remote, dead, words):
    address, processes = remote
    more = ("seeds=0:200",)
    run = begun(tmp_path / "out", more, workers=None, options=("--scheduler", address, "--insecure"), prepare=impatient)
    wait_until(lambda: stored_files(tmp_path / "out"), run.is_alive, lambda: messages(tmp_path / "out"))
    processes[dead].kill()
    assert ended(run, 60.0) == 6, messages(tmp_path / "out")
    first, last = messages(tmp_path / "out").strip().splitlines()
    assert first.startswith("plain: 200 seeds")
    assert words in last and "same command again" in last
    done = stored_whole(tmp_path / "out", more)
    # A worker that has lost its scheduler ends its case.
    assert any(f"{number} of 200 cases are complete" in last for number in (len(done), len(done) - 1))


def impatient():
    """In the process of a run: workers that are gone for two seconds do not come back."""
    dask_workers._WORKERS_START = 2.0
