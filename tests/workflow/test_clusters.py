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
from distributed import Future, LocalCluster
from distributed.security import Security

from critflow.cli import main
from critflow.workflow import jobs
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


@pytest.mark.parametrize(("failures", "code"), [(1, 0), (2, 6)])
def test_workers_that_do_not_start_get_a_second_chance(tmp_path, capsys, monkeypatch, failures, code):
    attempts = []

    def start(**options):
        attempts.append(options)
        if len(attempts) <= failures:
            raise RuntimeError("a nanny lost its worker")
        return LocalCluster(**options)

    monkeypatch.setattr("critflow.workflow.clusters.LocalCluster", start)
    assert run(tmp_path, "--workers", "3", "--set", "seeds=0") == code  # one batch: more than one would have no work
    assert ("cannot start 1 worker processes (a nanny lost its worker)" in capsys.readouterr().err) == (code == 6)


def test_a_result_that_went_with_its_worker_is_waited_for_while_the_run_looks_on(tmp_path, right, monkeypatch):
    """Its task runs again when there are workers, for which the run itself may have to see."""
    lost, result = [], Future.result

    def first_lost(future, timeout=None):
        assert timeout is not None
        if not lost:
            lost.append(future)
            raise TimeoutError
        return result(future, timeout)

    monkeypatch.setattr("critflow.workflow.fanout.Future.result", first_lost)
    assert run(tmp_path, "--workers", "1") == 0
    assert lost
    assert bits(tmp_path) == right


STRANGERS = {  # what a worker has, as code that it runs when it starts: what the command says about it
    "no critflow": (
        """
import importlib.metadata, sys
def version(name, found=importlib.metadata.version):
    if name == "critflow":
        raise importlib.metadata.PackageNotFoundError(name)
    return found(name)
importlib.metadata.version = version
sys.modules["critflow"] = None
""",
        "a worker has no critflow: install it in the Python of all workers",
    ),
    "another scipy": (
        """
import importlib.metadata
def version(name, found=importlib.metadata.version):
    return "0.1" if name == "scipy" else found(name)
importlib.metadata.version = version
""",
        "has scipy 0.1 (not",
    ),
}


@pytest.mark.parametrize("stranger", STRANGERS)
def test_a_worker_that_would_compute_something_else_is_refused(tmp_path, capsys, stranger):
    code, sentence = STRANGERS[stranger]
    with LocalCluster(n_workers=1, threads_per_worker=1, scheduler_kwargs=NO_DASHBOARD, preload=code) as cluster:
        assert run(tmp_path, "--scheduler", cluster.scheduler_address, "--insecure") == 6
    assert sentence in capsys.readouterr().err
    assert not list(tmp_path.glob("shards/*.nc"))


@pytest.fixture
def trial(tmp_path):
    """`trial(*words)` runs on jobs that are processes of this machine, as a command with a session of its own.

    It gives what was said, and the addresses at which anything of it listened.  dask-jobqueue's local jobs leave files
    and processes to the end of their interpreter.
    """
    file = tmp_path / "profiles.toml"
    file.write_text('[trial]\nsystem = "local"\njobs = 2\nworkers = 1\nmemory = "2GB"\nwait = 200')
    started = []

    def command(*words, interrupted=False):
        code = "import sys; from critflow.cli import main; sys.exit(main())"
        known = ["run", str(ALGEBRA), "--out", str(tmp_path / "out"), "--profile", "trial", "--profiles", str(file)]
        pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True, "start_new_session": True}
        started.append(subprocess.Popen([sys.executable, "-c", code, *known, *words], **pipes))
        heard, expected = set(), 130 if interrupted else 0
        while started[-1].poll() is None:
            if interrupted and list(tmp_path.glob("out/shards/*.nc")):
                started[-1].send_signal(signal.SIGINT)
                interrupted = False
            heard |= listening(family(started[-1].pid))
            time.sleep(0.3)
        _, err = started[-1].communicate(timeout=10)
        assert started[-1].returncode == expected, err
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


def test_ctrl_c_lets_jobs_finish_what_runs(tmp_path, trial):
    """In a process of its own, where dask-jobqueue is imported for the first time."""
    assert "interrupted with" in trial("--set", "pause=0.5", interrupted=True)[0]
    assert not list(tmp_path.rglob(".keys*"))


def test_a_library_that_is_not_there_is_told(tmp_path, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "dask_jobqueue.local", None)
    file = tmp_path / "profiles.toml"
    file.write_text('[trial]\nsystem = "local"\nworkers = 1\nmemory = "1GB"')
    assert run(tmp_path / "out", "--profile", "trial", "--profiles", str(file)) == 6
    assert "pip install dask-jobqueue" in capsys.readouterr().err


def test_a_bad_job_is_told_and_not_submitted(tmp_path, capsys):
    file = tmp_path / "profiles.toml"
    file.write_text('[trial]\nsystem = "local"\nworkers = 1\nmemory = "many"')
    assert run(tmp_path / "out", "--profile", "trial", "--profiles", str(file)) == 6
    assert "mend the profile" in capsys.readouterr().err


@pytest.fixture
def slurm(tmp_path, monkeypatch):
    """`slurm(lines)` runs on two jobs of a SLURM that is played by two commands; `slurm.jobs()` are the submitted."""
    begun, loopback = tmp_path / "begun", interface_of("127.0.0.1")
    begun.touch()
    script = f"""case $0 in
        *scancel) kill -KILL -- -"$1" ;;
        *) test -e {tmp_path}/refused && {{ echo "sbatch: error: no such partition" >&2; exit 1; }}
           cp "$1" {tmp_path}/job-$$
           setsid bash {tmp_path}/job-$$ >> {tmp_path}/job-$$.log 2>&1 &
           echo $! >> {begun}
           echo "Submitted batch job $!" ;;
    esac"""
    for name in ("sbatch", "scancel"):
        (tmp_path / name).write_text(f"#!/bin/bash\n{script}\n")
        (tmp_path / name).chmod(0o700)
    monkeypatch.setenv("PATH", str(tmp_path), prepend=os.pathsep)
    monkeypatch.setattr(jobs, "PATIENCE", 1.0)

    def command(lines="", *words):
        keys = f'jobs = 2\nworkers = 1\nmemory = "2GB"\ninterface = "{loopback}"\nwait = 60\n{lines}'
        (tmp_path / "profiles.toml").write_text(f'[hall]\nsystem = "slurm"\n{keys}')
        return run(tmp_path / "out", "--profile", "hall", "--profiles", str(tmp_path / "profiles.toml"), *words)

    command.jobs = lambda: [int(line) for line in begun.read_text().split()]
    yield command
    for job in command.jobs():
        end(job)
    assert not list(tmp_path.rglob(".keys*"))  # none is left behind


def interface_of(address):
    known = psutil.net_if_addrs().items()
    return next(name for name, ones in known if any(one.address == address for one in ones))


def end(job):
    """All processes of a job, in the way of a machine that goes away."""
    processes = family(job)
    for process in processes:
        process.kill()
    psutil.wait_procs(processes, timeout=10)


def test_jobs_that_end_are_submitted_again(tmp_path, right, slurm):
    """Both at once, as when their time is up."""

    def expire():
        while len(list(tmp_path.glob("out/shards/*.nc"))) < 3:
            time.sleep(0.01)
        for job in slurm.jobs():
            end(job)

    killer = threading.Thread(target=expire, daemon=True)
    killer.start()
    assert slurm("", "--set", "pause=0.3") == 0
    killer.join(timeout=10)
    assert len(slurm.jobs()) > 2
    assert bits(tmp_path / "out") == right


def test_jobs_that_cannot_begin_are_not_submitted_for_ever(tmp_path, slurm, capsys):
    assert slurm('job_script_prologue = ["exit 3"]') == 6
    error = capsys.readouterr().err
    assert "exit code 3" in error
    assert str(tmp_path / "out" / "jobs") in error
    assert len(slurm.jobs()) == 2


def test_what_a_batch_system_refuses_is_told_in_its_words(tmp_path, slurm, capsys):
    (tmp_path / "refused").touch()
    assert slurm() == 6
    assert "can be submitted: no such partition" in capsys.readouterr().err


def test_a_machine_without_the_batch_system_is_named(slurm, monkeypatch, capsys):
    monkeypatch.setenv("PATH", "")
    assert slurm() == 6
    assert "there is no sbatch here" in capsys.readouterr().err


def test_a_folder_with_a_blank_is_refused_before_a_job_is(tmp_path, slurm, capsys):
    assert slurm("", "--out", str(tmp_path / "my results")) == 2
    assert "has a blank in it" in capsys.readouterr().err
    assert not slurm.jobs()


SYSTEMS = {
    "slurm": (
        'queue = "short"\nwalltime = "01:00:00"\njob_script_prologue = ["module load all"]',
        ("#SBATCH -p short", "#SBATCH -t 01:00:00", "module load all", "--no-dashboard", "/logs/critflow-%J.out"),
    ),
    "pbs": ('queue = "short"\nresource_spec = "select=1"', ("#PBS -q short", "#PBS -l select=1")),
    "htcondor": (
        'disk = "1GB"\njob_extra_directives = [\'+JobFlavour = "workday"\']',
        ("RequestCpus = MY.DaskWorkerCores", '+JobFlavour = "workday"'),
    ),
}


@pytest.mark.parametrize("system", SYSTEMS)
def test_the_job_script_of_a_batch_system_says_what_its_profile_says(tmp_path, system):
    """As far as it goes without the batch system: workers of one thread, over TLS, with keys in files."""
    keys, lines = SYSTEMS[system]
    file = tmp_path / "profiles.toml"
    file.write_text(f'[hall]\nsystem = "{system}"\njobs = 2\nworkers = 3\nmemory = "6GB"\n{keys}')
    (tmp_path / ".keys-left").mkdir()  # of a run that was killed
    with _credentials(tmp_path) as (security, _):
        assert not (tmp_path / ".keys-left").exists()
        options = job_options(read_profile("hall", file), security, {}, tmp_path / "logs")
        script = jobs_class(system).job_cls("tls://head:1", "hall", **options).job_script()
        files = list(tmp_path.glob(".keys-*/*"))
        assert {stat.S_IMODE(path.stat().st_mode) for path in files} == {0o600}
        assert {stat.S_IMODE(path.parent.stat().st_mode) for path in files} == {0o700}
    for line in (*lines, "--nthreads 1", "--nworkers 3", "--protocol tls://", "--tls-key", "export OMP_NUM_THREADS=1"):
        assert line in script
    assert not files[0].exists()
