"""Whether a results folder can be believed: every byte of every shard, the dataset made of them, what was read off it,
and its physics."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np
import xarray as xr

from critflow.result import IntegrityError, Status, StudyError
from critflow.workflow.folder import Folder
from critflow.workflow.manifest import strangers
from critflow.workflow.plan import Selection
from critflow.workflow.report import claims_texts, left_out_by, opened_dataset, summary_text
from critflow.workflow.schema import merge
from critflow.workflow.store import check_seal, read_shard
from critflow.workflow.study import Study

_ANEW = "run the study again to write it anew"
# What says which data a file holds; other attributes say what made it, and may differ from what is at work now.
_IDENTITY = ("study", "study_version", "schema_version", "axes", "parameters")


def verify_folder(folder: Folder) -> tuple[int, list[str], bool]:
    """Number of cases looked at, a line for each thing that is wrong, and whether the physics was recomputed.

    A case not computed yet is not wrong.
    """
    _, selection = folder.selection()
    study = selection.study
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
    except (IntegrityError, StudyError) as error:
        if not problems and isinstance(error, StudyError):  # a run that was stopped has none yet
            raise
        return stored, [*problems, str(error)], False
    if not problems:
        problems += _contradictions(selection, folder, dataset)
    if not check_seal(path):
        problems.append(f"{path}: its seal is missing: {_ANEW}")
    if not problems:  # what is read off a dataset that is wrong says nothing more
        problems += _read_off(study, folder, dataset)
        problems += (f"{stranger}: {_ANEW}" for stranger in strangers(folder.path))
    if study.verify is None:
        return stored, problems, False
    try:
        return stored, [*problems, *(f"{path}: {problem}" for problem in study.verify(dataset))], True
    except Exception as error:
        if not problems and not left_out_by(study, error):  # the physics of a dataset that is wrong may be anything
            raise
    return stored, problems, False


def _contradictions(selection: Selection, folder: Folder, dataset: xr.Dataset) -> Iterator[str]:
    """A line for each variable or attribute of the dataset that the shards do not say."""
    path, made = folder.dataset(selection.study.name), merge(selection, folder.shards)
    for key in _IDENTITY:
        if dataset.attrs.get(key) != made.attrs[key]:
            yield f"{path}: its {key} is {dataset.attrs.get(key)!r}, not {made.attrs[key]!r}: {_ANEW}"
    for unknown in sorted(map(str, dataset.variables.keys() - made.variables.keys())):
        yield f"{path}: no shard holds {unknown}: {_ANEW}"
    for name, expected in made.variables.items():
        held = dataset.variables.get(name)
        if held is None or not _same(expected, held):
            yield f"{path}: {name} is not what the shards hold: {_ANEW}"
        elif _plain(expected.attrs) != _plain(held.attrs):
            yield f"{path}: the attributes of {name} are not those of the study: {_ANEW}"


def _plain(attributes: Mapping[Any, Any]) -> dict[str, list]:
    return {str(name): np.atleast_1d(value).tolist() for name, value in attributes.items()}


def _same(expected: xr.Variable, held: xr.Variable) -> bool:
    # Words come back from a file in another dtype than they had.
    dtypes = expected.dtype == held.dtype or expected.dtype.kind in "UT"
    nan = held.dtype.kind == "f"
    return expected.dims == held.dims and dtypes and np.array_equal(expected.values, held.values, equal_nan=nan)


def _read_off(study: Study, folder: Folder, dataset: xr.Dataset) -> Iterator[str]:
    """A line for each file of claims or of the summary that is not what the dataset says."""
    parts: list[tuple[tuple[str, ...], Callable[[], tuple[str, ...]]]] = []
    if (claims := study.claims) is not None:
        parts.append((("claims.json", "claims.md"), lambda: claims_texts(study, list(claims(dataset)))))
    if (summary := study.summary) is not None:
        parts.append((("summary.json",), lambda: (summary_text(summary(dataset)),)))
    for names, read_off in parts:
        try:
            texts = read_off()
        except Exception as error:
            if not left_out_by(study, error):
                raise
            continue
        for name, text in zip(names, texts, strict=True):
            path = folder.path / name
            if not path.is_file() or path.read_bytes() != text.encode():
                yield f"{path} is not what the dataset says: {_ANEW}"
