"""Tasks: the computation of the cases of one value of the first axis in one process, and the record of each result.

The complete cases of a task are stored together when it ends, and every minute while it lasts: a process that is
killed loses what it computed since, of this task alone.

A worker process may die in a case, or the case may exceed its time limit, which ends the process: nothing gentler stops
compiled code.  A trace file per case, `failed/.CASE_ID.trace`, exists as long as the case runs; after a death it names
the case and contains the stack that the interpreter could still write.
"""

from __future__ import annotations

import faulthandler
import shlex
import signal
import socket
import sys
import threading
import time
import traceback
from collections.abc import Iterator, Mapping, Sequence, Set
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

from threadpoolctl import threadpool_limits

from critflow.result import CritflowError, EnvironmentFailure, IntegrityError, Status, StudyError
from critflow.workflow.code import numeric_extras, used_extras
from critflow.workflow.folder import Folder, Part
from critflow.workflow.load import load_file
from critflow.workflow.plan import Case, spelled, words_of_case
from critflow.workflow.provenance import environment, libraries
from critflow.workflow.store import (
    Record,
    Stored,
    delete_failure,
    failure_path,
    last_line,
    read_shard,
    refuse_misfit,
    sizes_of,
    write_shard,
    write_text,
)
from critflow.workflow.study import Study

HOUR = 3600.0
_MINUTE = 60.0
_LONGEST_ERROR = 20_000  # characters
# BLAS threads, the netCDF library and the timer of the interpreter belong to the whole process.
_one_at_a_time = threading.Lock()


class Interrupted(CritflowError):
    """The run was stopped; all cases computed before are stored."""


class Outcome(NamedTuple):
    """Result of one case; its arrays remain in the shard."""

    case_id: str
    status: int
    seconds: float
    checksum: str = ""  # of the shard
    sizes: Mapping[str, int] = MappingProxyType({})  # of the inner dimensions
    error: str = ""  # last line of the traceback


@dataclass(frozen=True)
class Job:
    """Everything that the tasks of one run share."""

    study_path: str
    study_digest: str
    folder: str  # absolute path of the results folder
    parameters: Mapping[str, Any]
    variables: tuple[str, ...]  # stored variables; empty if all are stored
    command: tuple[str, ...]  # words after `critflow run` and the settings that run one case alone
    code: str  # code that computes the cases
    seconds: float | None = None  # time limit of a case, in worker processes
    part: Part | None = None  # of the run in its folder
    libraries: Mapping[str, str] = field(default_factory=libraries)  # workers must have the same

    def study(self) -> Study:
        """The study as the run has it; raises if the file or a library is not the same in this process."""
        loaded = load_file(Path(self.study_path))
        if loaded.digest != self.study_digest:
            raise StudyError(f"{self.study_path} changed during the run: run it again")
        here = libraries()
        if different := [name for name in {**self.libraries, **here} if self.libraries.get(name) != here.get(name)]:
            words = ", ".join(f"{n} {here.get(n, 'missing')} (not {self.libraries.get(n)})" for n in different)
            raise EnvironmentFailure(f"the worker on {socket.gethostname()} has {words}: install the same versions")
        return loaded.study.storing(self.variables)

    def case(self, study: Study, values: Mapping[str, int | str]) -> Case:
        return Case(study.name, study.version, self.parameters, values, study.selected)


def run_cases(job: Job, cases: Sequence[Mapping[str, int | str]], careful: bool = False) -> list[Outcome]:
    """Compute the cases with these axis values, all in one shard, in order; a stopped run begins no further case.

    careful  store each case at once, after a death in this task
    """
    folder = Folder(Path(job.folder), job.part)
    with _one_at_a_time, threadpool_limits(limits=1):  # the number of threads must not change a digit
        study = job.study()
        task = _Task(job, folder, study, job.case(study, cases[0]))
        try:
            for values in cases:
                if folder.stop.exists():
                    break
                task.attempt(job.case(study, values))
                if careful or time.perf_counter() - task.written > _MINUTE:
                    task.write()
        finally:  # also after Ctrl-C in this process
            task.write()
    return task.outcomes


class _Task:
    """The cases of one shard: those that it had before, and those that are computed now."""

    def __init__(self, job: Job, folder: Folder, study: Study, first: Case):
        self.job, self.folder, self.study, self.first = job, folder, study, first
        self.outcomes: list[Outcome] = []
        self.stored, self.checksum = dict[str, Stored](), ""
        self.new: list[tuple[Case, Outcome]] = []  # computed and not written
        self.written = time.perf_counter()
        try:
            if shard := read_shard(folder.shards, study, first):
                self.stored, self.checksum = dict(shard.cases), shard.checksum
        except IntegrityError:
            pass  # damaged, or with another table: its cases are computed again

    def attempt(self, case: Case) -> None:
        """Compute a case, unless this run stored it before the death of the worker that had the task."""
        if (known := self.stored.get(case.id)) and known.record.code == self.job.code:
            self.outcomes.append(Outcome(case.id, int(known.record.status), 0.0, self.checksum))
            return
        start, modules = time.perf_counter(), set(sys.modules)
        with _traced(self.folder, case, self.job.seconds) if self.job.seconds else nullcontext():
            try:
                arrays = self.study.computed(case.parameters, case.values)
                status = Status(int(arrays.pop("status")))
                _refuse_unnamed(self.study, sys.modules.keys() - modules)
            except BaseException as error:  # one case must not end the others, with any exception
                if isinstance(error, KeyboardInterrupt) and threading.current_thread() is threading.main_thread():
                    raise  # from the keyboard
                seconds = time.perf_counter() - start
                self.outcomes.append(record_failure(self.job, self.study, case, traceback.format_exc(), seconds))
                return
        others = [one for name, one in self.stored.items() if name != case.id]
        refuse_misfit(self.study, case, arrays, others)
        absent = tuple(name for name in self.study.inner_dims if name not in arrays and name != "status")
        record = Record(case.values, status, self.job.code, environment(), absent)
        self.stored[case.id] = Stored(record, arrays)
        sizes, seconds = sizes_of(self.study, arrays), time.perf_counter() - start
        self.new.append((case, Outcome(case.id, int(status), seconds, sizes=sizes)))

    def write(self) -> None:
        """Store what was computed since the last time."""
        if not self.new:
            return
        try:
            self.checksum = write_shard(self.folder.shards, self.study, self.first, self.stored)
        except EnvironmentFailure:
            raise
        except Exception:  # too large for the memory or the format
            error = traceback.format_exc()
            self.outcomes += [record_failure(self.job, self.study, case, error, one.seconds) for case, one in self.new]
        else:
            self.outcomes += [one._replace(checksum=self.checksum) for _, one in self.new]
            for case, _ in self.new:
                delete_failure(self.folder.failed, case)
        self.new, self.written = [], time.perf_counter()


def _refuse_unnamed(study: Study, modules: Set[str]) -> None:
    """Raise `StudyError` where a case imported an extra whose code is not part of its identity."""
    if unnamed := sorted(numeric_extras(modules) - used_extras(study)):
        words = ", ".join(map(repr, unnamed))
        advice = f"declare it with extras=({words},) in the Study"
        raise StudyError(f"the case used the extra {words} of critflow, whose code must count: {advice}")


def record_failure(job: Job, study: Study, case: Case, error: str, seconds: float = 0.0) -> Outcome:
    """Store that the case failed: the command that runs it alone, its parameters and the error."""
    error = error.strip().replace("\0", "\\0").encode(errors="backslashreplace").decode()
    if len(error) > _LONGEST_ERROR:
        error = f"{error[: _LONGEST_ERROR // 2]}\n...\n{error[-_LONGEST_ERROR // 2 :]}"
    settings = [f"--set={word}" for word in words_of_case(study, case)]
    lines = [shlex.join(["critflow", "run", job.command[0], *settings, *job.command[1:]]), ""]
    lines += [f"{key} = {spelled(value)}" for key, value in {**case.values, **case.parameters}.items()]
    lines += [f"code = {job.code}", "", error]
    write_text(failure_path(Folder(Path(job.folder)).failed, case), "\n".join(lines) + "\n")
    return Outcome(case.id, int(Status.failed), seconds, error=last_line(error))


def take_trace(folder: Folder, case: Case) -> str | None:
    """Reason and stack of the death in this case, whose trace file is deleted; None if there was no death in it."""
    path = folder.trace(case)
    try:
        stack = path.read_text(encoding="utf-8", errors="replace").partition("\n\nExtension modules")[0].strip()
    except FileNotFoundError:
        return None
    path.unlink()
    if stack.startswith("Timeout"):
        reason = "the case exceeded its time limit"
    elif stack.startswith("Fatal Python error: "):
        reason = f"the case crashed: {stack.splitlines()[0].removeprefix('Fatal Python error: ')}"
    elif stack:
        reason = "the case was terminated from outside, for example for exceeding the memory limit"
    else:
        reason = "the case ended its worker process without a message: out of memory, or an exit in compiled code"
    return f"{stack}\n{reason}".strip()


@contextmanager
def _traced(folder: Folder, case: Case, seconds: float) -> Iterator[None]:
    """Keep a trace file during the block, and end the process if it takes longer than its time limit."""
    path = folder.trace(case)
    with open(path, "w") as trace:
        faulthandler.enable(trace, all_threads=False)
        faulthandler.register(signal.SIGTERM, trace, chain=True)  # sent by dask for too much memory
        # A thread without the lock of the interpreter, so that no compiled code can delay it.
        faulthandler.dump_traceback_later(seconds, exit=True, file=trace)
        try:
            yield
        finally:
            faulthandler.cancel_dump_traceback_later()
            faulthandler.unregister(signal.SIGTERM)
            faulthandler.disable()
    path.unlink(missing_ok=True)
