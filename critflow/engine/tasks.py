"""One task: the cases of one network, computed in one process, and what remains of a case that fails or dies in it.

A case that raises leaves a text in `failed/`.  A case that exceeds its time limit ends its process: nothing gentler
stops compiled code.  While a worker process computes a network there is a trace file next to its shard; after a death
it names the case that ran, and contains the stack that the interpreter could still write.

What a shared file system refuses for a moment is tried three times; then the cases of this network fail.
"""

from __future__ import annotations

import faulthandler
import shlex
import signal
import socket
import threading
import time
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

from threadpoolctl import threadpool_limits

from critflow import extensions
from critflow.engine.code_digest import environment, libraries, load_file, module_of, used_extras
from critflow.engine.settings import Case, Selection, spelled, words_of_case
from critflow.engine.store import (
    Folder,
    StoredCase,
    is_fleeting,
    last_line,
    persistent,
    read_shard,
    refuse_sizes,
    refuse_values,
    shard_path,
    shared_variables,
    sizes_of,
    write_shard,
    write_text,
)
from critflow.engine.study import THREADS, Study
from critflow.result import EnvironmentFailure, IntegrityError, Status, StudyError

_MINUTE = 60.0
_LONGEST_ERROR = 20_000  # characters
# BLAS threads, the netCDF library and the timer of the interpreter belong to the whole process.
_one_at_a_time = threading.Lock()


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
    libraries: Mapping[str, str] = field(default_factory=libraries)  # workers must have the same

    def selection(self) -> Selection:
        """The study and its parameters as the run has them; the tasks have the values of the axes.

        Raises if the file or a library is not the same in this process.
        """
        loaded = load_file(Path(self.study_path))
        if loaded.digest != self.study_digest:
            raise StudyError(f"{self.study_path} changed during the run: run it again")
        here = libraries()
        if different := [name for name in {**self.libraries, **here} if self.libraries.get(name) != here.get(name)]:
            words = ", ".join(f"{n} {here.get(n, 'missing')} (not {self.libraries.get(n)})" for n in different)
            raise EnvironmentFailure(f"the worker on {socket.gethostname()} has {words}: install the same versions")
        return Selection.of(loaded.study, self.variables, self.parameters, {})


def compute_network(job: Job, cases: Sequence[Mapping[str, int | str]], careful: bool = False) -> list[Outcome]:
    """Compute the cases with these axis values, all in one shard, in order; a stopped run begins no further case.

    careful  store each case at once, after a death in this task

    Complete cases are stored together, at the end and every minute: a process that is killed loses what it computed
    since, of this network alone.
    """
    outcomes, folder, selection = list[Outcome](), Folder(Path(job.folder)), persistent(job.selection)()
    with _one_at_a_time, threadpool_limits(limits=THREADS):  # of libraries that are loaded, those of the study too
        try:
            _compute_and_store(job, folder, [selection.case(**values) for values in cases], careful, outcomes)
        except (OSError, EnvironmentFailure) as error:
            if not is_fleeting(error):
                raise
            known, text = {one.case_id for one in outcomes}, traceback.format_exc()
            left = (case for values in cases if (case := selection.case(**values)).id not in known)
            outcomes += [record_failure(job, selection.study, case, text) for case in left]
    return outcomes


def _compute_and_store(job: Job, folder: Folder, cases: Sequence[Case], careful: bool, outcomes: list[Outcome]) -> None:
    """Compute and store the cases of one shard; each outcome is added to the list when it is final."""
    study, path = cases[0].study, shard_path(folder.shards, cases[0])
    new = list[tuple[Case, float]]()  # cases that are not stored yet; seconds
    written = time.perf_counter()
    if not path.parent.is_dir():  # a folder of a thousand
        path.parent.mkdir(exist_ok=True)
    # What the shard has.
    try:
        stored, checksum = read_shard(path, study, cases[0])
    except IntegrityError:  # no shard, a damaged one, or one with another table: its cases are computed
        stored, checksum = {}, ""

    def store() -> None:
        """Store what was computed since the last time."""
        nonlocal checksum, written
        if not new:
            return
        try:
            checksum = write_shard(folder.shards, study, cases[0], stored)
        except EnvironmentFailure:
            raise
        except Exception:  # too large for the memory or the format
            error = traceback.format_exc()
            outcomes.extend(record_failure(job, study, case, error, seconds) for case, seconds in new)
        else:
            for case, seconds in new:
                folder.delete_failure(case)
                status, sizes = int(stored[case.id].status), sizes_of(study, stored[case.id].arrays)
                outcomes.append(Outcome(case.id, status, seconds, checksum, sizes))
        new.clear()
        written = time.perf_counter()

    with _traced(folder.trace(cases[0]), job.seconds) as timed:
        try:
            for case in cases:
                if folder.stop.exists():
                    break
                start = time.perf_counter()
                # This run may have stored it before the death of the worker that had the task.
                if (known := stored.get(case.id)) and known.code == job.code:
                    outcomes.append(Outcome(case.id, int(known.status), 0.0, checksum))
                elif isinstance(one := _computed(job, study, timed, case, stored), Outcome):
                    outcomes.append(one)
                else:
                    stored[case.id] = one
                    new.append((case, time.perf_counter() - start))
                if careful or time.perf_counter() - written > _MINUTE:
                    store()
        finally:  # also after Ctrl-C in this process
            store()


def _computed(
    job: Job, study: Study, timed: _Timed, case: Case, others: Mapping[str, StoredCase]
) -> StoredCase | Outcome:
    """The case if it is complete, its outcome if it failed; raises `IntegrityError` if it contradicts the others."""
    start = time.perf_counter()
    extensions.used.clear()
    with timed(case.id):
        try:
            arrays = study.computed(case.parameters, case.values)
            status = Status(int(arrays.pop("status")))
            if uncounted := sorted(one for one in extensions.used if module_of(one) not in used_extras(study)):
                words = ", ".join(map(repr, uncounted))
                raise StudyError(
                    f"the case used {words} of critflow-extras, whose code must count: declare it with "
                    f"extras=({words},) in the Study"
                )
        except BaseException as error:  # one case must not end the others, with any exception
            if isinstance(error, KeyboardInterrupt) and threading.current_thread() is threading.main_thread():
                raise  # from the keyboard
            return record_failure(job, study, case, traceback.format_exc(), time.perf_counter() - start)
    for other in (one for name, one in others.items() if name != case.id):
        refuse_sizes(case.id, sizes_of(study, arrays), sizes_of(study, other.arrays))
        for name in shared_variables(study) & arrays.keys() & other.arrays.keys():
            refuse_values(case, name, arrays[name], other.arrays[name])
    absent = tuple(v.name for v in study.returned if v.name not in arrays and v.name != "status")
    return StoredCase(case.values, status, job.code, environment(), absent, arrays)


def record_failure(job: Job, study: Study, case: Case, error: str, seconds: float = 0.0) -> Outcome:
    """Store that the case failed: the command that runs it alone, its parameters and the error."""
    error = error.strip().replace("\0", "\\0").encode(errors="backslashreplace").decode()
    if len(error) > _LONGEST_ERROR:
        error = f"{error[: _LONGEST_ERROR // 2]}\n...\n{error[-_LONGEST_ERROR // 2 :]}"
    settings = [f"--set={word}" for word in words_of_case(case)]
    lines = [shlex.join(["critflow", "run", job.command[0], *settings, *job.command[1:]]), ""]
    lines += [f"{key} = {spelled(value)}" for key, value in {**case.values, **case.parameters}.items()]
    lines += [f"code = {job.code}", "", error]
    write_text(Folder(Path(job.folder)).failure(case), "\n".join(lines) + "\n")
    return Outcome(case.id, int(Status.failed), seconds, error=last_line(error))


def take_trace(path: Path) -> tuple[str, str]:
    """The id of the case in which a worker died, with reason and stack; empty if it died in none.  Deletes the file."""
    try:
        case_id, _, stack = path.read_text(encoding="utf-8", errors="replace").partition("\n")
    except FileNotFoundError:
        return "", ""
    path.unlink()
    stack = stack.partition("\n\nExtension modules")[0].strip()
    if stack.startswith("Timeout"):
        reason = "the case exceeded its time limit"
    elif stack.startswith("Fatal Python error: "):
        reason = f"the case crashed: {stack.splitlines()[0].removeprefix('Fatal Python error: ')}"
    elif stack:
        reason = "the case was terminated from outside, for example for exceeding the memory limit"
    else:
        reason = "the case ended its worker process without a message: out of memory, or an exit in compiled code"
    return case_id, f"{stack}\n{reason}".strip()


_Timed = Callable[[str], AbstractContextManager[None]]  # of the id of a case


@contextmanager
def _traced(path: Path, seconds: float | None) -> Iterator[_Timed]:
    """Keep a trace file during the block, in worker processes.

    In a block of its value the file names a case, and the process ends where this takes longer than its time limit.
    """
    if seconds is None:
        yield lambda case_id: nullcontext()
        return

    @contextmanager
    def timed(case_id: str) -> Iterator[None]:
        trace.write(f"{case_id}\n".encode())
        # A thread without the lock of the interpreter, so that no compiled code can delay it.
        faulthandler.dump_traceback_later(seconds, exit=True, file=trace)
        try:
            yield
        finally:
            faulthandler.cancel_dump_traceback_later()
            trace.truncate(0)

    with persistent(open)(path, "ab", 0) as trace:
        trace.truncate(0)
        faulthandler.enable(trace, all_threads=False)
        faulthandler.register(signal.SIGTERM, trace, chain=True)  # sent by dask for too much memory
        try:
            yield timed
        finally:
            faulthandler.unregister(signal.SIGTERM)
            faulthandler.disable()
    path.unlink(missing_ok=True)
