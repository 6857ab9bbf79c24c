"""Clusters: a scheduler with and without certificates, the program for batch systems, and who can reach a run."""

import json
import os
import re
import signal
import socket
import ssl
import subprocess
import sys
import time
from contextlib import suppress
from copy import deepcopy
from http.client import HTTPException
from pathlib import Path
from types import SimpleNamespace
from urllib.error import HTTPError
from urllib.request import urlopen

import dask.config
import psutil
import pytest
import xarray as xr
from distributed import LocalCluster
from distributed.security import Security
from disturbed import begun, ended, messages, numbers_of, stored_whole
from problems import forbidden

from critflow.engine import dask_workers

NO_DASHBOARD = {"dashboard": False, "dashboard_address": "127.0.0.1:0"}

pytestmark = pytest.mark.timeout(300)


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


def test_a_plain_scheduler_needs_a_flag_and_equal_libraries(tmp_path, run, capsys, forked):
    options = {"n_workers": 1, "threads_per_worker": 1, "preload": OTHER_LIBRARY}
    with LocalCluster(scheduler_kwargs=NO_DASHBOARD, **options) as cluster:
        address = cluster.scheduler_address
        for word in (address, address.removeprefix("tcp://")):
            assert run(tmp_path / "out", workers=None, more=("--scheduler", word), study="algebra") == 2
            assert "--insecure" in capsys.readouterr().err
        assert not (tmp_path / "out").exists()
        more = ("--scheduler", address, "--insecure")
        assert run(tmp_path / "out", workers=None, more=more, study="algebra") == 6
        assert "scipy 0.1" in capsys.readouterr().err
    assert not list((tmp_path / "out" / "shards").glob("*.nc"))


def test_a_scheduler_without_workers_is_reported(tmp_path, run, capsys, monkeypatch):
    monkeypatch.setattr("critflow.engine.dask_workers._WORKERS_START", 1.0)
    with LocalCluster(n_workers=0, scheduler_kwargs=NO_DASHBOARD) as cluster:
        more = ("--scheduler", cluster.scheduler_address, "--insecure")
        assert run(tmp_path / "out", workers=None, more=more, study="algebra") == 6
    assert "no worker" in capsys.readouterr().err


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


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL])
def test_a_local_run_listens_on_loopback_and_answers_nobody_without_its_key(tmp_path, start, number):
    """Another user of the machine reaches the ports, and gets neither a connection nor a page."""
    process = start(tmp_path, "seeds=0:60", workers=1, study="plain", environment={"CRITFLOW_TEST_PAUSE": "2"})
    while not list((tmp_path / "shards").glob("*.nc")):
        assert process.poll() is None, process.communicate()
        time.sleep(0.05)
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
    while not file.exists():
        assert processes["scheduler"].poll() is None
        time.sleep(0.05)
    words = (f"--scheduler-file={file}", "--nthreads=1", "--no-nanny", "--no-dashboard")
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(path for path in sys.path if path)}
    environment["CRITFLOW_TEST_PAUSE"] = "0.1"
    processes["worker"] = subprocess.Popen([*DASK, "worker", *words], **options, env=environment)
    yield json.loads(file.read_text())["address"], processes
    for process in processes.values():
        process.kill()
        process.wait()


@pytest.mark.parametrize(("dead", "words"), [("scheduler", "scheduler ended"), ("worker", "no worker for")])
def test_a_scheduler_or_its_last_worker_that_dies_ends_the_run_in_one_sentence(tmp_path, remote, dead, words):
    address, processes = remote
    more = ("seeds=0:200",)
    run = begun(tmp_path / "out", more, workers=None, options=("--scheduler", address, "--insecure"), prepare=impatient)
    while not list((tmp_path / "out" / "shards").glob("*.nc")):
        assert run.is_alive(), messages(tmp_path / "out")
        time.sleep(0.05)
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
