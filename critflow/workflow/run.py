"""One run of a study: plan the missing cases, compute and store them, write the dataset and its report.

The dataset contains the requested cases and all cases of the same settings that the folder already stores: fewer seeds
never shrink it.  Combinations of axis values that were never computed have the status `missing`.  Other parameters
replace the dataset; the cases of the former settings stay stored, and a run with these settings restores it.
"""

from __future__ import annotations

import math
import sys
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import groupby
from pathlib import Path

from critflow.calls import rename, running, say
from critflow.result import CritflowError, EnvironmentFailure, IntegrityError, Status, StudyError
from critflow.workflow.code import code_version
from critflow.workflow.dataset import Assembly, write_dataset
from critflow.workflow.folder import (
    CHANGED,
    DAMAGED,
    DONE,
    FAILED,
    MISSING,
    OTHER,
    CaseState,
    Folder,
    Note,
    reason_lines,
)
from critflow.workflow.load import StudyFile
from critflow.workflow.plan import LONGEST, Case, Selection, spelled
from critflow.workflow.provenance import environment, timestamp
from critflow.workflow.report import Report, ReportError, write_report
from critflow.workflow.store import delete_failure, refuse_sizes
from critflow.workflow.study import Study, plural
from critflow.workflow.tasks import Interrupted, Job
from critflow.workflow.workers import Task, Workers, compute, interruption

_RESUME = "run the same command again to resume"


@dataclass(frozen=True)
class RunPlan:
    """The cases that a run computes."""

    requested: Selection
    selection: Selection  # the cases of the dataset
    states: list[CaseState]
    todo: list[Case]
    messages: list[str]
    kept: int  # requested cases that are stored


@dataclass(frozen=True)
class RunResult:
    """The files and counts of a finished run."""

    dataset: Path | None  # None for a part that is not the last
    kept: int  # requested cases that were stored before
    failed: dict[str, str] = field(default_factory=dict)  # ids of requested cases, with reasons
    report: Report = field(default_factory=Report)
    messages: list[str] = field(default_factory=list)


def plan_run(folder: Folder, requested: Selection, retry_failed: bool, other: str = "refuse") -> RunPlan:
    """The cases to compute; every stored shard is read and verified.

    other  what to do with stored cases of other code: "refuse", "recompute" or "keep"

    Raises `IntegrityError` for such cases where they are refused.
    """
    selection, messages = _dataset_selection(folder, requested)
    states = folder.states(folder.part.within(selection) if folder.part else selection, read=True)
    if other == "refuse":
        _refuse_other_code(folder, requested.study, states)
    again = {DAMAGED, CHANGED, *([OTHER] if other == "recompute" else [])}
    wanted = {MISSING, *([FAILED] if retry_failed else [])}
    todo = [one.case for one in states if one.state in again or (one.state in wanted and _selects(requested, one.case))]
    kept = sum(_selects(requested, state.case) for state in states) - sum(_selects(requested, case) for case in todo)
    return RunPlan(requested, selection, states, todo, messages, kept)


def _refuse_other_code(folder: Folder, study: Study, states: Sequence[CaseState]) -> None:
    """Raise `IntegrityError` where stored cases were computed by other code."""
    if counts := Counter(one.reason for one in states if one.state == OTHER):
        stored = sum(one.record is not None for one in states)
        codes = "; ".join(f"{count} by {code}" for code, count in sorted(counts.items()))
        now = f"{codes}; now {code_version(study)}"
        raise IntegrityError(
            f"{counts.total()} of {plural(stored, 'stored case')} in {folder.path} were computed by other code ({now}):"
            " add --recompute to compute them again, --keep to keep them with the variable `code` in the dataset, or "
            "--out DIR for another folder"
        )


def run_study(
    loaded: StudyFile,
    requested: Selection,
    folder: Folder,
    workers: Workers,
    origin: Mapping[str, str],
    retry_failed: bool = False,
    other: str = "refuse",
) -> RunResult:
    """Compute the cases that are not stored, then write the dataset and its report.

    origin  attributes of the dataset, as in `write_dataset`
    other   as in `plan_run`

    Raises `Interrupted` if the run is stopped.
    """
    with folder.locked(loaded):
        plan = plan_run(folder, requested, retry_failed, other)
        folder.write_note(loaded, plan.selection)
        for case in plan.todo:
            delete_failure(folder.failed, case)
        _compute(loaded, plan, folder, workers)
        if folder.part is None:
            return _finish(plan, folder, origin)
        states = folder.states(plan.selection)
        if others := sum(one.state == MISSING for one in states):
            message = f"{others} cases of other parts are missing: the last part writes the dataset"
        else:
            with folder.merging() as last:
                if last:
                    return _finish(plan, folder, origin)
            message = "another run writes the dataset of all parts"
        own = {state.case.id for state in plan.states}
        failed = {one.case.id: one.reason for one in states if one.state == FAILED and one.case.id in own}
        return RunResult(None, plan.kept, failed, messages=[message])


def write_partial_dataset(folder: Folder, origin: Mapping[str, str]) -> str:
    """Write a dataset of the values of the first axis whose cases are all stored; the number of them in a sentence.

    Raises `StudyError` where none is complete.
    """
    loaded, selection = folder.selection()
    with folder.locked(loaded):
        axis, states = selection.study.axes[0], folder.states(selection)
        open_values = {state.case.values[axis.name] for state in states if state.record is None}
        complete = tuple(value for value in selection.axes[axis.name] if value not in open_values)
        sizes = f"{len(complete)} of {axis.counted(len(selection.axes[axis.name]))}"
        if not complete:
            raise StudyError(f"no dataset and {sizes} complete in {folder.path}: {_RESUME}")
        partial = replace(selection, axes={**selection.axes, axis.name: complete})
        write_dataset(
            Assembly(partial, folder.shards, folder.states(partial)), folder.dataset(partial.study.name), origin
        )
    return f"{sizes} are complete: {_RESUME}"


def _dataset_selection(folder: Folder, requested: Selection) -> tuple[Selection, list[str]]:
    """The cases of the dataset, and messages about the dataset that it replaces.

    note of the last run     dataset of it    cases                      message
    none                     -                requested                  -
    damaged                  -                requested                  the damage
    with other settings      none             requested                  -
    with other settings      exists           requested                  its settings
    with the same settings   -                requested and stored       how many, if more than requested
    """
    try:
        note = folder.read_note()
    except IntegrityError as error:
        return requested, [f"{error}; the dataset will contain the requested cases only"]
    except StudyError:
        return requested, []
    # Cases of both have the same ids.
    study = requested.study
    settings = (study.version, dict(requested.parameters), study.selected, study.axis_names)
    if (note.version, note.parameters, note.variables, tuple(note.axes)) == settings:
        return _with_stored_cases(folder, requested, note)
    if not folder.dataset(requested.study.name).exists():
        return requested, []
    words = [f"{k}={spelled(v)}" for k, v in note.parameters.items() if requested.parameters.get(k) != v]
    words += [f"{a.key}={spelled(note.axes[a.name])}" for a in requested.study.axes if a.name in note.axes]
    words += [f"variables={spelled(note.variables) or 'all'}"] * (note.variables != requested.study.selected)
    words += [f"version {note.version} of the study"] * (note.version != requested.study.version)
    restore = "its cases stay stored, and a run with these settings restores it"
    return requested, [f"replaces the dataset of {'; '.join(words)}: {restore}"]


def _with_stored_cases(folder: Folder, requested: Selection, note: Note) -> tuple[Selection, list[str]]:
    """The requested cases and all that the folder stores with the same settings, with a message if these are more."""
    states = folder.states(replace(requested, axes=note.axes))
    stored = [one.case for one in states if one.record or one.state == FAILED]
    values = {name: {*chosen, *(case.values[name] for case in stored)} for name, chosen in requested.axes.items()}
    joined = replace(requested, axes={axis.name: axis.ordered(values[axis.name]) for axis in requested.study.axes})
    if joined.count > LONGEST:
        raise StudyError(f"the dataset would have {joined.count:,} cases: choose another folder with --out")
    if joined.axes == requested.axes:
        return joined, []
    return joined, [f"dataset contains {joined.sizes}: {requested.sizes} requested, the others were stored before"]


def _selects(selection: Selection, case: Case) -> bool:
    return all(case.values[name] in values for name, values in selection.axes.items())


def _compute(loaded: StudyFile, plan: RunPlan, folder: Folder, workers: Workers) -> None:
    """Compute the planned cases; `Interrupted` if some were not begun or finished."""
    study, first = plan.selection.study, plan.selection.study.axis_names[0]
    word = study.name if loaded.by_name else str(loaded.path)
    command = (word, f"--out={folder.path}-alone", "--retry-failed", *workers.options)
    seconds = workers.case_seconds if workers.processes or workers.remote else None
    parameters, path = dict(plan.selection.parameters), str(folder.path.absolute())
    code, digest = code_version(study), loaded.digest
    job = Job(str(loaded.path), digest, path, parameters, study.selected, command, code, seconds, folder.part)
    groups = groupby(plan.todo, lambda case: case.values[first])
    tasks: list[Task] = [[case.values for case in group] for _, group in groups]
    stored, sizes = 0, dict[str, int]()
    cases = f"{plural(len(plan.todo), 'case')} in {workers.place}"
    progress = _RunProgress(study.name, len(plan.todo))
    with running(study.name), open(folder.log, "a", encoding="utf-8") as log, interruption(folder.stop) as stopped:
        log.write(f"# {timestamp()} {code}; {environment()}; {cases}\n")
        for line in [*plan.messages, *reason_lines([s for s in plan.states if s.state in (DAMAGED, CHANGED)])]:
            say(f"critflow: {line}")
        if tasks:
            say(f"{study.name}: {study.axes[0].counted(len(tasks))}, {cases}")
        try:
            for outcomes in compute(job, tasks, workers, stopped) if tasks else ():
                stored += len(outcomes)
                for one in outcomes:
                    log.write(
                        f"{one.case_id} {Status(one.status).name} {one.seconds:.3f} s {one.checksum} {one.error}\n"
                    )
                    refuse_sizes(one.case_id, one.sizes, sizes)
                    sizes |= one.sizes
                log.flush()
                progress.count(stored)
        except KeyboardInterrupt:
            raise Interrupted(f"stopped at once; {_complete(plan, folder)}: {_RESUME}") from None
        except EnvironmentFailure as error:
            raise EnvironmentFailure(f"{_complete(plan, folder)}, but {error}") from error
    if stored < len(plan.todo):
        raise Interrupted(f"interrupted after {stored} of {len(plan.todo)} cases: {_RESUME}")


def _complete(plan: RunPlan, folder: Folder) -> str:
    """How many of the cases of a run are complete in its folder."""
    todo = {case.id for case in plan.todo}
    part = folder.part.within(plan.selection) if folder.part else plan.selection
    try:
        done = sum(one.state == DONE and one.case.id in todo for one in folder.states(part))
    except CritflowError:  # a disk that fails
        return "complete cases are stored"
    return f"{done} of {len(todo)} cases are complete"


def _finish(plan: RunPlan, folder: Folder, origin: Mapping[str, str]) -> RunResult:
    """Write the dataset of all stored cases, and its report."""
    study, states = plan.selection.study, folder.states(plan.selection)
    path = folder.dataset(study.name)
    say(f"{study.name}: writing the dataset of {plural(len(states), 'case')}")
    write_dataset(Assembly(plan.selection, folder.shards, states), path, origin)
    requested = {
        one.case.id: one.reason for one in states if one.state == FAILED and _selects(plan.requested, one.case)
    }
    messages = list[str]()
    if others := Counter(one.reason for one in states if one.state == OTHER):
        counts = "; ".join(f"{code}: {count} cases" for code, count in sorted(others.items()))
        messages = [f"cases of other code than {code_version(study)} are kept: {counts}: the variable `code` has them"]
    say(f"{study.name}: drawing the figures and testing the claims")
    try:
        report = write_report(study, folder)
    except ReportError as error:
        if not requested:
            raise
        report = Report()
        messages.append(str(error))
    return RunResult(path, plan.kept, requested, report, messages)


class _RunProgress:
    """Number of finished cases: in the line of the call on a terminal, in ten lines elsewhere."""

    def __init__(self, title: str, total: int):
        self.title, self.total, self.done, self.begun = title, total, 0, time.monotonic()
        self.on_terminal = sys.stderr.isatty()

    def count(self, done: int) -> None:
        """Show the cases of finished tasks."""
        seconds = time.monotonic() - self.begun
        left = seconds / done * (self.total - done) if done else math.nan
        cases = f"{self.title}: {done}/{self.total} cases"
        if self.on_terminal:
            rename(f"{cases} (about {left:.0f} s left)" if done else cases)
        elif done * 10 // self.total > self.done * 10 // self.total:
            say(f"{cases}, {f'about {left:.0f} s left' if done < self.total else f'in {seconds:.1f} s'}")
        self.done = done
