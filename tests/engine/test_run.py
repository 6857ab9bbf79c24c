"""Whole runs: the dataset depends on the selection only, through every disturbance of the run."""

import os
import signal
import time
from pathlib import Path

import psutil
import pytest
import xarray as xr
from disturbed import begun, contents_of, ended, messages, numbers_of, stored_files, stored_whole, wait_until, words_of
from threadpoolctl import threadpool_info, threadpool_limits

from critflow.command.main import main
from critflow.engine import tasks
from critflow.engine.code_digest import load_file
from critflow.engine.settings import select
from critflow.engine.store import Folder
from critflow.engine.tasks import Job
from critflow.result import StudyError


@pytest.fixture(scope="module")
def serial(tmp_path_factory):
    """The folder of an undisturbed run of the algebra study in one process."""
    folder = tmp_path_factory.mktemp("serial")
    study = Path(__file__).with_name("algebra_study.py")
    # Another test in this process may have left a connection open.
    sockets = len(psutil.Process().net_connections("inet"))
    with threadpool_limits(limits=2):
        assert {library["num_threads"] for library in threadpool_info()} == {2}
        assert main(["run", str(study), "--out", str(folder), "--workers=0"]) == 0
    with xr.load_dataset(folder / "algebra.nc") as ds:
        assert (ds.threads == 1).all()
        assert (ds.sockets <= sockets).all()  # none without worker processes
    return folder


@pytest.mark.timeout(300)
@pytest.mark.parametrize("workers", [2, pytest.param(3, marks=pytest.mark.sweep)])
def test_any_number_of_workers_gives_the_same_bytes(tmp_path, run, serial, workers, monkeypatch, request):
    """The whole dataset, and in each worker one thread for the numerical libraries."""
    if workers == 3:
        request.getfixturevalue("forked")
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "2")
    assert run(tmp_path, workers=workers, study="algebra") == 0
    assert numbers_of(tmp_path) == numbers_of(serial)
    assert (xr.load_dataset(tmp_path / "algebra.nc").threads == 1).all()
    assert os.environ["OPENBLAS_NUM_THREADS"] == "2"


def test_two_runs_differ_in_the_listed_attributes_only(tmp_path, run, monkeypatch):
    """Stored cases agree to the last byte; datasets agree in everything but `history`."""
    assert run(tmp_path / "one") == 0
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "1000000000")
    assert run(tmp_path / "two", "seeds=0:4") == 0
    one, two = (tmp_path / name for name in ("one", "two"))
    assert contents_of(one / "tiny.nc") == contents_of(two / "tiny.nc")
    stored = [[p.read_bytes() for p in sorted((folder / "shards").iterdir())] for folder in (one, two)]
    assert stored[0] == stored[1]
    attributes = [xr.load_dataset(folder / "tiny.nc").attrs for folder in (one, two)]
    assert attributes[0]["volatile_attributes"] == "history"
    assert [name for name in attributes[0] if attributes[0][name] != attributes[1][name]] == ["history"]
    assert attributes[1]["history"].startswith("2001-09-09T01:46:40Z critflow run")


def test_a_finished_run_only_writes_what_is_missing_of_its_results(tmp_path, tally):
    words = words_of(tmp_path)
    assert main(words) == 0
    whole, log = contents_of(tmp_path / "plain.nc"), (tmp_path / "run.log").read_text()
    tally()
    for name in ("plain.nc", "claims.md", "claims.json", "summary.json"):
        (tmp_path / name).unlink()
    assert main([*words_of(tmp_path)[:-1], "--workers=2"]) == 0
    assert tally() == []
    assert contents_of(tmp_path / "plain.nc") == whole
    assert (tmp_path / "claims.md").exists() and (tmp_path / "summary.json").exists()
    assert sum(line.startswith("seed") for line in log.splitlines()) == 4
    assert sum(line.startswith("seed") for line in (tmp_path / "run.log").read_text().splitlines()) == 4


def hurry():
    """In the process of a run: a minute is over at once."""
    tasks._MINUTE = 0.0


SLOW = {"CRITFLOW_TEST_PAUSE": "0.4"}


def test_an_interrupted_task_begins_no_further_case_and_stores_the_others(tmp_path):
    """The cases of one seed are one task, and one shard."""
    folder, path = tmp_path / "out", Path(__file__).with_name("algebra_study.py")
    process = begun(folder, ["seeds=0"], study=path, environment=SLOW)
    wait_until(lambda: "one process" in messages(folder), process.is_alive)
    time.sleep(0.6)  # in the second case
    os.kill(process.pid, signal.SIGINT)
    assert ended(process) == 130, messages(folder)
    study = load_file(path).study
    done = [one.state for one in Folder(folder).states(select(study, ["seeds=0"]))]
    assert done[0] == "done" and done[-1] == "missing"


def test_a_case_that_is_stopped_at_once_does_not_lose_those_before_it(tmp_path, run, source):
    """Ctrl-C in the second case of a network, in the process of the run."""
    stop = '    if part == "right":\n        raise KeyboardInterrupt\n    matrix = stable_rng'
    path = source("    matrix = stable_rng", stop, study="algebra")
    assert run(tmp_path / "out", "seeds=0", study=path) == 130
    states = Folder(tmp_path / "out").states(select(load_file(path).study, ["seeds=0"]))
    assert [one.state for one in states] == ["done", "missing", "missing"]


def test_a_long_task_is_stored_while_it_lasts(tmp_path, run):
    """Its last case ends the process; the cases before it are complete."""
    folder = tmp_path / "out"
    process = begun(
        folder, ["seeds=0"], study=Path(__file__).with_name("algebra_study.py"), environment=SLOW, prepare=hurry
    )
    wait_until(lambda: stored_files(folder), process.is_alive)
    os.kill(process.pid, signal.SIGKILL)
    assert ended(process) == -9
    assert run(folder, "seeds=0", study="algebra") == 0
    lines = [line for line in (folder / "run.log").read_text().splitlines() if line.startswith("seed")]
    assert 1 <= len(lines) <= 2  # of three cases, those that were not stored


@pytest.mark.sweep
@pytest.mark.timeout(300)
def test_an_interrupted_run_with_workers_stores_the_running_cases(tmp_path, start, tally):
    """The Ctrl-C of a terminal reaches the workers too; the number of stored cases in the message is true."""
    settings = ("seeds=0:20",)
    process = start(tmp_path, *settings, workers=2, study="plain", environment=SLOW)
    wait_until(lambda: stored_files(tmp_path), lambda: process.poll() is None)
    os.killpg(process.pid, signal.SIGINT)
    out, err = process.communicate()
    assert (process.returncode, out) == (130, "") and "Traceback" not in err
    (line,) = [line for line in err.splitlines() if line.startswith("critflow:")]
    done = stored_whole(tmp_path, settings)
    assert 1 <= len(done) < 20 and f"{len(done)} of 20" in line and "same command" in line
    tally()
    assert main(words_of(tmp_path, settings)) == 0
    assert len(tally()) == 20 - len(done)


def test_a_second_interrupt_stops_at_once(tmp_path):
    folder = tmp_path / "out"
    process = begun(folder, environment={"CRITFLOW_TEST_PAUSE": "200"})
    for words in ("one process", "stopping"):
        wait_until(lambda: words in messages(folder), process.is_alive)  # noqa: B023
        time.sleep(0.1)
        os.kill(process.pid, signal.SIGINT)
    assert ended(process, 30.0) == 130
    assert "Traceback" not in messages(folder)


def test_a_study_file_that_changed_since_the_run_began_is_refused(tmp_path, source):
    path = source(study="plain")
    job = Job(str(path), load_file(path).digest, str(tmp_path), {}, (), (), "")
    assert job.selection().study.name == "plain"
    path.write_text(path.read_text() + "# changed")
    with pytest.raises(StudyError, match="changed"):
        job.selection()
