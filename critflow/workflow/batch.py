"""What a worker does: compute some cases of one study, store each, and say in plain words how it went."""

from __future__ import annotations

import socket
import threading
import time
import traceback
from collections.abc import Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from threadpoolctl import threadpool_limits

from critflow.result import EnvironmentFailure, IntegrityError, Status, StudyError
from critflow.workflow import faults
from critflow.workflow.attempts import attempt
from critflow.workflow.limits import Limits
from critflow.workflow.load import load_file
from critflow.workflow.plan import Case
from critflow.workflow.provenance import code_version, libraries
from critflow.workflow.store import read_shard, write_shard
from critflow.workflow.study import Study

_LONGEST_ERROR, _LONGEST_LINE = 20_000, 300  # letters
_stopped: set[str] = set()  # runs that were asked to stop; a set, because workers may serve several runs


class Outcome(NamedTuple):
    """How one case went; the arrays stay in its shard."""

    case_id: str
    status: int
    checksum: str
    seconds: float
    error: str  # last line of the traceback
    code: str  # what computed it


@dataclass(frozen=True)
class Job:
    """Everything that the batches of one run share, in types that every worker can unpickle."""

    run: str  # token of the run
    study_path: str
    study_digest: str
    shards: str
    parameters: Mapping[str, Any]
    variables: tuple[str, ...] = ()  # what is stored of each case; all where none is named
    limits: Limits | None = None  # of a worker process; none in the process of the command
    made_with: Mapping[str, str] = field(default_factory=libraries)  # here; workers must have the same


def run_batch(job: Job, batch: Sequence[Mapping[str, int | str]]) -> list[tuple]:
    """Compute the cases with these axis values, in order; those left when the run is stopped are not begun."""
    loaded = load_file(Path(job.study_path))
    if loaded.digest != job.study_digest:
        raise StudyError(f"{job.study_path} changed while it ran: run it again")
    _refuse_other_libraries(job.made_with)
    study, shards = loaded.study.storing(job.variables), Path(job.shards)
    outcomes = []
    with threadpool_limits(limits=1):  # where it runs must change no digit, and workers share the cores already
        for values in batch:
            if job.run in _stopped:
                break
            case = Case(study.name, study.version, job.parameters, values, study.selected)
            outcomes.append(tuple(_stored(study, shards, case) or _attempted(job, study, shards, case)))
    faults.passing("batch.ended")
    return outcomes


def _refuse_other_libraries(wanted: Mapping[str, str]) -> None:
    """The same command gives the same numbers anywhere, and a dataset is made by one version of the code."""
    have = libraries()
    if other := [name for name in dict(wanted) | dict(have) if wanted.get(name) != have.get(name)]:
        differ = ", ".join(f"{name} {have.get(name, 'missing')} (not {wanted.get(name, 'any')})" for name in other)
        raise EnvironmentFailure(f"the worker on {socket.gethostname()} has {differ}: install the same there")


def stop(run: str) -> None:
    """Let the case that runs now finish, and begin no other of this run in this process."""
    _stopped.add(run)


def record_failure(study: Study, shards: Path, case: Case, error: str, seconds: float = 0.0) -> Outcome:
    """Store that the case failed, and why."""
    error = error.strip().replace("\0", "\\0").encode(errors="backslashreplace").decode()
    if len(error) > _LONGEST_ERROR:
        error = f"{error[: _LONGEST_ERROR // 2]}\n...\n{error[-_LONGEST_ERROR // 2 :]}"
    checksum = write_shard(shards, study, case, Status.failed, {}, error)
    return Outcome(case.id, int(Status.failed), checksum, seconds, last_words(error), code_version(study))


def last_words(error: str) -> str:
    """What the end of a traceback says, in a line."""
    return (error.splitlines() or [""])[-1][:_LONGEST_LINE]


def _stored(study: Study, shards: Path, case: Case) -> Outcome | None:
    """The case when this run did it already, as before the death of the worker that had this batch."""
    try:
        shard = read_shard(shards, study, case)
    except IntegrityError:
        return None
    if shard is None:
        return None
    return Outcome(case.id, int(shard.status), shard.checksum, 0.0, last_words(shard.error), shard.code)


def _attempted(job: Job, study: Study, shards: Path, case: Case) -> Outcome:
    watched = attempt(job.run, shards, case.id, job.limits.case_seconds) if job.limits else nullcontext()
    with watched:
        faults.passing("case.begun", case.id)
        outcome = _computed(study, shards, case)
        faults.passing("case.stored", case.id)
    return outcome


def _computed(study: Study, shards: Path, case: Case) -> Outcome:
    start = time.perf_counter()
    try:
        arrays = study.computed(case.parameters, case.values)
        status = Status(int(arrays.pop("status")))
    except BaseException as error:  # one bad case, whatever it raises, must not take the others down
        if isinstance(error, KeyboardInterrupt) and threading.current_thread() is threading.main_thread():
            raise  # a Ctrl-C comes nowhere else
        return record_failure(study, shards, case, traceback.format_exc(), time.perf_counter() - start)
    seconds = time.perf_counter() - start
    faults.passing("case.computed", case.id)
    try:
        checksum = write_shard(shards, study, case, status, arrays)
    except EnvironmentFailure:
        raise
    except Exception:  # no room for it in memory, or in the format
        return record_failure(study, shards, case, traceback.format_exc(), seconds)
    return Outcome(case.id, int(status), checksum, seconds, "", code_version(study))
