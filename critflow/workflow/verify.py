"""Whether a results folder can be believed: every byte of every shard, the dataset made of them, its physics."""

from __future__ import annotations

import numpy as np

from critflow.result import IntegrityError, Status
from critflow.workflow.folder import Folder
from critflow.workflow.report import left_out_by, opened_dataset
from critflow.workflow.schema import merge
from critflow.workflow.store import read_shard


def verify_folder(folder: Folder) -> tuple[int, list[str], bool]:
    """Number of cases looked at, a line for each thing that is wrong, and whether the physics was recomputed.

    A case not computed yet is not wrong.
    """
    _, selection = folder.selection()
    study, recomputed = selection.study, False
    problems, stored = [], 0
    for case in selection.cases():
        try:
            shard = read_shard(folder.shards, study, case)
        except IntegrityError as error:
            problems.append(str(error))
            continue
        stored += shard is not None and shard.status is not Status.failed
    path = folder.dataset(study.name)
    try:
        with opened_dataset(path) as opened:
            dataset = opened.load()
    except IntegrityError as error:
        return stored, [*problems, str(error)], recomputed
    if not problems:
        made = merge(selection, folder.shards)
        for name, expected in made.variables.items():
            held = dataset.variables.get(name)
            # Words come back from a file in another dtype than they had.
            same = held is not None and (expected.dtype == held.dtype or expected.dtype.kind in "UT")
            if (
                held is None
                or not same
                or not np.array_equal(expected.values, held.values, equal_nan=held.dtype.kind == "f")
            ):
                problems.append(f"{path}: {name} is not what the shards hold: run the study again to write it anew")
    if study.verify is not None:
        try:
            problems += [f"{path}: {problem}" for problem in study.verify(dataset)]
            recomputed = True
        except Exception as error:
            if not left_out_by(study, error):
                raise
    return stored, problems, recomputed
