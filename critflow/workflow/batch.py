"""What a worker does: compute some cases of one study, store each, and say in plain words how it went."""

from __future__ import annotations

import time
import traceback
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from threadpoolctl import threadpool_limits

from critflow.result import IntegrityError, Status, StudyError
from critflow.workflow.load import load_file
from critflow.workflow.plan import Case
from critflow.workflow.store import read_shard, write_shard
from critflow.workflow.study import Study

_stopped: set[str] = set()  # runs that were asked to stop; a set, because workers may serve several runs


class Outcome(NamedTuple):
    """How one case went; the arrays stay in its shard."""

    case_id: str
    status: int
    checksum: str
    seconds: float
    error: str  # last line of the traceback


@dataclass(frozen=True)
class Job:
    """Everything that the batches of one run share, in types that every worker can unpickle."""

    run: str  # token of the run
    study_path: str
    study_digest: str
    shards: str
    parameters: Mapping[str, Any]
    variables: tuple[str, ...] = ()  # what is stored of each case; all where none is named


def run_batch(job: Job, batch: Sequence[Mapping[str, int | str]]) -> list[tuple]:
    """Compute the cases with these axis values, in order; those left when the run is stopped are not begun."""
    loaded = load_file(Path(job.study_path))
    if loaded.digest != job.study_digest:
        raise StudyError(f"{job.study_path} changed while it ran: run it again")
    study, shards = loaded.study.storing(job.variables), Path(job.shards)
    outcomes = []
    with threadpool_limits(limits=1):  # where it runs must change no digit, and workers share the cores already
        for values in batch:
            if job.run in _stopped:
                break
            case = Case(study.name, study.version, job.parameters, values, study.selected)
            outcomes.append(tuple(_stored(study, shards, case) or _computed(study, shards, case)))
    return outcomes


def stop(run: str) -> None:
    """Let the case that runs now finish, and begin no other of this run in this process."""
    _stopped.add(run)


def record_failure(study: Study, shards: Path, case: Case, error: str, seconds: float = 0.0) -> Outcome:
    """Store that the case failed, and why."""
    checksum = write_shard(shards, study, case, Status.failed, {}, error)
    return Outcome(case.id, int(Status.failed), checksum, seconds, error.strip().splitlines()[-1])


def _stored(study: Study, shards: Path, case: Case) -> Outcome | None:
    """The case when it is done already, as after the death of the worker that had this batch before."""
    try:
        shard = read_shard(shards, study, case)
    except IntegrityError:
        return None
    if shard is None or shard.status is Status.failed:
        return None
    return Outcome(case.id, int(shard.status), shard.checksum, 0.0, "")


def _computed(study: Study, shards: Path, case: Case) -> Outcome:
    start = time.perf_counter()
    try:
        arrays = study.computed(case.parameters, case.values)
        status = Status(int(arrays.pop("status")))
    except (Exception, SystemExit):  # one bad case, whatever it raises, must not take the others down
        return record_failure(study, shards, case, traceback.format_exc(), time.perf_counter() - start)
    seconds = time.perf_counter() - start
    return Outcome(case.id, int(status), write_shard(shards, study, case, status, arrays), seconds, "")
