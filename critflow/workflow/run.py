"""One run of a study: find what is missing, fan it out, store it, merge it, report it."""

from __future__ import annotations

import os
import platform
import time
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from uuid import uuid4

from critflow.result import IntegrityError, Status
from critflow.workflow.batch import Job, Outcome, record_failure
from critflow.workflow.errors import Interrupted, ReportError
from critflow.workflow.fanout import Batch, Interruption, fan_out
from critflow.workflow.folder import Folder
from critflow.workflow.load import StudyFile
from critflow.workflow.plan import Case, Selection
from critflow.workflow.progress import RunProgress
from critflow.workflow.report import Report, write_report
from critflow.workflow.schema import merge, write_dataset
from critflow.workflow.store import read_status

_RESUME = "run the same command again to resume"


@dataclass(frozen=True)
class RunResult:
    """What a run left behind."""

    dataset: Path
    kept: int  # cases that were there before
    failed: list[Outcome]
    report: Report


def run_study(
    loaded: StudyFile,
    selection: Selection,
    folder: Folder,
    *,
    workers: int,
    scheduler: str | None = None,
    command: str = "",
) -> RunResult:
    """Compute the cases that are not stored yet, then write the dataset and all that is read off it."""
    cases = selection.cases()
    with folder.held(loaded, selection):
        todo, damage = missing_cases(selection, folder)
        batches = [[case for case in batch if case.id in todo] for batch in selection.batches()]
        batches = [batch for batch in batches if batch]
        with RunProgress(loaded.study.name, loaded.study.axes[0].noun, len(batches)) as progress:
            for line in damage:
                progress.say(f"{line}: computing the case again")
            failed: list[Outcome] = []
            if batches:
                failed = _compute(loaded, selection, folder, batches, workers, scheduler, progress)
        path = folder.dataset(loaded.study.name)
        write_dataset(merge(selection, folder.shards), path, command)
        try:
            report = write_report(selection.study, folder, known=True)
        except ReportError as error:
            if not failed:
                raise
            report = Report()
            progress.say(f"critflow: {error}")
    return RunResult(path, len(cases) - len(todo), failed, report)


def missing_cases(selection: Selection, folder: Folder) -> tuple[set[str], list[str]]:
    """Ids of the cases that are not stored, failed or damaged, and a line for each damaged one."""
    todo, damage = set(), []
    for case in selection.cases():
        try:
            status = read_status(folder.shards, selection.study, case, verify=True)
        except IntegrityError as error:
            damage.append(str(error))
            status = Status.missing
        if status in (Status.missing, Status.failed):
            todo.add(case.id)
    return todo, damage


def _compute(
    loaded: StudyFile,
    selection: Selection,
    folder: Folder,
    batches: list[list[Case]],
    workers: int,
    scheduler: str | None,
    progress: RunProgress,
) -> list[Outcome]:
    """Compute the batches and return the failed cases; `Interrupted` when some were not begun or not finished."""
    shards, parameters = str(folder.shards.absolute()), dict(selection.parameters)
    job = Job(uuid4().hex[:12], str(loaded.path), loaded.digest, shards, parameters, selection.study.selected)
    total = sum(len(batch) for batch in batches)
    stored: list[Outcome] = []
    with open(folder.log, "a", encoding="utf-8") as log, Interruption(job.run) as interruption:
        workers = min(workers, len(batches))
        where = scheduler or (f"{workers} worker processes" if workers else "this process")
        progress.say(f"{loaded.study.name}: {progress.total} {progress.noun}, {total} cases to compute in {where}")
        log.write(f"# {_host_facts()}; {total} cases in {where}\n")

        def note(outcomes: list[Outcome]) -> None:
            stored.extend(outcomes)
            for outcome in outcomes:
                status = Status(outcome.status).name
                log.write(f"{outcome.case_id} {status} {outcome.seconds:.3f} s {outcome.checksum} {outcome.error}\n")
            log.flush()

        try:
            with fan_out(job, interruption, workers, scheduler) as compute:
                suspects: list[Batch] = []
                for batch, outcomes in compute([[case.values for case in batch] for batch in batches]):
                    if outcomes is None:
                        suspects.append(batch)
                        continue
                    note(outcomes)
                    if len(outcomes) == len(batch):
                        progress.advance()
                # A worker that dies takes the cases that wait beside the guilty one along: each is tried alone.
                for batch in suspects:
                    for values in batch:
                        for _, outcomes in compute([[values]]):
                            note(outcomes if outcomes is not None else [_died(selection, folder, values)])
                    progress.advance()
        except KeyboardInterrupt:
            raise Interrupted(f"stopped at once; complete cases are stored: {_RESUME}") from None
        if len(stored) < total:
            raise Interrupted(f"interrupted with {len(stored)} of {total} cases computed: {_RESUME}")
    return [outcome for outcome in stored if outcome.status == Status.failed]


def _died(selection: Selection, folder: Folder, values: Mapping[str, int | str]) -> Outcome:
    reason = "the worker process died, again and again: out of memory, or a crash in compiled code"
    return record_failure(selection.study, folder.shards, selection.case(**values), reason)


def _host_facts() -> str:
    stamp = time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime())
    packages = ", ".join(f"{name} {version(name)}" for name in ("critflow", "numpy", "scipy"))
    return f"{stamp} {packages}, Python {platform.python_version()}, {platform.platform()}, {os.cpu_count()} CPUs"
