"""Why cases of a folder are to be computed again, and which of the stored ones were computed by other code."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from critflow.result import IntegrityError
from critflow.workflow.plan import Case, Selection
from critflow.workflow.provenance import code_version
from critflow.workflow.status import FolderStatus
from critflow.workflow.store import read_code, read_identity, read_shard, shard_path

_DIGEST = 17  # the hash at the end of an id, with its hyphen


@dataclass(frozen=True)
class Reason:
    """Cases that share one reason."""

    kind: str  # missing, changed, failed, damaged; "other code" of cases that stand
    sentence: str
    cases: Sequence[Case]

    def line(self) -> str:
        first = ", ".join(f"{name} {value}" for name, value in self.cases[0].values.items())
        others = f" and {len(self.cases) - 1} more" if len(self.cases) > 1 else ""
        return f"{self.kind}: {first}{others}: {self.sentence}"

    def plain(self) -> dict[str, Any]:
        """For `--json`."""
        cases = [{"id": case.id, **case.values} for case in self.cases]
        return {"kind": self.kind, "sentence": self.sentence, "cases": cases}


def reasons_to_compute(selection: Selection, shards: Path, todo: Iterable[Case]) -> list[Reason]:
    """Why each of these cases has no good shard, the cases with the same reason together."""
    todo = list(todo)
    if not todo:
        return []
    found: dict[tuple[str, str], list[Case]] = {}
    others = _Others(selection, shards)
    for case in todo:
        found.setdefault(_why(selection, shards, case, others), []).append(case)
    return [Reason(kind, sentence, cases) for (kind, sentence), cases in found.items()]


def made_by_other_code(found: FolderStatus, shards: Path) -> list[Reason]:
    """Stored cases that the code of now did not compute; they stand, since most changes of code change no number."""
    now = code_version(found.selection.study)
    advice = "kept; to compute them anew, raise the study's version or choose another folder"
    reasons = []
    for cases in found.of_other_code:
        try:
            code = read_code(shard_path(shards, cases[0]))
        except IntegrityError:  # deleted in this moment
            continue
        reasons.append(Reason("other code", f"computed by {code}, not {now}: {advice}", cases))
    return reasons


def _why(selection: Selection, shards: Path, case: Case, others: _Others) -> tuple[str, str]:
    try:
        shard = read_shard(shards, selection.study, case)
    except IntegrityError as error:
        path = shard_path(shards, case)
        return "damaged", str(error).removeprefix(f"{path} ").replace(str(path), path.name)
    if shard is not None:
        return "failed", (shard.error.strip() or "without a word").splitlines()[-1]
    difference = others.difference(case)
    return ("changed", f"stored with {difference}") if difference else ("missing", "not computed yet")


class _Others:
    """Shards of the same axis values as a case, computed with other settings or by another version of the study."""

    def __init__(self, selection: Selection, shards: Path):
        self._shards, self._selection = shards, selection
        present = os.listdir(shards) if shards.is_dir() else []
        here = {f"{case.id}.nc" for case in selection.cases()} if present else set()
        self._names = {name for name in present if name.endswith(".nc") and name not in here}
        self._readable: dict[str, list[str]] = {}
        for name in sorted(self._names):
            self._readable.setdefault(name.removesuffix(".nc")[:-_DIGEST], []).append(name)
        self._known: list[tuple[int, Mapping[str, Any], tuple[str, ...]]] = []  # of each setting one shard is read

    def difference(self, case: Case) -> str:
        """What such a shard has that the case has not; nothing where there is no such shard."""
        for version, parameters, variables in self._known:
            if f"{Case(case.study, version, parameters, case.values, variables).id}.nc" in self._names:
                return self._told(version, parameters, variables)
        for name in self._readable.get(case.readable, ()):
            setting = _setting(self._shards / name)
            if setting is not None and setting not in self._known:
                self._known.append(setting)
                return self._told(*setting)
        return ""

    def _told(self, version: int, parameters: Mapping[str, Any], variables: tuple[str, ...]) -> str:
        study, now = self._selection.study, self._selection.parameters
        told = [f"version {version} of the study, now {study.version}"] if version != study.version else []
        for key in sorted({*parameters, *now}):
            before, after = (_word(settings.get(key, "unset")) for settings in (parameters, now))
            if before != after:
                told.append(f"{key}={before}, now {after}")
        if tuple(variables) != study.selected:
            told.append(f"variables={','.join(variables) or 'all'}, now {','.join(study.selected) or 'all'}")
        return "; ".join(told)


def _word(value: Any) -> str:
    return ",".join(map(str, value)) if isinstance(value, list | tuple) else str(value)


def _setting(path: Path) -> tuple[int, Mapping[str, Any], tuple[str, ...]] | None:
    """Version, parameters and variables that a shard says it has."""
    try:
        _, version, parameters, _, *variables = json.loads(read_identity(path))
    except IntegrityError:  # someone else's, or damaged: no case of this run needs it
        return None
    return version, parameters, tuple(*variables)
