"""The text that says what a dataset is: its attribute `summary`, which `critflow show FILE` prints."""

from __future__ import annotations

import textwrap
from collections import Counter
from collections.abc import Mapping

from critflow.result import Status
from critflow.workflow.plan import Selection, spelled
from critflow.workflow.study import Study

_WIDTH = 118
_MOST = 10  # lines about the outcomes


def summary_text(
    selection: Selection, sizes: Mapping[str, int], outcomes: Mapping[tuple[str, Status, bool], int], codes: str
) -> str:
    """What a dataset is, how and by which code it was made, what is missing, and how to select good members.

    sizes     of the inner dimensions
    outcomes  number of cases by the value of the last axis, the status, and whether their numbers are sound
    codes     the code that computed the cases, with their numbers
    """
    study = selection.study
    inner = ", ".join(f"{size} {name}" for name, size in sizes.items())
    lines = [
        f"{study.title} (study {study.name}, version {study.version})",
        *textwrap.wrap(study.description, _WIDTH, max_lines=3, placeholder=" ..."),
        f"cases: {selection.sizes} = {selection.count}{f'; in each {inner}' if inner else ''}",
        *textwrap.wrap(f"made by: {_command(selection)}", _WIDTH, subsequent_indent="  "),
        *textwrap.wrap(f"settings: {_settings(selection)}", _WIDTH, subsequent_indent="  ", max_lines=3),
        *textwrap.wrap(f"code: {codes or 'none'}", _WIDTH, subsequent_indent="  "),
        *_outcome_lines(study, outcomes),
        *_selections(selection),
    ]
    return "\n".join(lines)


def _command(selection: Selection) -> str:
    """The command that makes the cases of a dataset."""
    study = selection.study
    changed = {axis.key: selection.axes[axis.name] for axis in study.axes if selection.axes[axis.name] != axis.values}
    changed |= {k: v for k, v in selection.parameters.items() if v != study.parameters[k]}
    changed |= {"variables": study.selected} if study.selected else {}
    return " ".join(["critflow run", study.name, *(f"--set {key}={spelled(value)}" for key, value in changed.items())])


def _settings(selection: Selection) -> str:
    return ", ".join(f"{key}={spelled(value)}" for key, value in selection.parameters.items()) or "none"


def _outcome_lines(study: Study, outcomes: Mapping[tuple[str, Status, bool], int]) -> list[str]:
    """Numbers of good, other, failed and missing cases, with a line for each word of the last axis."""
    rows: dict[str, Counter[str]] = {}
    for (group, status, sound), count in outcomes.items():
        name = "good" if status is Status.ok else f"{status.name}{', sound' * (sound and status is not Status.ok)}"
        rows.setdefault(group, Counter())[name] += count
    counted = {
        group: ", ".join(f"{count} {name}" for name, count in sorted(row.items(), key=lambda one: one[0] != "good"))
        for group, row in rows.items()
    }
    if len(set(counted.values())) == 1:
        each = f" of each {study.axes[-1].name}" if len(counted) > 1 else ""
        return [f"outcomes: {next(iter(counted.values()))}{each}"]
    lines = [f"  {group}: {text}" for group, text in counted.items()]
    more = [f"  and {len(lines) - _MOST} more"] if len(lines) > _MOST else []
    return ["outcomes:", *lines[:_MOST], *more]


def _selections(selection: Selection) -> list[str]:
    """How to select good members, and one case."""
    study, names = selection.study, {variable.name for variable in selection.study.variables}
    numbers = [v.name for v in study.variables if v.dtype[0] == "f" and set(v.dims) == set(study.axis_names)][:2]
    good = "ds.valid" if "valid" in names else "ds.status == 0"
    lines = [f"good members: ds[{numbers}].where({good}); the whole dataset is not masked"] if numbers else []
    one = {axis.name: selection.axes[axis.name][-1] for axis in study.axes}
    if {"edges", "offsets", "cell", "position"} <= names:
        chosen = ", ".join(f"{name}={value!r}" for name, value in one.items())
        words = " ".join(f"--set {name}={value}" for name, value in one.items())
        lines += [f"one network: critflow.network_from(ds.sel({chosen}))", f"its figure: critflow show FILE {words}"]
    return lines
