"""Verification of a results folder: every byte of its shards and its dataset, the texts of its report, its physics."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import xarray as xr

from critflow.result import IntegrityError, StudyError
from critflow.workflow.dataset import REWRITE, SMALL, Assembly, opened_dataset
from critflow.workflow.folder import CHANGED, DAMAGED, DONE, FAILED, Folder
from critflow.workflow.report import text_parts
from critflow.workflow.store import shard_path
from critflow.workflow.study import Study

# Attributes that state the data of a file, and their origin; others state the present code.
_COMPARED = ("study", "study_version", "schema_version", "axes", "parameters")
_ORIGINS = ("cases_code", "cases_environment", "shards_sha256")


def verify_folder(folder: Folder) -> tuple[int, list[str], bool]:
    """Compare shards, dataset, texts and physics of the last run; a case that was not computed is no problem.

    Returns the number of verified shards, a line per problem, and whether the physics was recomputed.

    Raises `IntegrityError` if the note is damaged, `StudyError` if there is no dataset and no problem.
    """
    _, selection = folder.selection()
    study, path = selection.study, folder.dataset(selection.study.name)
    states = folder.states(selection, read=True)
    stored = sum(state == DONE for _, state, _ in states)
    bad = [state for state in states if state.state in (DAMAGED, CHANGED)]
    problems = [f"{shard_path(folder.shards, case)} is {state}: {reason}" for case, state, reason in bad]
    recomputed = False
    try:
        with opened_dataset(path) as opened:
            dataset = opened.load() if opened.nbytes < SMALL else opened
            if not problems:  # damaged shards can be compared with nothing
                assembly = Assembly(selection, folder.shards, [case.id for case, state, _ in states if state == FAILED])
                problems += [f"{path}: {line}: {REWRITE}" for line in _differences(assembly, dataset)]
            if not problems:  # texts and physics of a damaged dataset can be anything
                problems += _outdated_texts(study, folder, dataset)
                if study.verify is not None and study.can_report("verify"):
                    problems += [f"{path}: {line}" for line in study.verify(dataset)]
                    recomputed = True
    except (IntegrityError, StudyError) as error:
        if isinstance(error, StudyError) and not problems:  # of a run that was stopped
            raise
        problems.append(str(error))
    return stored, problems, recomputed


def _differences(assembly: Assembly, dataset: xr.Dataset) -> Iterator[str]:
    """A line for each variable and attribute of the dataset that differs from the shards."""
    expected, wrong = assembly.template(), set[str]()
    for name, variable in expected.variables.items():
        stored = dataset.variables.get(name)
        if stored is None or (stored.dims, stored.shape) != (variable.dims, variable.shape):
            wrong.add(str(name))
        elif name in expected.coords and not _equal(variable.values, stored.values):
            wrong.add(str(name))
    for rows, arrays in assembly.pieces():
        for name in arrays.keys() - wrong:
            stored = dataset.variables[name]
            if not _equal(arrays[name], stored.isel({assembly.first: rows}, missing_dims="ignore").values):
                wrong.add(name)
    for name in sorted(map(str, expected.variables.keys() | dataset.variables.keys())):
        if name not in expected.variables:
            yield f"no shard contains {name}"
        elif name in wrong:
            yield f"{name} differs from the shards"
        elif _plain(expected.variables[name].attrs) != _plain(dataset.variables[name].attrs):
            yield f"the attributes of {name} differ from those of the study"
    attributes = {**expected.attrs, **assembly.origin_attributes()}
    for name in _COMPARED if wrong else (*_COMPARED, *_ORIGINS):
        if dataset.attrs.get(name, "") != attributes.get(name, ""):
            yield f"its {name} is {dataset.attrs.get(name)!r:.200}, not {attributes.get(name)!r:.200}"


def _equal(expected: np.ndarray, stored: np.ndarray) -> bool:
    same_kind = expected.dtype == stored.dtype or expected.dtype.kind == "U"  # words are stored as characters
    return same_kind and np.array_equal(expected, stored, equal_nan=expected.dtype.kind == "f")


def _plain(attributes: dict[Any, Any]) -> dict[str, list]:
    return {str(name): np.atleast_1d(value).tolist() for name, value in attributes.items()}


def _outdated_texts(study: Study, folder: Folder, dataset: xr.Dataset) -> Iterator[str]:
    """A line for each file of claims or of the summary that differs from the dataset."""
    for name, paths, make in text_parts(study, folder):
        if study.can_report(name):
            for path, content in zip(paths, make(dataset), strict=True):
                if not path.is_file() or path.read_bytes() != content:
                    yield f"{path} differs from the dataset: {REWRITE}"
