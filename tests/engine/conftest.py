"""Runs of the small studies, and comparison of the folders that they write."""

import os
import subprocess
import sys
from pathlib import Path

import dask.config
import pytest
from disturbed import server, words_of

from critflow.command.main import main
from critflow.engine.code_digest import load_file

HERE = Path(__file__).parent
COMMAND = "import sys; from critflow.command.main import main; sys.exit(main())"


@pytest.fixture(scope="module", autouse=True)
def quick(request):
    """Pictures are drawn in the tests of reports only."""
    if request.module.__name__ != "test_report":
        request.getfixturevalue("undrawn")


@pytest.fixture
def forked():
    """Local worker processes are forked from one that has loaded all libraries, not spawned as for users."""
    server()
    with dask.config.set({"distributed.worker.multiprocessing-method": "forkserver"}):
        yield


@pytest.fixture
def tiny():
    """The loaded tiny study."""
    return load_file(HERE / "tiny_study.py")


@pytest.fixture
def source(tmp_path):
    """`source(old, new, ...)` writes a copy of the tiny study with replacements, and returns its path."""

    def write(*changes, study="tiny"):
        text = (HERE / f"{study}_study.py").read_text()
        for old, new in zip(changes[::2], changes[1::2], strict=True):
            assert old in text
            text = text.replace(old, new)
        path = tmp_path / "source" / f"{study}.py"
        path.parent.mkdir(exist_ok=True)
        path.write_text(text)
        return path

    return write


def _words(folder, settings, workers, more, study):
    path = study if isinstance(study, Path) else HERE / f"{study}_study.py"
    return [*words_of(folder, settings, workers, path), *more]


@pytest.fixture
def run(tiny, monkeypatch):
    """`run(folder, *settings)` runs a study in this process and returns the exit code. Pauses are left out."""
    monkeypatch.setitem(tiny.study.case.__globals__, "sleep", lambda seconds: None)

    def command(folder, *settings, workers=0, more=(), study="tiny"):
        return main(_words(folder, settings, workers, more, study))

    return command


@pytest.fixture
def output_of(run, said):
    """`output_of(folder, *settings)` is `run`, and returns what it wrote; `code` is its exit code."""

    def command(folder, *settings, code=0, workers=0, more=(), study="tiny"):
        return said(_words(folder, settings, workers, more, study), code)

    return command


@pytest.fixture
def start():
    """`start(folder, *settings)` starts a run as a command in a process group."""
    started = []

    def command(folder, *settings, workers=0, more=(), study="tiny", environment=None, **options):
        words = [sys.executable, "-c", COMMAND, *_words(folder, settings, workers, more, study)]
        pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True, "start_new_session": True}
        options |= {"env": os.environ | (environment or {})}
        started.append(subprocess.Popen(words, **(pipes | options)))
        return started[-1]

    yield command
    for process in started:
        process.kill()
        process.communicate()


@pytest.fixture
def tally(tmp_path, monkeypatch):
    """`tally()` lists the seeds of the plain study that were computed since the last call."""
    path = tmp_path / "tally.txt"
    monkeypatch.setenv("CRITFLOW_TEST_TALLY", str(path))

    def read():
        seeds = [int(line) for line in path.read_text().split()] if path.exists() else []
        path.unlink(missing_ok=True)
        return seeds

    return read
