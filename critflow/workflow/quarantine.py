"""What is told of failed cases: why each failed, with which parameters, and the command that runs it alone."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Sequence
from typing import Any

from critflow.workflow.batch import last_words
from critflow.workflow.folder import Folder
from critflow.workflow.limits import Limits
from critflow.workflow.load import StudyFile
from critflow.workflow.plan import Case, Selection
from critflow.workflow.store import read_shard, write_text

FILE = "failed.txt"


def write_quarantine(
    loaded: StudyFile, selection: Selection, folder: Folder, failed: Sequence[Case], limits: Limits
) -> dict[str, str]:
    """Write the file anew from the shards of the failed cases, and return the last words of each by its id.

    Without any there is no file.
    """
    path = folder.path / FILE
    if not failed:
        path.unlink(missing_ok=True)
        return {}
    told, reasons = [], {}
    for case in failed:
        shard = read_shard(folder.shards, selection.study, case)
        error = shard.error if shard else ""
        reasons[case.id] = last_words(error)
        lines = [f"# {case.id}", shlex.join(command_alone(loaded, case, folder, limits)), ""]
        lines += [f"{key} = {_spelled(value)}" for key, value in {**case.values, **case.parameters}.items()]
        told.append("\n".join([*lines, "", error, ""]))
    write_text(path, "\n".join(told))
    return reasons


def command_alone(loaded: StudyFile, case: Case, folder: Folder, limits: Limits) -> list[str]:
    """Words of the command that runs this case and no other, in a folder of its own."""
    settings = [f"--set={key}={value}" for key, value in _settings(loaded, case)]
    where = [f"--out={folder.path}-alone", "--workers=1", "--retry-failed"]
    patience = [] if limits == Limits() else [f"--time-limit={limits.case_seconds:g}"]
    if limits.worker_gigabytes is not None:
        patience.append(f"--memory-limit={limits.worker_gigabytes:g}")
    return ["critflow", "run", loaded.study.name if loaded.by_name else str(loaded.path), *settings, *where, *patience]


def _settings(loaded: StudyFile, case: Case) -> Iterator[tuple[str, str]]:
    for axis in loaded.study.axes:
        yield axis.key, _spelled(case.values[axis.name])
    for key, value in case.parameters.items():
        if value != loaded.study.parameters[key]:
            yield key, _spelled(value)
    if case.variables:
        yield "variables", _spelled(case.variables)


def _spelled(value: Any) -> str:
    """The value as `--set` takes it."""
    if isinstance(value, bool):
        return str(value).lower()
    return ",".join(map(str, value)) if isinstance(value, tuple) else str(value)
