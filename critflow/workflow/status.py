"""How far a results folder is, read from its index and from the heads of the shards that the index does not know."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from critflow.result import IntegrityError, Status
from critflow.workflow.folder import Folder
from critflow.workflow.index import code_digest, indexed, listed_shards, read_index
from critflow.workflow.plan import Cases, Selection
from critflow.workflow.provenance import code_version
from critflow.workflow.store import read_code, read_status

STATES = ("done", "failed", "missing", "damaged")
_DONE, _FAILED, _MISSING, _DAMAGED = range(len(STATES))
_CODES = {int(Status.failed): _FAILED, int(Status.missing): _MISSING}


@dataclass(frozen=True)
class FolderStatus:
    """The state of every case of the last run's selection, as a number in `STATES`, over the axes of the study."""

    selection: Selection
    states: np.ndarray
    damage: list[str]
    read: list[tuple[str, int, str]]  # cases that the index did not know, with status and code in their shards
    of_other_code: list[Cases]  # those done that the code of now did not compute, by the code

    @cached_property
    def total(self) -> Counter[str]:
        counts = np.bincount(self.states.ravel(), minlength=len(STATES)).tolist()
        return Counter({state: count for state, count in zip(STATES, counts, strict=True) if count})

    @cached_property
    def along(self) -> dict[str, list[list[int]]]:
        """For every value of every axis, how many cases are in each state."""
        counts = {}
        for axis, (name, values) in enumerate(self.selection.axes.items()):
            rows = np.moveaxis(self.states, axis, 0).reshape(len(values), -1)
            counts[name] = np.stack([(rows == state).sum(1) for state in range(len(STATES))], 1).tolist()
        return counts

    def cases(self, state: str) -> Cases:
        """The cases that are in this state."""
        return Cases(self.selection, np.flatnonzero(self.states == STATES.index(state)).tolist())


def folder_status(folder: Folder) -> FolderStatus:
    """Look at every case without reading its data, so a flipped byte inside is left for `verify` and the next run.

    A shard stored with another table of variables is opened, to say what is wrong with it.
    """
    _, selection = folder.selection()
    table, now = selection.study.table_digest, code_digest(code_version(selection.study))
    shards, index = listed_shards(folder.shards), read_index(folder.index)
    states = bytearray([_MISSING]) * math.prod(selection.shape)
    damage, read = list[str](), list[tuple[str, int, str]]()
    other: dict[str, list[int]] = {}
    for place, case_id in enumerate(selection.ids()):
        if (shard := shards.get(case_id)) is None:
            continue
        known = indexed(index[case_id], shard, table) if case_id in index else None
        if known is None:
            try:
                status = int(read_status(folder.shards, selection.study, selection.case_at(place), verify=False))
                code = read_code(Path(shard.path))
            except IntegrityError as error:
                damage.append(str(error))
                states[place] = _DAMAGED
                continue
            read.append((case_id, status, code))
            known = status, code_digest(code)
        states[place] = state = _CODES.get(known[0], _DONE)
        if state == _DONE and known[1] != now:
            other.setdefault(known[1], []).append(place)
    shaped = np.frombuffer(states, "i1").reshape(selection.shape)
    return FolderStatus(selection, shaped, damage, read, [Cases(selection, places) for places in other.values()])


def status_lines(status: FolderStatus) -> list[str]:
    """The status as a person reads it; values of an axis that stand alike are told in one line."""
    total = [status.total[state] for state in STATES]
    lines = [f"{status.selection.study.name}: {_counts(total)} of {sum(total)} cases"]
    for name, rows in status.along.items():
        alike: dict[tuple[int, ...], list[int | str]] = {}
        for value, row in zip(status.selection.axes[name], rows, strict=True):
            alike.setdefault(tuple(row), []).append(value)
        lines += [
            f"  {name} {_ranges(values)}: {_counts(row)}{' each' if len(values) > 1 else ''}"
            for row, values in alike.items()
        ]
    return lines


def status_plain(status: FolderStatus) -> dict[str, Any]:
    """The status for `--json`: every count stands there, zeros too."""
    selection = status.selection
    return {
        "study": selection.study.name,
        "study_version": selection.study.version,
        "parameters": dict(selection.parameters),
        "variables": list(selection.study.selected),
        "total": {state: status.total[state] for state in STATES},
        "along": {
            name: [
                {"value": value, **dict(zip(STATES, row, strict=True))}
                for value, row in zip(selection.axes[name], rows, strict=True)
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
