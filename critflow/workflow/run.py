"""One run of a study: find what is missing, fan it out, store it, merge it, report it."""

from __future__ import annotations

import math
import os
import platform
import time
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from importlib.metadata import version
from itertools import groupby, islice
from pathlib import Path
from typing import NamedTuple
from uuid import uuid4

from critflow.result import IntegrityError, Status
from critflow.workflow import attempts, faults
from critflow.workflow.batch import Job, Outcome
from critflow.workflow.errors import Interrupted, OtherTable, ReportError
from critflow.workflow.fanout import Batch, Interruption, fan_out
from critflow.workflow.folder import Folder
from critflow.workflow.index import Stored, append_to_index, listed_shards
from critflow.workflow.limits import Limits
from critflow.workflow.load import StudyFile
from critflow.workflow.merge import write_dataset
from critflow.workflow.plan import Case, Cases, Selection
from critflow.workflow.profiles import Cluster
from critflow.workflow.progress import RunProgress
from critflow.workflow.quarantine import write_quarantine
from critflow.workflow.reasons import OTHER_TABLE, Why, damaged, failed, last_line
from critflow.workflow.report import Report, write_report
from critflow.workflow.room import Room
from critflow.workflow.status import folder_status
from critflow.workflow.store import read_ending
from critflow.workflow.supervise import supervised

_MOST_SAID = 20  # lines about damaged shards
_SAMPLE = 100  # stored shards whose sizes are looked at
_RESUME = "run the same command again to resume"


@dataclass(frozen=True)
class RunResult:
    """What a run left behind."""

    dataset: Path
    kept: int  # cases that were there before
    failed: dict[str, str]  # now or before: ids and why
    report: Report


class Missing(NamedTuple):
    """What a run has to do before all is there."""

    todo: list[int]  # places of the cases to compute
    damage: list[str]  # a line for each damaged one of them
    failed: list[int]  # places of the cases that failed before
    why: dict[int, Why]  # of those that have a shard
    others: list[str]  # ids of shards that belong to no case of this run


def run_study(
    loaded: StudyFile,
    selection: Selection,
    folder: Folder,
    *,
    workers: int,
    cluster: Cluster | None = None,
    limits: Limits = Limits(),  # noqa: B008 (frozen)
    retry_failed: bool = False,
    command: str = "",
) -> RunResult:
    """Compute the cases that are not stored yet, then write the dataset and all that is read off it."""
    count = math.prod(selection.shape)
    with folder.held(loaded, selection):
        faults.passing("run.begun")
        attempts.forget(folder.shards)
        missing = missing_cases(selection, folder)
        todo, failed = missing.todo, [selection.case_at(place).id for place in missing.failed]
        if retry_failed:  # a failure that is found later is of this run, and is not tried again by it
            for case_id in failed:
                (folder.shards / f"{case_id}.nc").unlink()
            todo, failed = sorted(todo + missing.failed), []
        faults.passing("run.planned")
        batches = _batches(selection, todo)
        room = Room(folder.shards, len(todo), count)
        kept = set(range(count)).difference(todo)
        room.look((selection.case_at(place).id for place in islice(kept, _SAMPLE)), computed=False)
        with RunProgress(loaded.study.name, loaded.study.axes[0].noun, len(batches)) as progress:
            for line in missing.damage[:_MOST_SAID]:
                progress.say(f"{line}: computing the case again")
            if len(missing.damage) > _MOST_SAID:
                progress.say(f"and {len(missing.damage) - _MOST_SAID} more: computing these cases again too")
            if batches:
                failed += _compute(loaded, selection, folder, batches, workers, cluster, limits, progress, room)
        attempts.forget(folder.shards)
        faults.passing("run.computed")
        path = folder.dataset(loaded.study.name)
        write_dataset(selection, folder.shards, path, command)
        append_to_index(folder.index, folder.shards, selection.study.table_digest, folder_status(folder).read)
        reasons = write_quarantine(loaded, selection, folder, _cases(selection, failed), limits)
        faults.passing("run.written")
        try:
            report = write_report(selection.study, folder, known=True)
        except ReportError as error:
            if not failed:
                raise
            report = Report()
            progress.say(f"critflow: {error}")
        faults.passing("run.reported")
    return RunResult(path, count - len(todo), reasons, report)


def missing_cases(selection: Selection, folder: Folder) -> Missing:
    """What is not stored or damaged, and what failed, which is not computed again unless that is asked for.

    Every shard is read to its last byte: no other may be kept.
    """
    shards = set(listed_shards(folder.shards))
    missing = Missing([], [], [], {}, [])
    for place, case_id in enumerate(selection.ids()):
        if case_id not in shards:
            missing.todo.append(place)
            continue
        shards.remove(case_id)
        try:
            ending = read_ending(folder.shards, selection.study, selection.case_at(place), verify=True)
        except IntegrityError as error:
            missing.todo.append(place)
            if isinstance(error, OtherTable):
                missing.why[place] = OTHER_TABLE
            else:
                missing.damage.append(str(error))
                missing.why[place] = damaged(error, folder.shards / f"{case_id}.nc")
            continue
        if ending.status is Status.failed:
            missing.failed.append(place)
            missing.why[place] = failed(last_line(ending.error))
        elif ending.status is Status.missing:  # deleted in this moment
            missing.todo.append(place)
    missing.others.extend(shards)
    return missing


def _batches(selection: Selection, places: list[int]) -> list[list[Case]]:
    """The cases at these places, those of one value of the first axis together."""
    size = math.prod(selection.shape[1:])
    return [list(map(selection.case_at, batch)) for _, batch in groupby(places, lambda place: place // size)]


def _cases(selection: Selection, ids: Iterable[str]) -> Cases:
    """The cases that have these ids."""
    wanted = set(ids)
    return Cases(selection, [place for place, case_id in enumerate(selection.ids()) if case_id in wanted])


def _compute(
    loaded: StudyFile,
    selection: Selection,
    folder: Folder,
    batches: list[list[Case]],
    workers: int,
    cluster: Cluster | None,
    limits: Limits,
    progress: RunProgress,
    room: Room,
) -> list[str]:
    """Compute the batches and return ids of the failed cases; `Interrupted` when some were not begun or finished."""
    shards, parameters = str(folder.shards.absolute()), dict(selection.parameters)
    watched = limits if workers or cluster else None
    job = Job(uuid4().hex[:12], str(loaded.path), loaded.digest, shards, parameters, selection.study.selected, watched)
    total = sum(len(batch) for batch in batches)
    first = loaded.study.axis_names[0]
    left = Counter(case.values[first] for batch in batches for case in batch)
    stored: list[Outcome] = []
    with open(folder.log, "a", encoding="utf-8") as log, Interruption(job.run) as interruption:
        workers = min(workers, len(batches))
        where = cluster or (f"{workers} worker process{'es' * (workers > 1)}" if workers else "this process")
        progress.say(f"{loaded.study.name}: {progress.total} {progress.noun}, {total} cases to compute in {where}")
        log.write(f"# {_host_facts()}; {total} cases in {where}\n")

        def note(batch: Batch, outcomes: list[Outcome]) -> None:
            stored.extend(outcomes)
            for values, _ in zip(batch, outcomes, strict=False):  # an interrupted batch has fewer outcomes
                left[values[first]] -= 1
                if not left[values[first]]:
                    progress.advance()
            known = [Stored(outcome.case_id, outcome.status, outcome.code, outcome.error) for outcome in outcomes]
            append_to_index(folder.index, folder.shards, selection.study.table_digest, known)
            for outcome in outcomes:
                status = Status(outcome.status).name
                log.write(f"{outcome.case_id} {status} {outcome.seconds:.3f} s {outcome.checksum} {outcome.error}\n")
            faults.passing("run.logged")
            log.flush()
            room.look((outcome.case_id for outcome in outcomes), computed=True)

        try:
            with fan_out(job, interruption, workers, cluster) as compute:
                plain = [[case.values for case in batch] for batch in batches]
                for batch, outcomes in supervised(compute, job, selection, plain, interruption):
                    note(batch, outcomes)
        except KeyboardInterrupt:
            raise Interrupted(f"stopped at once; complete cases are stored: {_RESUME}") from None
        if len(stored) < total:
            raise Interrupted(f"interrupted with {len(stored)} of {total} cases computed: {_RESUME}")
    return [outcome.case_id for outcome in stored if outcome.status == Status.failed]


def _host_facts() -> str:
    stamp = time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime())
    packages = ", ".join(f"{name} {version(name)}" for name in ("critflow", "numpy", "scipy"))
    return f"{stamp} {packages}, Python {platform.python_version()}, {platform.platform()}, {os.cpu_count()} CPUs"
