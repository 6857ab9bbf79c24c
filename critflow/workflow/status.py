"""How far a results folder is, read from the heads of its shards."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import Any

from critflow.result import IntegrityError, Status
from critflow.workflow.folder import Folder
from critflow.workflow.plan import Case, Selection
from critflow.workflow.store import read_status

STATES = ("done", "failed", "missing", "damaged")


@dataclass(frozen=True)
class FolderStatus:
    """Cases of the last run's selection by state, in all and for every value of every axis."""

    selection: Selection
    total: Counter[str]
    along: dict[str, dict[int | str, Counter[str]]]
    damage: list[str]
    cases: dict[str, list[Case]]  # the cases of every state


def folder_status(folder: Folder) -> FolderStatus:
    """Look at every case without reading its data, so a flipped byte inside is left for the next run to find."""
    _, selection = folder.selection()
    total: Counter[str] = Counter()
    along = {name: {value: Counter[str]() for value in values} for name, values in selection.axes.items()}
    damage, cases = [], {state: list[Case]() for state in STATES}
    for case in selection.cases():
        try:
            status = read_status(folder.shards, selection.study, case, verify=False)
            state = status.name if status in (Status.failed, Status.missing) else "done"
        except IntegrityError as error:
            damage.append(str(error))
            state = "damaged"
        total[state] += 1
        cases[state].append(case)
        for name, value in case.values.items():
            along[name][value][state] += 1
    return FolderStatus(selection, total, along, damage, cases)


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
