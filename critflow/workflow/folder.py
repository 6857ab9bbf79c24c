"""A results folder: its files, its lock, the note about its study and settings, and the state of its cases.

    study.json            the note: study, settings, version, file
    shards/seed3-HASH.nc  the complete cases of one value of the first axis
    failed/CASE_ID.txt    a failed case: the command that runs it alone, its parameters, its traceback
    NAME.nc  figures/  claims.md  claims.json  summary.json  run.log  .lock

A shard counts before a failed text of the same case.  The existence of a failed text alone says that the case failed:
its contents are for the reader, and damage in them changes no result.
"""

from __future__ import annotations

import json
import os
import platform
import re
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from hashlib import sha256
from pathlib import Path
from typing import Any, NamedTuple

from filelock import FileLock, Timeout

from critflow.result import CritflowError, EnvironmentFailure, InputError, IntegrityError, StudyError
from critflow.workflow.code import code_version
from critflow.workflow.load import StudyFile, load_file, load_study
from critflow.workflow.plan import Case, Selection
from critflow.workflow.store import (
    PARTIAL,
    SCHEMA_VERSION,
    OtherTable,
    Record,
    failure_reason,
    read_records,
    write_text,
)
from critflow.workflow.study import Study

DONE, FAILED, MISSING, DAMAGED, CHANGED = ("done", "failed", "missing", "damaged", "changed")
OTHER = "other"  # complete, computed by other code

_PATIENCE = 5.0  # seconds: parts that begin or end hold the lock of the whole for a moment


class OldFolderError(InputError):
    """The folder was written by another schema."""


class LockedError(CritflowError):
    """Another run is active in the folder."""


class CaseState(NamedTuple):
    """A case and its state; the reason explains every state but `done`, of `other` it is the code."""

    case: Case
    state: str
    reason: str = ""
    record: Record | None = None  # of a complete case


@dataclass(frozen=True)
class Part:
    """One of several runs that share a folder: of n parts, the i-th has every n-th value of the first axis."""

    i: int  # from 1
    n: int

    @classmethod
    def of(cls, text: str) -> Part | None:
        """The part i/n of a text, None if it is empty."""
        if not text:
            return None
        i, n = map(int, text.split("/")) if re.fullmatch("[0-9]{1,6}/[0-9]{1,6}", text) else (0, 0)
        if not 1 <= i <= n:
            raise InputError(f"--part {text} must be i/n with i from 1 to n, as in --part 1/4")
        return cls(i, n)

    def __str__(self) -> str:
        return f"-{self.i}-of-{self.n}"

    def within(self, selection: Selection) -> Selection:
        """The cases of this part."""
        first = selection.study.axis_names[0]
        return replace(selection, axes={**selection.axes, first: selection.axes[first][self.i - 1 :: self.n]})


@dataclass(frozen=True)
class Note:
    """The note of the last run in a folder."""

    schema_version: int
    study: str
    version: int
    file: str | None  # relative to the folder; None for a named study
    parameters: dict[str, Any]
    axes: dict[str, tuple]
    variables: tuple[str, ...]
    table: str  # digest of the table of variables
    code: str


class Folder:
    """Paths of one results folder."""

    def __init__(self, path: Path, part: Part | None = None):
        self.path, self.part = path, part
        self.shards, self.failed, self.figures = path / "shards", path / "failed", path / "figures"
        self.note, self.log = path / "study.json", path / "run.log"
        self.stop = path / f".stop{part or ''}"  # if it exists, workers begin no further case

    def dataset(self, study: str) -> Path:
        return self.path / f"{study}.nc"

    def trace(self, case: Case) -> Path:
        return self.failed / f".{case.id}.trace"

    @contextmanager
    def locked(self, loaded: StudyFile) -> Iterator[None]:
        """Exclude other runs; a run of the whole folder also deletes temporary files of runs that were killed.

        A part excludes itself and runs of the whole, which exclude all parts.  The lock is released by the end of the
        process.  Raises `LockedError` if another run is active.
        """
        self.check_owner(loaded)
        lock, whole = self._lock(str(self.part or "")), self._lock("")
        try:
            for folder in (self.shards, self.failed, self.figures):
                folder.mkdir(parents=True, exist_ok=True)
            holder = Path(lock.lock_file)
            lock.acquire()
            holder.write_text(f"process {os.getpid()} on {platform.node()} since {time.ctime()}\n")
            for other in [whole] if self.part else [self._lock(file.name[5:]) for file in self.path.glob(".lock?*")]:
                holder = Path(other.lock_file)
                with other.acquire(timeout=_PATIENCE):  # free: nobody else holds it
                    pass
            if not self.part:
                for path in (self.path, self.shards, self.failed, self.figures):
                    for pattern in (f".*{PARTIAL}", ".*.trace", ".stop*", ".dask-jobqueue.*"):
                        for file in path.glob(pattern):
                            file.unlink(missing_ok=True)
        except Timeout:
            lock.release()
            name = holder.read_text(errors="replace")[:200].strip()
            advice = "wait for its end, or choose another folder with --out"
            raise LockedError(f"another run is active in {self.path} ({name or 'unknown process'}): {advice}") from None
        except (OSError, NotImplementedError) as error:
            reason = f"{getattr(error, 'strerror', None) or error}: choose another folder with --out"
            raise EnvironmentFailure(f"cannot write in {self.path}: {reason}") from error
        try:
            yield
        finally:
            self.stop.unlink(missing_ok=True)
            lock.release()

    @contextmanager
    def merging(self) -> Iterator[bool]:
        """Whether this part has the lock of the whole, to write the dataset of all parts."""
        try:
            with self._lock("").acquire(timeout=_PATIENCE):
                yield True
        except Timeout:
            yield False

    def _lock(self, suffix: str) -> FileLock:
        return FileLock(self.path / f".lock{suffix}", timeout=0, mode=0o660)  # every reader could lock it

    def check_owner(self, loaded: StudyFile) -> None:
        """Raise unless the folder is new or belongs to this study."""
        if self.path.exists() and not self.path.is_dir():
            raise EnvironmentFailure(f"{self.path} is a file: give a folder with --out")
        try:
            owner = self.read_note().study if self.note.exists() else loaded.study.name
        except IntegrityError:  # `run` reports it
            return
        if owner != loaded.study.name:
            contents = f"{self.path} contains study {owner!r}, not {loaded.study.name!r}"
            raise StudyError(f"{contents}: choose another folder with --out")

    def write_note(self, loaded: StudyFile, selection: Selection) -> None:
        study = selection.study
        file = None if loaded.by_name else os.path.relpath(loaded.path, self.path.absolute())
        settings = (dict(selection.parameters), dict(selection.axes), study.selected)
        note = Note(SCHEMA_VERSION, study.name, study.version, file, *settings, study.table_digest, code_version(study))
        write_text(self.note, _note_text(vars(note)))

    def read_note(self) -> Note:
        """The note; `IntegrityError` if it is damaged, `StudyError` if it does not exist."""
        if not self.note.exists():
            raise StudyError(f"{self.path} is not a results folder: it has no study.json, which `critflow run` writes")
        try:
            text = self.note.read_text(encoding="utf-8") if self.note.is_file() else "null"
            note = json.loads(text)
            if text != _note_text({key: value for key, value in note.items() if key != "sha256"}):
                raise ValueError("it does not match its checksum")
            if (version := note["schema_version"]) != SCHEMA_VERSION:
                raise OldFolderError(
                    f"{self.path} contains results of schema {version}, not {SCHEMA_VERSION}: its files stay as they "
                    f"are; compute into a new folder with --out {self.path}-new, or convert its dataset by "
                    "docs/howto/dataset.md (Files of schema 3)"
                )
        except OSError as error:
            raise EnvironmentFailure(f"cannot read {self.note}: {error.strerror}: correct this first") from error
        except OldFolderError:
            raise
        except (ValueError, TypeError, LookupError, AttributeError, RecursionError) as error:
            raise IntegrityError(f"{self.note} is damaged: {error}: run the study again to write it") from error
        del note["sha256"]
        parameters = {k: tuple(v) if isinstance(v, list) else v for k, v in note.pop("parameters").items()}
        axes = {name: tuple(values) for name, values in note.pop("axes").items()}
        return Note(parameters=parameters, axes=axes, variables=tuple(note.pop("variables")), **note)

    def selection(self) -> tuple[StudyFile, Selection]:
        """The study of the note, and the cases of its dataset."""
        note = self.read_note()
        loaded = load_study(note.study) if note.file is None else load_file(self.path / note.file)
        study = loaded.study
        variables = {variable.name for variable in study.variables}
        needed = {key for key, default in study.parameters.items() if default != ""}
        same = needed <= set(note.parameters) <= set(study.parameters) and tuple(note.axes) == study.axis_names
        if not same or not set(note.variables) <= variables:
            raise StudyError(f"study {study.name!r} has other settings now than {self.path}: run it again there")
        return loaded, Selection(study.storing(note.variables), note.parameters, note.axes)

    def states(self, selection: Selection, read: bool = False) -> list[CaseState]:
        """State of every case: the single decision whether a case is stored.

        read  every shard is read and verified to the last byte; without it only the list of its cases
        """
        study, code = selection.study, code_version(selection.study)
        shards, failed = _names(self.shards, ".nc"), _names(self.failed, ".txt")
        states, records, trouble, last = list[CaseState](), dict[str, Record](), None, ""
        for case in selection.cases():
            if case.shard != last:
                last = case.shard
                records, trouble = self._records(study, case, read) if last in shards else ({}, None)
            if trouble:
                states.append(CaseState(case, *trouble))
            elif record := records.get(case.id):
                state = (DONE, "") if record.code == code else (OTHER, record.code)
                states.append(CaseState(case, *state, record))
            elif case.id in failed and (reason := failure_reason(self.failed, case)):
                states.append(CaseState(case, FAILED, reason))
            else:
                states.append(CaseState(case, MISSING, "not computed yet"))
        return states

    def _records(self, study: Study, case: Case, read: bool) -> tuple[dict[str, Record], tuple[str, str] | None]:
        """The cases in the shard of a case, or the state of all of them and its reason where it cannot be used."""
        try:
            return read_records(self.shards, study, case, verified=read), None
        except OtherTable:
            return {}, (CHANGED, "stored with another table of variables")
        except IntegrityError as error:
            return {}, (DAMAGED, str(error).rpartition(" is damaged: ")[2])


def reason_lines(states: list[CaseState], most: int = 20) -> list[str]:
    """One line for each state and reason, without the cases that are done."""
    groups: dict[tuple[str, str], list[Case]] = {}
    for case, state, reason, _ in states:
        if state != DONE:
            groups.setdefault((state, reason), []).append(case)
    lines = []
    for (state, reason), cases in groups.items():
        first = ", ".join(f"{name} {value}" for name, value in cases[0].values.items())
        others = f" and {len(cases) - 1} more" if len(cases) > 1 else ""
        lines.append(f"{state}: {first}{others}: {reason}")
    return lines if len(lines) <= most else [*lines[:most], f"and {len(lines) - most} more reasons"]


def _names(folder: Path, suffix: str) -> set[str]:
    try:
        return {name.removesuffix(suffix) for name in os.listdir(folder) if name.endswith(suffix)}
    except FileNotFoundError:
        return set()


def _note_text(note: dict[str, Any]) -> str:
    """The file of a note, which contains its checksum."""
    checksum = sha256(json.dumps(note, sort_keys=True).encode()).hexdigest()
    return json.dumps(note | {"sha256": checksum}, indent=1) + "\n"
