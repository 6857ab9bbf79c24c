"""Runs on clusters: a scheduler with certificates, workers that die, jobs of dask-jobqueue."""

import os
import signal
import stat
import subprocess
import sys
import threading
import time
from contextlib import suppress
from pathlib import Path

import psutil
import pytest
import xarray as xr
from distributed import LocalCluster
from distributed.security import Security

from critflow.cli import main
from critflow.workflow.clusters import NO_DASHBOARD, _credentials, client_of, job_options, jobs_class
from critflow.workflow.errors import Interrupted
from critflow.workflow.limits import Limits
from critflow.workflow.profiles import Cluster, read_profile

ALGEBRA = Path(__file__).with_name("algebra_study.py")
NUMBERS = ("product", "solution", "eigenvalues", "status")

pytestmark = pytest.mark.timeout(300)


def run(folder, *words):
    return main(["run", str(ALGEBRA), "--out", str(folder), *words])


def bits(folder):
    with xr.open_dataset(folder / "algebra.nc") as ds:
        return {name: (ds[name].dims, ds[name].values.tobytes()) for name in NUMBERS}


@pytest.fixture(scope="module")
def right(tmp_path_factory):
    """The numbers of a run in one process."""
    folder = tmp_path_factory.mktemp("right")
    assert run(folder, "--workers", "0") == 0
    return bits(folder)


@pytest.fixture(scope="module")
def campus(tmp_path_factory):
    """A cluster of three worker processes that somebody else runs, with certificates, and a profile for it."""
    folder = tmp_path_factory.mktemp("campus")
    security = Security.temporary()
    words = {"ca_file": security.tls_ca_file, "cert": security.tls_client_cert, "key": security.tls_client_key}
    for name, text in words.items():
        (folder / name).write_text(text)
    options = {"protocol": "tls://", "security": security, "scheduler_kwargs": NO_DASHBOARD}
    with LocalCluster(n_workers=3, threads_per_worker=1, **options) as cluster:
        lines = [f'{key} = "{key}"' for key in words]
        text = ["[campus]", 'system = "scheduler"', f'address = "{cluster.scheduler_address}"', *lines]
        (folder / "profiles.toml").write_text("\n".join(text))
        yield cluster, folder / "profiles.toml"


def test_a_scheduler_with_certificates_gives_the_same_bits(tmp_path, right, campus):
    assert run(tmp_path, "--profile", "campus", "--profiles", str(campus[1])) == 0
    assert bits(tmp_path) == right


def test_workers_killed_one_after_another_change_no_bit(tmp_path, right, campus):
    """Each worker once, as soon as the first shards are there."""
    cluster, profiles = campus
    victims = [nanny.pid for nanny in cluster.workers.values()]

    def kill():
        for number, victim in enumerate(victims):
            while len(list(tmp_path.glob("shards/*.nc"))) < 1 + 3 * number:
                time.sleep(0.01)
            os.kill(victim, signal.SIGKILL)

    killer = threading.Thread(target=kill, daemon=True)
    killer.start()
    assert run(tmp_path, "--profile", "campus", "--profiles", str(profiles), "--set", "pause=0.2") == 0
    killer.join()
    while any(psutil.pid_exists(victim) for victim in victims):  # their nannies tidy up
        time.sleep(0.05)
    assert bits(tmp_path) == right


def test_without_workers_a_scheduler_is_no_cluster(tmp_path, capsys):
    with LocalCluster(n_workers=0, scheduler_kwargs=NO_DASHBOARD) as cluster:
        text = f'[empty]\nsystem = "scheduler"\naddress = "{cluster.scheduler_address}"\nwait = 1'
        (tmp_path / "profiles.toml").write_text(text)
        words = ("--profile", "empty", "--profiles", str(tmp_path / "profiles.toml"), "--insecure")
        assert run(tmp_path / "out", *words) == 6
        assert "start some" in capsys.readouterr().err
        elsewhere = Cluster("scheduler", address=cluster.scheduler_address, wait=1000)
        with pytest.raises(Interrupted), client_of(elsewhere, 0, Limits(), tmp_path, lambda: True):
            pass


@pytest.fixture
def trial(tmp_path):
    """`trial(*words)` runs on jobs that are processes of this machine, as a command with a session of its own.

    It gives what was said, and the addresses at which anything of it listened.  dask-jobqueue's local jobs leave files
    and processes to the end of their interpreter.
    """
    pytest.importorskip("dask_jobqueue", reason="batch systems need the extra `cluster`")
    file = tmp_path / "profiles.toml"
    file.write_text('[trial]\nsystem = "local"\njobs = 2\nworkers = 1\nmemory = "2GB"\nwait = 200')
    started = []

    def command(*words):
        code = "import sys; from critflow.cli import main; sys.exit(main())"
        known = ["run", str(ALGEBRA), "--out", str(tmp_path / "out"), "--profile", "trial", "--profiles", str(file)]
        pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True, "start_new_session": True}
        started.append(subprocess.Popen([sys.executable, "-c", code, *known, *words], **pipes))
        heard = set()
        while started[-1].poll() is None:
            heard |= listening(family(started[-1].pid))
            time.sleep(0.3)
        _, err = started[-1].communicate(timeout=10)
        assert started[-1].returncode == 0, err
        return err, heard

    yield command
    for process in started:
        process.kill()
        assert psutil.wait_procs(family(process.pid), timeout=60)[1] == []  # no job outlives the command


def family(leader):
    """All processes of a session."""

    def session(process):
        try:
            return os.getsid(process.pid)
        except ProcessLookupError:
            return None

    return [one for one in psutil.process_iter() if session(one) == leader]


def listening(processes):
    found = set()
    for process in processes:
        with suppress(psutil.Error):  # it has gone
            found |= {end.laddr.ip for end in process.net_connections("inet") if end.status == psutil.CONN_LISTEN}
    return found


def test_jobs_of_a_batch_system_give_the_same_bits_though_a_worker_dies(tmp_path, right, trial):
    """One case kills its worker; the nanny of its job starts another."""
    once = tmp_path / "once"
    once.mkdir()
    for seed in range(6):  # all but one have had their turn
        for part in ("left", "right"):
            (once / f"{seed}-{part}").touch()
    (once / "0-left").unlink()
    err, heard = trial("--set", f"once={once}")
    assert "2 × 1 workers of local profile 'trial'" in err
    assert heard == {"127.0.0.1"}
    assert (once / "0-left").exists()
    assert bits(tmp_path / "out") == right
    assert not list(tmp_path.rglob(".keys*"))  # none is left behind


def test_a_library_that_is_not_there_is_told(tmp_path, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "dask_jobqueue.local", None)
    file = tmp_path / "profiles.toml"
    file.write_text('[trial]\nsystem = "local"\nworkers = 1\nmemory = "1GB"')
    assert run(tmp_path / "out", "--profile", "trial", "--profiles", str(file)) == 6
    assert "pip install 'critflow[cluster]'" in capsys.readouterr().err


def test_a_bad_job_is_told_and_not_submitted(tmp_path, capsys):
    pytest.importorskip("dask_jobqueue", reason="batch systems need the extra `cluster`")
    file = tmp_path / "profiles.toml"
    file.write_text('[trial]\nsystem = "local"\nworkers = 1\nmemory = "many"')
    assert run(tmp_path / "out", "--profile", "trial", "--profiles", str(file)) == 6
    assert "mend the profile" in capsys.readouterr().err


SYSTEMS = {
    "slurm": (
        'queue = "short"\nwalltime = "01:00:00"\njob_script_prologue = ["module load all"]',
        ("#SBATCH -p short", "#SBATCH -t 01:00:00", "module load all", "--no-dashboard"),
    ),
    "pbs": ('queue = "short"\nresource_spec = "select=1"', ("#PBS -q short", "#PBS -l select=1")),
    "htcondor": ('disk = "1GB"', ("RequestCpus = MY.DaskWorkerCores",)),
}


@pytest.mark.parametrize("system", SYSTEMS)
def test_the_job_script_of_a_batch_system_says_what_its_profile_says(tmp_path, system):
    """As far as it goes without the batch system: workers of one thread, over TLS, with keys in files."""
    pytest.importorskip("dask_jobqueue", reason="batch systems need the extra `cluster`")
    keys, lines = SYSTEMS[system]
    file = tmp_path / "profiles.toml"
    file.write_text(f'[hall]\nsystem = "{system}"\njobs = 2\nworkers = 3\nmemory = "6GB"\n{keys}')
    (tmp_path / ".keys-left").mkdir()  # of a run that was killed
    with _credentials(tmp_path) as security:
        assert not (tmp_path / ".keys-left").exists()
        options = job_options(read_profile("hall", file), security)
        script = jobs_class(system).job_cls("tls://head:1", "hall", **options).job_script()
        files = list(tmp_path.glob(".keys-*/*"))
        assert {stat.S_IMODE(path.stat().st_mode) for path in files} == {0o600}
        assert {stat.S_IMODE(path.parent.stat().st_mode) for path in files} == {0o700}
    for line in (*lines, "--nthreads 1", "--nworkers 3", "--protocol tls://", "--tls-key", "export OMP_NUM_THREADS=1"):
        assert line in script
    assert not files[0].exists()
