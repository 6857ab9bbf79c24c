"""A results folder: where things are, which study and settings it belongs to, and who is at work in it."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from critflow.result import EnvironmentFailure, IntegrityError, StudyError
from critflow.workflow.errors import LockedError
from critflow.workflow.load import StudyFile, load_file, load_study
from critflow.workflow.plan import Selection
from critflow.workflow.store import PARTIAL, write_text

if os.name == "posix":
    import fcntl


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
            lock = open(self.path / ".lock", "a")
        except OSError as error:
            reason = f"{error.strerror}: choose another folder with --out"
            raise EnvironmentFailure(f"cannot write in {self.path}: {reason}") from error
        with lock:
            if os.name == "posix":
                try:
                    fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                except BlockingIOError:
                    raise LockedError(f"another run is at work in {self.path}: wait for it, or choose --out") from None
            for left_over in self.path.rglob(f".*{PARTIAL}"):  # of a run that was killed while it wrote
                left_over.unlink(missing_ok=True)
            self._write_note(loaded, selection)
            yield

    def refuse_other(self, loaded: StudyFile) -> None:
        """Raise unless the folder is new or belongs to this study."""
        if self.path.exists() and not self.path.is_dir():
            raise EnvironmentFailure(f"{self.path} is a file: give a folder with --out")
        owner = self._read_note()["study"] if self.note.exists() else loaded.study.name
        if owner != loaded.study.name:
            raise StudyError(
                f"{self.path} holds study {owner!r}, not {loaded.study.name!r}: choose another folder with --out"
            )

    def selection(self) -> tuple[StudyFile, Selection]:
        """The study and the settings of the last run here."""
        if not self.note.exists():
            raise StudyError(f"{self.path} is not a results folder: it has no study.json, which `critflow run` writes")
        note = self._read_note()
        file = note["file"]
        loaded = load_study(note["study"]) if file is None else load_file(self.path / file)
        parameters = {k: tuple(v) if isinstance(v, list) else v for k, v in note["parameters"].items()}
        axes = {name: tuple(values) for name, values in note["axes"].items()}
        if set(parameters) != set(loaded.study.parameters) or tuple(axes) != loaded.study.axis_names:
            raise StudyError(f"study {loaded.study.name!r} has other settings now than {self.path}: run it again there")
        known = [variable.name for variable in loaded.study.variables]
        if not set(note["variables"]) <= set(known):
            raise StudyError(
                f"study {loaded.study.name!r} has other variables now than {self.path}: run it again there"
            )
        return loaded, Selection(loaded.study.storing(note["variables"]), parameters, axes)

    def _write_note(self, loaded: StudyFile, selection: Selection) -> None:
        note = {
            "study": loaded.study.name,
            "file": None if loaded.by_name else os.path.relpath(loaded.path, self.path.absolute()),
            "axes": selection.axes,
            "parameters": selection.parameters,
            "variables": selection.study.selected,
        }
        write_text(self.note, json.dumps(note, indent=1) + "\n")

    def _read_note(self) -> dict:
        try:
            note = json.loads(self.note.read_text(encoding="utf-8"))
            note.setdefault("variables", [])  # all
            return {key: note[key] for key in ("study", "file", "axes", "parameters", "variables")}
        except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
            raise IntegrityError(f"{self.note} is not readable: delete it and run the study again") from error
