"""Why cases of a folder are to be computed again, and which of the stored ones were computed by other code."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from critflow.result import IntegrityError
from critflow.workflow.plan import Case, Cases, Plan
from critflow.workflow.store import read_code, read_identity, shard_path

Why = tuple[str, str]  # kind and sentence of a reason
OTHER_TABLE: Why = ("changed", "stored with another table of variables")

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


def failed(words: str) -> Why:
    return "failed", words.strip() or "without a word"


def damaged(error: Exception, path: Path) -> Why:
    return "damaged", str(error).removeprefix(f"{path} ").replace(str(path), path.name)


def last_line(error: str) -> str:
    """What the end of a traceback says."""
    return (error.strip().splitlines() or [""])[-1]


def reasons_to_compute(
    plan: Plan, shards: Path, todo: Iterable[int], why: Mapping[int, Why], others: Sequence[str]
) -> list[Reason]:
    """Why the cases at these places have no good shard, those with the same reason together.

    `why` is known of cases that have a shard; what the shards of `others` were stored with may explain the rest.
    """
    settings = _Others(plan, shards, others)
    found: dict[Why, list[int]] = {}
    for place in todo:
        found.setdefault(why.get(place) or settings.why(place), []).append(place)
    return [Reason(kind, sentence, Cases(plan, places)) for (kind, sentence), places in found.items()]


def made_by_other_code(older: Iterable[Cases], now: str, shards: Path) -> list[Reason]:
    """Stored cases that the code of now did not compute; they stand, since most changes of code change no number."""
    advice = "kept; to compute them anew, raise the study's version or choose another folder"
    reasons = []
    for cases in older:
        try:
            code = read_code(shard_path(shards, cases[0]))
        except IntegrityError:  # deleted in this moment
            continue
        reasons.append(Reason("other code", f"computed by {code}, not {now}: {advice}", cases))
    return reasons


class _Others:
    """Shards of the same axis values as a case, computed with other settings or by another version of the study."""

    def __init__(self, plan: Plan, shards: Path, names: Iterable[str]):
        self._shards, self._plan, self._names = shards, plan, set(names)
        self._readable: dict[str, list[str]] = {}
        for name in sorted(self._names):
            self._readable.setdefault(name[:-_DIGEST], []).append(name)
        self._known: list[tuple[int, Mapping[str, Any], tuple[str, ...]]] = []  # of each setting one shard is read

    def why(self, place: int) -> Why:
        """What such a shard has that the case at this place has not, or that there is no such shard."""
        difference = self._difference(self._plan.case_at(place)) if self._names else ""
        return ("changed", f"stored with {difference}") if difference else ("missing", "not computed yet")

    def _difference(self, case: Case) -> str:
        for version, parameters, variables in self._known:
            if Case(case.study, version, parameters, case.values, variables).id in self._names:
                return self._told(version, parameters, variables)
        for name in self._readable.get(case.readable, ()):
            setting = _setting(self._shards / f"{name}.nc")
            if setting is not None and setting not in self._known:
                self._known.append(setting)
                return self._told(*setting)
        return ""

    def _told(self, version: int, parameters: Mapping[str, Any], variables: tuple[str, ...]) -> str:
        study, now = self._plan.study, self._plan.parameters
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
