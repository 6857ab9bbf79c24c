"""Closed by default: what a run listens on, and who gets an answer there."""

import json
import subprocess
import sys
from http.client import HTTPException
from pathlib import Path
from urllib.error import HTTPError
from urllib.request import urlopen

import psutil
import pytest
import xarray as xr
from distributed import Client
from distributed.security import Security

from critflow.cli import main
from critflow.workflow.clusters import client_of
from critflow.workflow.limits import Limits

ALGEBRA = Path(__file__).with_name("algebra_study.py")

LISTENED = """
import json, sys
events = []
sys.addaudithook(lambda name, args: events.append(name) if name.startswith("socket.") else None)
from critflow.cli import main
code = main(sys.argv[1:])
print(json.dumps([code, events]))
"""


@pytest.mark.timeout(300)
def test_no_worker_processes_open_no_socket(tmp_path):
    """Python itself reports every socket that is made; the cases look at those of their process."""
    words = ["run", str(ALGEBRA), "--out", str(tmp_path), "--workers", "0", "--set", "seeds=0:2"]
    done = subprocess.run([sys.executable, "-c", LISTENED, *words], capture_output=True, text=True, timeout=250)
    assert json.loads(done.stdout.splitlines()[-1]) == [0, []], done.stderr
    assert (xr.load_dataset(tmp_path / "algebra.nc").sockets == 0).all()


@pytest.fixture
def listening():
    """`listening()` is every address that this process and all it started listen on."""

    def look():
        family = [psutil.Process(), *psutil.Process().children(recursive=True)]
        ends = [end for process in family for end in process.net_connections("inet")]
        return {(end.laddr.ip, end.laddr.port) for end in ends if end.status == psutil.CONN_LISTEN}

    return look


@pytest.mark.timeout(300)
def test_local_workers_listen_here_alone_and_answer_no_stranger(tmp_path, listening):
    """Another user of this machine reaches the ports, and gets neither a connection nor a page."""
    with client_of(None, 2, Limits(), tmp_path, lambda: False) as (client, _):
        assert client.scheduler.address.startswith("tls://127.0.0.1:")
        found = listening()
        assert len(found) >= 3  # the scheduler and two workers at least
        assert {ip for ip, _ in found} == {"127.0.0.1"}
        assert client.run(lambda: None)  # who has the key is served
        pages = [f"http://127.0.0.1:{port}/{page}" for _, port in found for page in ("status", "health", "metrics")]
        assert {page for page in pages if said(page) not in ("404", "nothing")} == set()
        bare = client.scheduler.address.removeprefix("tls://")
        for address, key in ((f"tcp://{bare}", None), (f"tls://{bare}", Security.temporary())):
            with pytest.raises(OSError):
                Client(address, timeout=1, security=key, set_as_default=False)


def said(address):
    """The code of an answer to a browser, or that there was none."""
    try:
        with urlopen(address, timeout=2) as answer:
            return str(answer.status)
    except HTTPError as error:
        return str(error.code)
    except (OSError, HTTPException):
        return "nothing"


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:9", "127.0.0.1:9"])
def test_a_plain_scheduler_is_refused_without_the_flag(tmp_path, capsys, address):
    assert main(["run", str(ALGEBRA), "--out", str(tmp_path / "out"), "--scheduler", address]) == 2
    err = capsys.readouterr().err
    assert "--insecure" in err
    assert err.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_an_encrypted_scheduler_without_certificates_is_refused(tmp_path, capsys):
    assert main(["run", str(ALGEBRA), "--out", str(tmp_path / "out"), "--scheduler", "tls://127.0.0.1:9"]) == 2
    assert "needs certificates" in capsys.readouterr().err
