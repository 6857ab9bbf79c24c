"""How far a results folder is, read from its index and from the heads of the shards that the index does not know."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from critflow.result import IntegrityError, Status
from critflow.workflow.folder import Folder
from critflow.workflow.index import indexed_status, listed_shards, read_index
from critflow.workflow.plan import Case, Selection
from critflow.workflow.store import read_status

STATES = ("done", "failed", "missing", "damaged")
_DONE, _FAILED, _MISSING, _DAMAGED = range(len(STATES))
_CODES = {int(Status.failed): _FAILED, int(Status.missing): _MISSING}


@dataclass(frozen=True)
class FolderStatus:
    """The state of every case of the last run's selection, as a number in `STATES`, over the axes of the study."""

    selection: Selection
    states: np.ndarray
    damage: list[str]
    read: list[tuple[str, int]]  # cases that the index did not know, with the status that their shards say

    @cached_property
    def total(self) -> Counter[str]:
        return _counted(self.states)

    @cached_property
    def along(self) -> dict[str, dict[int | str, Counter[str]]]:
        """The counts for every value of every axis."""
        return {
            name: dict(zip(values, map(_counted, np.moveaxis(self.states, axis, 0)), strict=True))
            for axis, (name, values) in enumerate(self.selection.axes.items())
        }

    def cases(self, state: str) -> Iterator[Case]:
        """The cases that are in this state."""
        for place in np.flatnonzero(self.states == STATES.index(state)).tolist():
            yield _case(self.selection, place)


def folder_status(folder: Folder) -> FolderStatus:
    """Look at every case without reading its data, so a flipped byte inside is left for `verify` and the next run."""
    _, selection = folder.selection()
    shards, index = listed_shards(folder.shards), read_index(folder.index)
    states = np.full(math.prod(selection.shape), _MISSING, "i1")
    damage, unknown, read = [], [], []
    for place, case_id in enumerate(selection.ids()):
        if (shard := shards.get(case_id)) is None:
            continue
        known = indexed_status(index[case_id], shard) if case_id in index else None
        if known is not None:
            states[place] = _CODES.get(known, _DONE)
        else:
            unknown.append((place, case_id))
    for place, case_id in unknown:
        rows = np.unravel_index(place, selection.shape)
        case = selection.case(
            **{name: selection.axes[name][row] for name, row in zip(selection.axes, rows, strict=True)}
        )
        try:
            status = read_status(folder.shards, selection.study, case, verify=False)
            states[place] = _CODES.get(int(status), _DONE)
            read.append((case_id, int(status)))
        except IntegrityError as error:
            damage.append(str(error))
            states[place] = _DAMAGED
    return FolderStatus(selection, states.reshape(selection.shape), damage, read)


def _case(selection: Selection, place: int) -> Case:
    rows = np.unravel_index(place, selection.shape)
    return selection.case(**{name: selection.axes[name][row] for name, row in zip(selection.axes, rows, strict=True)})


def _counted(states: np.ndarray) -> Counter[str]:
    counts = np.bincount(states.ravel(), minlength=len(STATES)).tolist()
    return Counter({state: count for state, count in zip(STATES, counts, strict=True) if count})


def status_lines(status: FolderStatus) -> list[str]:
    """The status as a person reads it; values of an axis that stand alike are told in one line."""
    lines = [f"{status.selection.study.name}: {_counts(status.total)} of {status.total.total()} cases"]
    for name, counters in status.along.items():
        alike: dict[str, list[int | str]] = {}
        for value, counter in counters.items():
            alike.setdefault(_counts(counter), []).append(value)
        lines += [
            f"  {name} {_ranges(values)}: {counts}{' each' if len(values) > 1 else ''}"
            for counts, values in alike.items()
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
            name: [{"value": value, **{state: counter[state] for state in STATES}} for value, counter in along.items()]
            for name, along in status.along.items()
        },
        "damage": status.damage,
    }


def _counts(counter: Counter[str]) -> str:
    return ", ".join(f"{counter[state]} {state}" for state in STATES if counter[state])


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
