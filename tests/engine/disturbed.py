"""Runs of the plain study in processes of their own, disturbed at a chosen step or from outside.

A step is anything that a run does to the files of its folder: opening one to write, writing with the netCDF library,
synchronising, renaming, deleting. They are counted by Python's audit events and by wrappers of library functions, so
the engine contains no code for its tests. A process killed while it opens a file leaves it empty; killed while it
synchronises, it leaves half of that file.
"""

import errno
import multiprocessing
import os
import signal
import sys
import time
from contextlib import suppress
from multiprocessing import forkserver
from pathlib import Path

import netCDF4
import xarray as xr

from critflow.command.main import main
from critflow.engine.code_digest import load_file
from critflow.engine.settings import select
from critflow.engine.store import read_shard, shard_path

PLAIN = Path(__file__).with_name("plain_study.py")
STUDY = load_file(PLAIN).study
SIGNALS = {"kill": signal.SIGKILL, "terminate": signal.SIGTERM, "interrupt": signal.SIGINT}

SERVER = multiprocessing.get_context("forkserver")

VOLATILE = {"history", "commit", "commit_dirty"}  # the last two describe the tree that the tests run in


def contents_of(path):
    """Dimensions, attributes, dtypes and bytes of a netCDF file, except for the attributes that may differ."""
    with netCDF4.Dataset(path) as file:
        file.set_auto_maskandscale(False)
        attributes = {name: repr(file.getncattr(name)) for name in file.ncattrs() if name not in VOLATILE}
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


def numbers_of(folder):
    """The bytes of the computed numbers of the algebra study, by case and name."""
    with xr.load_dataset(folder / "algebra.nc") as ds:
        return {
            (seed, part, name): ds[name].sel(seed=seed, part=part).values.tobytes()
            for name in ("product", "solution", "eigenvalues", "status")
            for seed in ds.seed.values.tolist()
            for part in ds.part.values.tolist()
        }


def stamps_of(folder):
    """Which stored cases a folder contains, and when each was put in place."""
    return {path.name: (path.stat().st_ino, path.stat().st_mtime_ns) for path in (folder / "shards").glob("*.nc")}


def stored_whole(folder, settings=()):
    """Names of the stored cases; each file with the name of a case must be complete."""
    paths = [(case, shard_path(folder / "shards", case)) for case in select(STUDY, list(settings)).cases]
    return {path.name for case, path in paths if path.exists() and case.id in read_shard(path, STUDY, case)[0]}


def words_of(folder, settings=(), workers=0, study=PLAIN):
    here = [] if workers is None else [f"--workers={workers}"]
    return ["run", str(study), "--out", str(folder), *here, *(f"--set={word}" for word in settings)]


def server():
    """Starts processes that are forked from one in which a run has loaded all libraries."""
    before = os.environ.get("PYTHONPATH")
    os.environ["PYTHONPATH"] = os.pathsep.join(path for path in sys.path if path)
    SERVER.set_forkserver_preload(["warm"])
    forkserver.ensure_running()
    del os.environ["PYTHONPATH"]
    if before is not None:
        os.environ["PYTHONPATH"] = before
    return SERVER


def begun(
    folder, settings=(), *, workers=0, step=0, action="kill", environment=None, prepare=None, study=PLAIN, options=()
):
    """The process of a run that has begun.

    Its messages go to FOLDER.err, the number of its steps to FOLDER.steps; `prepare` is called in it before the run.
    """
    process = server().Process(
        target=_run,
        args=(
            [*words_of(folder, settings, workers, study), *options],
            *(str(folder), step, action, environment or {}, prepare),
        ),
    )
    process.start()
    return process


def wait_until(found, alive, said=str):
    """What `found` returns as soon as it is true, while the process is `alive`; else `said` is the message."""
    while not (what := found()):
        assert alive(), said()
        time.sleep(0.02)
    return what


def stored_files(folder):
    return list((folder / "shards").glob("*.nc"))


def ended(process, seconds=120.0):
    """The exit code of a process; a signal is a number below zero."""
    process.join(seconds)
    if process.exitcode is None:
        process.kill()
        process.join()
        raise AssertionError(f"the run did not end in {seconds} s")
    return process.exitcode


def messages(folder):
    path = Path(f"{folder}.err")
    return path.read_text() if path.exists() else ""


class _Steps:
    """Counts steps in one folder; the chosen one is disturbed."""

    def __init__(self, folder, chosen, action):
        self.folder, self.chosen, self.action, self.count = folder + os.sep, chosen, action, 0

    def audit(self, event, args):
        writes = event == "open" and args[2] & (os.O_WRONLY | os.O_RDWR | os.O_CREAT)
        if writes or event in ("os.rename", "os.remove", "os.mkdir", "os.rmdir", "os.truncate"):
            self.take(args[0], flags=args[2] if writes else None, deletes=event in ("os.remove", "os.rmdir"))

    def take(self, path, descriptor=None, flags=None, deletes=False):
        if isinstance(path, int) or not os.fspath(path).startswith(self.folder):
            return
        self.count += not (deletes and self.action == "full")  # a full disk refuses no deletion
        if self.count != self.chosen:
            return
        self.chosen = 0
        if self.action == "full":
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), path)
        if self.action == "kill" and descriptor is not None:
            with suppress(OSError):  # a folder
                os.ftruncate(descriptor, os.fstat(descriptor).st_size // 2)
        if self.action == "kill" and flags is not None:  # dies after opening it, before it writes
            os.close(os.open(path, flags, 0o666))
        os.kill(os.getpid(), SIGNALS[self.action])

    def install(self):
        steps, fsync, dataset = self, os.fsync, netCDF4.Dataset

        written = {}

        class Dataset(dataset):
            def __init__(self, path, mode="r", *more, **options):
                if mode != "r":
                    steps.take(path, flags=os.O_WRONLY | os.O_CREAT)
                    written[id(self)] = path
                super().__init__(path, mode, *more, **options)

            def close(self):
                if path := written.pop(id(self), None):
                    steps.take(path)
                return super().close()

        def synchronise(file):
            descriptor = file if isinstance(file, int) else file.fileno()
            steps.take(os.readlink(f"/proc/self/fd/{descriptor}"), descriptor)
            fsync(descriptor)

        os.fsync, netCDF4.Dataset = synchronise, Dataset
        sys.addaudithook(self.audit)


def _run(words, folder, step, action, environment, prepare):
    os.environ.update(environment)
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.default_int_handler if number == signal.SIGINT else signal.SIG_DFL)
    with open(folder + ".err", "a") as file:
        os.dup2(file.fileno(), 1)
        os.dup2(file.fileno(), 2)
    sys.stdout = sys.stderr = open(2, "w", closefd=False)
    steps = _Steps(folder, step, action)
    steps.install()
    if prepare is not None:
        prepare()
    code = main(words)
    with suppress(OSError):  # under a limit
        Path(folder + ".steps").write_text(str(steps.count))
    sys.exit(code)
