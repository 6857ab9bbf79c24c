"""One run of a study: plan the missing cases, compute and store them, write the dataset and its report.

The dataset contains the requested cases and all cases of the same settings that the folder already stores: fewer seeds
never shrink it.  Combinations of axis values that were never computed have the status `missing`.  Other parameters
replace the dataset; the cases of the former settings stay stored, and a run with these settings restores it.
"""

from __future__ import annotations

import math
import os
import signal
import sys
import threading
import time
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass, replace
from importlib import import_module
from itertools import groupby, takewhile
from pathlib import Path
from types import FrameType

from critflow.calls import rename, running, say
from critflow.engine.code_digest import StudyFile, code_version, environment, timestamp
from critflow.engine.dataset import Assembly, counted_cases, write_dataset
from critflow.engine.report import ReportError, write_report
from critflow.engine.settings import LONGEST, Case, Selection, Workers, spelled
from critflow.engine.store import (
    CHANGED,
    DAMAGED,
    DONE,
    FAILED,
    MISSING,
    OTHER,
    RESUME,
    CaseState,
    Folder,
    Interrupted,
    dataset_files,
    reason_lines,
    refuse_sizes,
)
from critflow.engine.study import plural
from critflow.engine.tasks import Job, compute_network
from critflow.result import CritflowError, EnvironmentFailure, IntegrityError, Status, StudyError


@dataclass(frozen=True)
class RunPlan:
    """The cases that a run computes."""

    selection: Selection  # the cases of the dataset
    states: list[CaseState]
    todo: list[Case]
    messages: list[str]
    requested: set[str]  # ids of the cases of the command, which may be fewer


def plan_run(folder: Folder, requested: Selection, retry_failed: bool, other: str) -> RunPlan:
    """The cases to compute; every stored shard is read and verified.

    other  what to do with stored cases of other code: "refuse", "recompute" or "keep"

    Raises `IntegrityError` for such cases where they are refused.
    """
    selection, messages = _dataset_selection(folder, requested)
    states = folder.states(selection)
    if other == "refuse" and (counts := Counter(one.reason for one in states if one.state == OTHER)):
        stored = plural(sum(one.record is not None for one in states), "stored case")
        codes = "; ".join(f"{count} by {code}" for code, count in sorted(counts.items()))
        now = f"{codes}; now {code_version(requested.study)}"
        raise IntegrityError(
            f"{counts.total()} of {stored} in {folder.path} were computed by other code ({now}):"
            " add --recompute to compute them again, --keep to keep them with the variable `code` in the dataset, or "
            "--out DIR for another folder"
        )
    again = {DAMAGED, CHANGED, *([OTHER] if other == "recompute" else [])}
    open_states = {MISSING, *([FAILED] if retry_failed else [])}
    # Sets: a search in lists would be quadratic, minutes at 10⁵ networks.
    axes = {name: set(values) for name, values in requested.axes.items()}
    mine = {one.case.id for one in states if all(one.case.values[name] in values for name, values in axes.items())}
    todo = [one.case for one in states if one.state in again or (one.state in open_states and one.case.id in mine)]
    return RunPlan(selection, states, todo, messages, mine)


def run_study(
    loaded: StudyFile,
    requested: Selection,
    folder: Folder,
    workers: Workers,
    origin: Mapping[str, str],
    retry_failed: bool,
    other: str,
) -> tuple[int, dict[str, str], tuple[list[str], list[str]]]:
    """Compute the cases that are not stored, then write the dataset and its report.

    origin  attributes of the dataset, as in `write_dataset`
    other   as in `plan_run`

    Returns the number of requested cases that were stored before, the ids of those that failed with their reasons, and
    the lines of `write_report`.  Raises `Interrupted` if the run is stopped.
    """
    study = requested.study
    with folder.locked(loaded):
        plan = plan_run(folder, requested, retry_failed, other)
        kept = len(plan.requested - {case.id for case in plan.todo})
        folder.write_note(loaded, plan.selection)
        for case in plan.todo:
            folder.delete_failure(case)
        _compute(loaded, plan, folder, workers)
        states, path = folder.states(plan.selection), folder.dataset(study.name)
        say(f"{study.name}: writing the dataset of {plural(len(states), 'case')}")
        write_dataset(Assembly(plan.selection, folder.shards, states, folder.word()), path, origin)
        if parts := dataset_files(path)[1:]:
            say(f"{study.name}: {len(parts) + 1} files {path.stem}-part*.nc, which xarray.open_mfdataset opens as one")
        failed = {one.case.id: one.reason for one in states if one.state == FAILED and one.case.id in plan.requested}
        if others := Counter(one.reason for one in states if one.state == OTHER):
            label = f"cases of other code than {code_version(study)} are kept: {counted_cases(others)}"
            say(f"critflow: {label}: the variable `code` has them")
        if len(libraries := Counter(one.record.environment for one in states if one.record)) > 1:
            counts = counted_cases(libraries)
            say(f"critflow: cases of different libraries ({counts}): the variable `environment` has them")
        say(f"{study.name}: drawing the figures and testing the claims")
        try:
            return kept, failed, write_report(study, folder)
        except ReportError as error:
            if not failed:
                raise
            say(f"critflow: {error}")
            return kept, failed, ([], [])


def write_partial_dataset(folder: Folder, origin: Mapping[str, str]) -> str:
    """Write a dataset of the values of the first axis whose cases are all stored; the number of them in a sentence.

    Raises `StudyError` where none is complete.
    """
    loaded, selection = folder.selection()
    with folder.locked(loaded):
        axis = selection.study.axes[0]
        unfinished = {one.case.values[axis.name] for one in folder.states(selection) if one.record is None}
        complete = tuple(value for value in selection.axes[axis.name] if value not in unfinished)
        sizes = f"{len(complete)} of {axis.counted(len(selection.axes[axis.name]))}"
        if not complete:
            raise StudyError(f"no dataset and {sizes} complete in {folder.path}: {RESUME}")
        partial = replace(selection, axes={**selection.axes, axis.name: complete})
        assembly = Assembly(partial, folder.shards, folder.states(partial), folder.word())
        write_dataset(assembly, folder.dataset(partial.study.name), origin)
    return f"{sizes} are complete: {RESUME}"


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
    study, before = requested.study, note["parameters"]
    settings = (study.version, dict(requested.parameters), study.selected, study.axis_names)
    if (note["version"], before, note["variables"], tuple(note["axes"])) == settings:
        # Cases of both have the same ids.
        states = folder.states(replace(requested, axes=note["axes"]))
        stored = [one.case.values for one in states if one.record or one.state == FAILED]
        axes = {axis.name: {*requested.axes[axis.name], *(v[axis.name] for v in stored)} for axis in study.axes}
        joined = replace(requested, axes={a.name: tuple(sorted(axes[a.name], key=a.place)) for a in study.axes})
        if joined.count > LONGEST:
            raise StudyError(f"the dataset would have {joined.count:,} cases: choose another folder with --out")
        more = f"dataset contains {joined.sizes}: {requested.sizes} requested, the others were stored before"
        return (joined, [more]) if joined.axes != requested.axes else (requested, [])
    if not dataset_files(folder.dataset(study.name)):
        return requested, []
    words = [f"{k}={spelled(v)}" for k, v in before.items() if requested.parameters.get(k) != v]
    words += [f"{a.key}={spelled(note['axes'][a.name])}" for a in study.axes if a.name in note["axes"]]
    words += [f"variables={spelled(note['variables']) or 'all'}"] * (note["variables"] != study.selected)
    words += [f"version {note['version']} of the study"] * (note["version"] != study.version)
    return requested, [
        f"replaces the dataset of {'; '.join(words)}: its cases stay stored, and a run with these settings restores it"
    ]


def _compute(loaded: StudyFile, plan: RunPlan, folder: Folder, workers: Workers) -> None:
    """Compute the planned cases, one network a task; `Interrupted` if some were not begun or finished."""
    study, todo, stored, sizes = plan.selection.study, plan.todo, 0, dict[str, int]()
    first, code, remote = study.axis_names[0], code_version(study), bool(workers.processes or workers.scheduler)
    word = study.name if loaded.by_name else str(loaded.path)
    job = Job(
        str(loaded.path),
        loaded.digest,
        str(folder.path.absolute()),
        dict(plan.selection.parameters),
        study.selected,
        (word, f"--out={folder.path}-alone", "--retry-failed", *workers.options),
        code,
        workers.case_seconds if remote else None,
    )
    groups = groupby(todo, lambda case: case.values[first])
    tasks = [[case.values for case in group] for _, group in groups]
    cases, begun = f"{plural(len(todo), 'case')} in {workers.place}", time.monotonic()
    with running(study.name), open(folder.log, "a", encoding="utf-8") as log, interruption(folder.stop) as stopped:
        log.write(f"# {timestamp()} {code}; {environment()}; {cases}\n")
        for line in [*plan.messages, *reason_lines([s for s in plan.states if s.state in (DAMAGED, CHANGED)])]:
            say(f"critflow: {line}")
        if tasks:
            say(f"{study.name}: {study.axes[0].counted(len(tasks))}, {cases}")
        if remote and tasks:  # a run in this process needs no import of dask's scheduler
            ended = import_module(f"{__package__}.dask_workers").compute_in_workers(job, tasks, workers, stopped)
        else:
            ended = (compute_network(job, task) for task in takewhile(lambda _: not stopped.is_set(), tasks))
        try:
            with closing(ended):  # workers end before their cases are counted
                for outcomes in ended:
                    for one in outcomes:
                        status = Status(one.status).name
                        log.write(f"{one.case_id} {status} {one.seconds:.3f} s {one.checksum} {one.error}\n")
                        refuse_sizes(one.case_id, one.sizes, sizes)
                        sizes |= one.sizes
                    log.flush()
                    stored += len(outcomes)
                    _show(study.name, stored - len(outcomes), stored, len(todo), time.monotonic() - begun)
        except KeyboardInterrupt:
            raise Interrupted(f"stopped at once; {_complete(plan, folder)}: {RESUME}") from None
        except EnvironmentFailure as error:
            raise EnvironmentFailure(f"{_complete(plan, folder)}, but {error}") from error
    if stored < len(todo):
        raise Interrupted(f"interrupted after {stored} of {len(todo)} cases: {RESUME}")


def _complete(plan: RunPlan, folder: Folder) -> str:
    """How many of the cases of a run are complete in its folder."""
    todo = {case.id for case in plan.todo}
    try:
        done = sum(one.state == DONE and one.case.id in todo for one in folder.states(plan.selection))
    except CritflowError:  # a disk that fails
        return "complete cases are stored"
    return f"{done} of {len(todo)} cases are complete"


@contextmanager
def interruption(stop: Path) -> Iterator[threading.Event]:
    """An event that the first Ctrl-C or SIGTERM sets: running cases finish and no other begins.

    Workers look for the file `stop` before each case.  A second signal raises `KeyboardInterrupt`.
    """
    requested = threading.Event()

    def request(number: int, frame: FrameType | None) -> None:
        if requested.is_set():
            raise KeyboardInterrupt
        requested.set()
        with suppress(OSError):
            stop.touch()
        # Not through the console: the interrupted line may own its lock.
        os.write(2, b"\nstopping: running cases finish and are stored; press Ctrl-C again to stop at once\n")

    main = threading.current_thread() is threading.main_thread()  # signals are handled only there
    before = {number: signal.signal(number, request) for number in (signal.SIGINT, signal.SIGTERM) if main}
    try:
        yield requested
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _show(title: str, before: int, done: int, total: int, seconds: float) -> None:
    """Show the number of finished cases: in the line of the call on a terminal, in ten lines elsewhere."""
    left = seconds / done * (total - done) if done else math.nan
    cases = f"{title}: {done}/{total} cases"
    if sys.stderr.isatty():
        rename(f"{cases} (about {left:.0f} s left)" if done else cases)
    elif done * 10 // total > before * 10 // total:
        say(f"{cases}, {f'about {left:.0f} s left' if done < total else f'in {seconds:.1f} s'}")
