"""How far a results folder is, read from its index and from the heads of the shards that the index does not know."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from critflow.result import IntegrityError, Status
from critflow.workflow.errors import OtherTable
from critflow.workflow.folder import Folder
from critflow.workflow.index import Entry, Stored, code_digest, known_shards
from critflow.workflow.plan import Cases, Plan, Selection
from critflow.workflow.reasons import OTHER_TABLE, Why, damaged, failed, last_line
from critflow.workflow.store import read_ending
from critflow.workflow.study import Study

STATES = ("done", "failed", "missing", "damaged")
_DONE, _FAILED, _MISSING, _DAMAGED = range(len(STATES))
_CODES = {int(Status.failed): _FAILED, int(Status.missing): _MISSING}


@dataclass(frozen=True)
class FolderStatus:
    """The state of every case of the last run's plan, as a number in `STATES`, over the axes of the study."""

    plan: Plan
    code: str  # what computes a case now
    states: np.ndarray
    why: dict[int, Why]  # of cases with a shard that is not good, by their places
    others: list[str]  # ids of shards that are none of the plan's
    damage: list[str]
    read: list[Stored]  # cases that the index did not know
    of_other_code: list[Cases]  # those done that the code of now did not compute, by the code

    @cached_property
    def total(self) -> Counter[str]:
        counts = np.bincount(self.states.ravel(), minlength=len(STATES)).tolist()
        return Counter({state: count for state, count in zip(STATES, counts, strict=True) if count})

    @cached_property
    def along(self) -> dict[str, list[list[int]]]:
        """For every value of every axis, how many cases are in each state."""
        counts = {}
        for axis, (name, values) in enumerate(self.plan.axes.items()):
            rows = np.moveaxis(self.states, axis, 0).reshape(len(values), -1)
            counts[name] = np.stack([(rows == state).sum(1) for state in range(len(STATES))], 1).tolist()
        return counts

    @property
    def todo(self) -> list[int]:
        """Places of the cases that are not done, those in the same state together."""
        return [
            place for state in range(_FAILED, len(STATES)) for place in np.flatnonzero(self.states == state).tolist()
        ]


def folder_status(folder: Folder) -> FolderStatus:
    """Look at every case without reading its data, so a flipped byte inside is left for `verify` and the next run."""
    plan, table, code = folder.noted()
    now = code_digest(code)
    shards = known_shards(folder.shards, folder.index)
    states = bytearray([_MISSING]) * math.prod(plan.shape)
    why, damage, read = dict[int, Why](), list[str](), list[Stored]()
    other: dict[str, list[int]] = {}
    study: Study | None = plan.study if isinstance(plan, Selection) else None
    for place, case_id in enumerate(plan.ids()):
        if case_id not in shards:
            continue
        if (known := shards.pop(case_id)) is None:
            study = study or folder.selection()[1].study  # shards are read with its table
            try:
                ending = read_ending(folder.shards, study, plan.case_at(place), verify=False)
            except OtherTable:
                why[place] = OTHER_TABLE
                continue
            except IntegrityError as error:
                damage.append(str(error))
                why[place] = damaged(error, folder.shards / f"{case_id}.nc")
                states[place] = _DAMAGED
                continue
            read.append(Stored(case_id, int(ending.status), ending.code, last_line(ending.error)))
            known = Entry(table, int(ending.status), code_digest(ending.code), last_line(ending.error))
        elif known.table != table:
            why[place] = OTHER_TABLE
            continue
        states[place] = state = _CODES.get(known.status, _DONE)
        if state == _FAILED:
            why[place] = failed(known.words)
        elif state == _DONE and known.code != now:
            other.setdefault(known.code, []).append(place)
    shaped = np.frombuffer(states, "i1").reshape(plan.shape)
    of_other_code = [Cases(plan, places) for places in other.values()]
    return FolderStatus(plan, code, shaped, why, list(shards), damage, read, of_other_code)


def status_lines(status: FolderStatus) -> list[str]:
    """The status as a person reads it; values of an axis that stand alike are told in one line."""
    total = [status.total[state] for state in STATES]
    lines = [f"{status.plan.study.name}: {_counts(total)} of {sum(total)} cases"]
    for name, rows in status.along.items():
        alike: dict[tuple[int, ...], list[int | str]] = {}
        for value, row in zip(status.plan.axes[name], rows, strict=True):
            alike.setdefault(tuple(row), []).append(value)
        lines += [
            f"  {name} {_ranges(values)}: {_counts(row)}{' each' if len(values) > 1 else ''}"
            for row, values in alike.items()
        ]
    return lines


def status_plain(status: FolderStatus) -> dict[str, Any]:
    """The status for `--json`: every count stands there, zeros too."""
    plan = status.plan
    return {
        "study": plan.study.name,
        "study_version": plan.study.version,
        "parameters": dict(plan.parameters),
        "variables": list(plan.study.selected),
        "total": {state: status.total[state] for state in STATES},
        "along": {
            name: [
                {"value": value, **dict(zip(STATES, row, strict=True))}
                for value, row in zip(plan.axes[name], rows, strict=True)
            ]
            for name, rows in status.along.items()
        },
        "damage": status.damage,
    }


def _counts(row: Sequence[int]) -> str:
    return ", ".join(f"{count} {state}" for count, state in zip(row, STATES, strict=True) if count)


def _ranges(values: list[int | str]) -> str:
    """Neighbouring whole numbers as the ranges that `--set` takes."""
    pieces: list[list[int | str]] = []
    for value in values:
        last = pieces[-1][-1] if pieces else None
        if isinstance(value, int) and isinstance(last, int) and value == last + 1:
            pieces[-1].append(value)
        else:
            pieces.append([value])
    return ",".join(f"{p[0]}:{int(p[-1]) + 1}" if len(p) > 2 else ",".join(map(str, p)) for p in pieces)
