"""Runs of the tiny study, and what two datasets must share to be the same."""

import subprocess
import sys
from pathlib import Path

import netCDF4
import pytest

from critflow.cli import main
from critflow.workflow.load import load_file

TINY = Path(__file__).with_name("tiny_study.py")
COMMAND = "import sys; from critflow.cli import main; sys.exit(main())"


@pytest.fixture
def tiny():
    """The loaded study file."""
    return load_file(TINY)


@pytest.fixture
def run(tiny, monkeypatch):
    """`run(folder, *settings)` runs the tiny study in this process and returns its exit code.

    Its pauses are for commands that are disturbed: here they are left out.
    """
    monkeypatch.setitem(tiny.study.case.__globals__, "sleep", lambda seconds: None)

    def run_tiny(folder, *settings, workers=0, more=()):
        return main(_words(folder, settings, workers, more))

    return run_tiny


@pytest.fixture
def start():
    """`start(folder, *settings)` starts the same as a command with a process group of its own."""
    started = []

    def start_tiny(folder, *settings, workers=0, code=COMMAND, **options):
        words = [sys.executable, "-c", code, *_words(folder, settings, workers, ())]
        pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True, "start_new_session": True}
        started.append(subprocess.Popen(words, **(pipes | options)))
        return started[-1]

    yield start_tiny
    for process in started:
        process.kill()
        process.communicate()


def _words(folder, settings, workers, more):
    here = [] if workers is None else [f"--workers={workers}"]
    return ["run", str(TINY), "--out", str(folder), *here, *(f"--set={s}" for s in settings), *more]


# The one volatile attribute, and what says how the tree stood that the tests run in, which may change meanwhile.
_LEFT_OUT = {"history", "commit", "commit_dirty"}


def contents_of(path):
    """All that a netCDF file says of its data and how they were made: dimensions, attributes, dtypes and bytes."""
    with netCDF4.Dataset(path) as file:
        file.set_auto_maskandscale(False)
        attributes = {name: repr(file.getncattr(name)) for name in file.ncattrs() if name not in _LEFT_OUT}
        variables = {
            name: (
                str(variable.dtype),
                variable.dimensions,
                {key: repr(variable.getncattr(key)) for key in variable.ncattrs()},
                variable[...].tolist() if variable.dtype is str else variable[...].tobytes(),
            )
            for name, variable in file.variables.items()
        }
        return {name: len(dim) for name, dim in file.dimensions.items()}, attributes, variables


@pytest.fixture
def contents():
    """`contents(file)`, as above."""
    return contents_of


@pytest.fixture
def stamps():
    """`stamps(folder)` tells which shard files are there and when each was put in place."""

    def read(folder):
        return {path.name: (path.stat().st_ino, path.stat().st_mtime_ns) for path in (folder / "shards").glob("*.nc")}

    return read
