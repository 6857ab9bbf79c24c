"""A results folder: where things are, which study and settings it belongs to, and who is at work in it."""

from __future__ import annotations

import json
import math
import os
import platform
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import IO, Any, NamedTuple

from critflow.result import EnvironmentFailure, IntegrityError, StudyError
from critflow.workflow.errors import LockedError
from critflow.workflow.load import StudyFile, is_unchanged, load_file, load_study, named_studies
from critflow.workflow.plan import LONGEST, Named, Plan, Selection
from critflow.workflow.provenance import code_version, library_version
from critflow.workflow.store import PARTIAL, SCHEMA_VERSION, write_text
from critflow.workflow.study import Axis

if os.name == "posix":
    import fcntl

_ANEW = "run the study again to write it anew"


class Noted(NamedTuple):
    """What can be told of the last run in a folder without its study."""

    plan: Plan  # a `Selection` where the study had to be loaded
    table: str  # digest of the table of variables, as of now
    code: str  # what computes a case, as of now


@dataclass(frozen=True)
class Folder:
    """Paths of one results folder."""

    path: Path

    @property
    def shards(self) -> Path:
        return self.path / "shards"

    @property
    def figures(self) -> Path:
        return self.path / "figures"

    @property
    def log(self) -> Path:
        return self.path / "run.log"

    @property
    def index(self) -> Path:
        return self.path / "shards.index"

    @property
    def note(self) -> Path:
        return self.path / "study.json"

    def dataset(self, study: str) -> Path:
        return self.path / f"{study}.nc"

    @contextmanager
    def held(self, loaded: StudyFile, selection: Selection) -> Iterator[None]:
        """Make the folder ready for this study and keep other runs out of it; the lock dies with its process."""
        self.refuse_other(loaded)
        try:
            self.shards.mkdir(parents=True, exist_ok=True)
            lock = open(self.path / ".lock", "ab+", buffering=0, opener=_not_for_others)
        except OSError as error:
            reason = f"{error.strerror}: choose another folder with --out"
            raise EnvironmentFailure(f"cannot write in {self.path}: {reason}") from error
        with lock:
            self._take(lock)
            try:
                for folder in (self.path, self.shards, self.figures):
                    for left_over in folder.glob(f".*{PARTIAL}"):  # of a run that was killed while it wrote
                        left_over.unlink(missing_ok=True)
                self._write_note(loaded, selection)
                yield
            finally:
                os.ftruncate(lock.fileno(), 0)

    def _take(self, lock: IO[bytes]) -> None:
        """Lock the file, or say who has it."""
        if os.name == "posix":
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                lock.seek(0)
                holder = lock.read(200).decode(errors="replace").strip()
                raise LockedError(
                    f"another run is at work in {self.path}{f', {holder}' if holder else ''}: "
                    "wait for it, or choose another folder with --out"
                ) from None
            except OSError as error:
                reason = f"{error.strerror}: choose a folder on another disk with --out"
                raise EnvironmentFailure(f"cannot lock {self.path}: {reason}") from error
        since = time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime())
        try:
            lock.truncate(0)
            lock.write(f"process {os.getpid()} on {platform.node()} since {since}\n".encode())
        except OSError as error:
            reason = f"{error.strerror}: make room there, or choose another folder with --out"
            raise EnvironmentFailure(f"cannot write in {self.path}: {reason}") from error

    def refuse_other(self, loaded: StudyFile) -> None:
        """Raise unless the folder is new or belongs to this study."""
        if self.path.exists() and not self.path.is_dir():
            raise EnvironmentFailure(f"{self.path} is a file: give a folder with --out")
        try:
            owner = self._read_note()["study"] if self.note.exists() else loaded.study.name
        except IntegrityError:  # nobody can say whose it was, and what a run stores carries the name of its study
            return
        if owner != loaded.study.name:
            raise StudyError(
                f"{self.path} holds study {owner!r}, not {loaded.study.name!r}: choose another folder with --out"
            )

    def selection(self) -> tuple[StudyFile, Selection]:
        """The study and the settings of the last run here."""
        note = self._note_of_a_run()
        file = note["file"]
        loaded = load_study(note["study"]) if file is None else load_file(self.path / file)
        parameters, axes = _settings(note)
        if set(parameters) != set(loaded.study.parameters) or tuple(axes) != loaded.study.axis_names:
            raise StudyError(f"study {loaded.study.name!r} has other settings now than {self.path}: run it again there")
        for key, default in loaded.study.parameters.items():
            if _kind(parameters[key]) != _kind(default):
                raise IntegrityError(f"{self.note} has {key} = {parameters[key]!r}: {_ANEW}")
        known = [variable.name for variable in loaded.study.variables]
        if not set(note["variables"]) <= set(known):
            raise StudyError(
                f"study {loaded.study.name!r} has other variables now than {self.path}: run it again there"
            )
        return loaded, Selection(loaded.study.storing(note["variables"]), parameters, axes)

    def noted(self) -> Noted:
        """The last run here; its study is loaded only when something that it is made of is not as it was then."""
        note = self._note_of_a_run()
        path = named_studies().get(note["study"]) if note["file"] is None else self.path / note["file"]
        same = note["code"].startswith(f"{library_version()}, ")
        if path is None or not same or not is_unchanged(path, note["files"]):
            _, selection = self.selection()
            return Noted(selection, selection.study.table_digest, code_version(selection.study))
        named = Named(note["study"], note["study_version"], tuple(note["variables"]))
        return Noted(Plan(named, *_settings(note)), note["table"], note["code"])

    def _write_note(self, loaded: StudyFile, selection: Selection) -> None:
        note = {
            "schema_version": SCHEMA_VERSION,
            "study": loaded.study.name,
            "study_version": loaded.study.version,
            "file": None if loaded.by_name else os.path.relpath(loaded.path, self.path.absolute()),
            "axes": selection.axes,
            "parameters": selection.parameters,
            "variables": selection.study.selected,
            "table": selection.study.table_digest,
            "code": code_version(selection.study),
            "files": loaded.files,
        }
        write_text(self.note, _note_text(note))

    def _note_of_a_run(self) -> dict:
        if not self.note.exists():
            raise StudyError(f"{self.path} is not a results folder: it has no study.json, which `critflow run` writes")
        return self._read_note()

    def _read_note(self) -> dict:
        """What a run wrote of itself, when it is whole and says what a run says."""
        try:
            if not self.note.is_file():
                raise ValueError("it is not a file")
            text = self.note.read_text(encoding="utf-8")
            note = json.loads(text)
            del note["sha256"]
            if text != _note_text(note):
                raise ValueError("it does not match its checksum")
            if note["schema_version"] != SCHEMA_VERSION:
                raise ValueError(f"its schema_version is {note['schema_version']}, not {SCHEMA_VERSION}")
            return _checked(note)
        except OSError as error:
            raise EnvironmentFailure(f"cannot read {self.note}: {error.strerror}: mend that and run again") from error
        except (ValueError, LookupError, TypeError, AttributeError, RecursionError) as error:
            raise IntegrityError(f"{self.note} is not readable: {error}: {_ANEW}") from error


def _not_for_others(path: str, flags: int) -> int:
    """Open the lock: whoever may read it may hold it, and keep its owner out for ever."""
    return os.open(path, flags, 0o660)


def _note_text(note: dict[str, Any]) -> str:
    """What the file says: the note and its checksum."""
    checksum = sha256(json.dumps(note, sort_keys=True).encode()).hexdigest()
    lines = [f" {json.dumps(key)}: {json.dumps(value)}" for key, value in (note | {"sha256": checksum}).items()]
    return "{\n" + ",\n".join(lines) + "\n}\n"


def _settings(note: dict[str, Any]) -> tuple[dict[str, Any], dict[str, tuple]]:
    """Parameters and axes; lists in JSON are tuples here."""
    parameters = {key: tuple(value) if isinstance(value, list) else value for key, value in note["parameters"].items()}
    return parameters, {name: tuple(values) for name, values in note["axes"].items()}


def _kind(value: Any) -> tuple[type, ...]:
    return (tuple, *{type(item) for item in value}) if isinstance(value, tuple) else (type(value),)


def _checked(note: dict) -> dict:
    """The note, unless something in it is of a type or a size that no run writes: a checksum is no secret."""
    for name, values in note["axes"].items():
        if not isinstance(values, list):
            raise ValueError(f"its {name!r} is not a list")
        Axis(name, values, "")  # refuses what is no axis
    if math.prod(len(values) for values in note["axes"].values()) > LONGEST:
        raise ValueError(f"it has more than {LONGEST:,} cases")
    texts = [note["study"], note["table"], note["code"], *note["variables"], *note["files"], *note["files"].values()]
    texts += [] if note["file"] is None else [note["file"]]
    if not all(isinstance(text, str) and "\0" not in text for text in texts):
        raise ValueError("its names are not text")
    if type(note["study_version"]) is not int:
        raise ValueError("its study_version is not a number")
    if not isinstance(note["parameters"], dict):
        raise ValueError("its parameters have no names")
    return note
