"""Verification of a results folder: every byte of its shards and its dataset, the texts of its report, its physics.

A sample of the cases is computed again.  The numbers must be the same bits on the libraries that computed them first;
on others they may differ by `_CLOSE`.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from hashlib import sha256
from itertools import chain
from typing import Any

import numpy as np
import xarray as xr
from threadpoolctl import threadpool_limits

from critflow.engine.code_digest import code_version, environment
from critflow.engine.dataset import REWRITE, SMALL, Assembly, opened_dataset
from critflow.engine.report import text_files, texts
from critflow.engine.settings import Case
from critflow.engine.store import CHANGED, DAMAGED, DONE, OTHER, Folder, read_shard, shard_path
from critflow.engine.study import THREADS, Study, plural
from critflow.result import IntegrityError, StudyError

# Attributes that state the data of a file, and their origin; others state the present code.
_COMPARED = ("study", "study_version", "schema_version", "axes", "parameters")
OTHER_CODE = "of other code"  # in a line about cases that only --recompute corrects
_CLOSE = 1e-6  # of the largest number of a variable
_ORIGINS = ("summary", "cases_code", "cases_environment", "shards_sha256")


def verify_folder(folder: Folder, sample: int) -> tuple[list[str], int, bool, list[Case]]:
    """Compare shards, dataset, texts and physics of the last run; a case that was not computed is no problem.

    sample  cases that are computed again, chosen by their ids

    Returns a line for each problem, the number of cases that were read, whether the study recomputed its physics from
    the stored arrays, and the cases that were computed again.  Raises `IntegrityError` if the note is damaged,
    `StudyError` if there is no dataset and no problem.
    """
    _, selection = folder.selection()
    study, path = selection.study, folder.dataset(selection.study.name)
    states = folder.states(selection)
    bad = [one for one in states if one.state in (DAMAGED, CHANGED)]
    # The cases of a shard have one line.
    lines = (f"{shard_path(folder.shards, one.case)} is {one.state}: {one.reason}" for one in bad)
    problems, physics = list(dict.fromkeys(lines)), False
    try:
        with opened_dataset(path) as opened:
            dataset = opened.load() if opened.nbytes < SMALL else opened
            if not problems:  # damaged shards can be compared with nothing
                assembly = Assembly(selection, folder.shards, states, folder.word())
                problems += [f"{path}: {line}: {REWRITE}" for line in _differences(assembly, dataset)]
            if not problems:  # texts and physics of a damaged dataset can be anything
                problems += _outdated_texts(study, folder, dataset)
                if study.verify is not None and study.can_report("verify"):
                    problems += [f"{path}: {line}" for line in study.verify(dataset)]
                    physics = True
    except (IntegrityError, StudyError) as error:
        if isinstance(error, StudyError) and not problems:  # of a run that was stopped
            raise
        problems.append(str(error))
    others = Counter(one.reason for one in states if one.state == OTHER)
    now = code_version(study)
    problems += [f"{plural(count, 'case')} {OTHER_CODE}: {code}, now {now}" for code, count in others.items()]
    done = sorted((one.case for one in states if one.state == DONE), key=lambda case: sha256(case.id.encode()).digest())
    for case in done[:sample]:
        problems += _recomputed(folder, study, case)
    return problems, sum(one.record is not None for one in states), physics, done[:sample]


def _recomputed(folder: Folder, study: Study, case: Case) -> Iterator[str]:
    """A line for each variable of a case that is another one when it is computed again."""
    stored = read_shard(shard_path(folder.shards, case), study, case)[0][case.id]
    volatile = {v.name for v in study.variables if v.volatile}
    with threadpool_limits(limits=THREADS):
        try:
            arrays = study.computed(case.parameters, case.values)
        except Exception as error:
            yield f"case {case.id} cannot be computed again: {type(error).__name__}: {error}"
            return
    tolerance = 0.0 if stored.environment == environment() else _CLOSE
    expected = {**stored.arrays, "status": np.asarray(stored.status, arrays["status"].dtype)}
    for name in sorted((arrays.keys() | expected.keys()) - volatile):
        if name not in arrays or name not in expected:
            yield f"case {case.id}: {name} is not in both the stored and the recomputed case"
        elif not _equal(expected[name], arrays[name], tolerance):
            yield f"case {case.id}: {name} is another one when it is computed again"


def _differences(assembly: Assembly, dataset: xr.Dataset) -> Iterator[str]:
    """A line for each variable and attribute of the dataset that differs from the shards."""
    coordinates, found = assembly.coordinates(), dataset.variables
    expected = {str(name): (v.dims, v.shape, v.attrs) for name, v in coordinates.variables.items()}
    expected |= {v.name: (v.dims, assembly.shape(v), assembly.variable_attributes(v)) for v in assembly.variables}
    wrong = {n for n, table in expected.items() if n not in found or (found[n].dims, found[n].shape) != table[:2]}
    labels = {str(name): variable.values for name, variable in coordinates.variables.items()}
    for rows, arrays in chain([(slice(None), labels)], assembly.pieces()):
        for name in arrays.keys() - wrong:
            if not _equal(arrays[name], found[name].isel({assembly.first: rows}, missing_dims="ignore").values):
                wrong.add(name)
    for name in sorted({*expected, *map(str, found)}):
        if name not in expected:
            yield f"no shard contains {name}"
        elif name in wrong:
            yield f"{name} differs from the shards"
        elif _plain(expected[name][2]) != _plain(found[name].attrs):
            yield f"the attributes of {name} differ from those of the study"
    attributes = {**coordinates.attrs, **assembly.origin_attributes()}
    for name in _COMPARED if wrong else (*_COMPARED, *_ORIGINS):
        if dataset.attrs.get(name, "") != attributes.get(name, ""):
            yield f"its {name} is {dataset.attrs.get(name)!r:.200}, not {attributes.get(name)!r:.200}"


def _equal(expected: np.ndarray, found: np.ndarray, tolerance: float = 0.0) -> bool:
    """Whether arrays are equal to the bit, or floating-point numbers within a tolerance relative to their largest."""
    floating = expected.dtype.kind == "f"
    if floating and tolerance:
        least = tolerance * float(np.nanmax(np.abs(expected), initial=0.0))
        return expected.shape == found.shape and np.allclose(found, expected, tolerance, least, equal_nan=True)
    same_kind = expected.dtype == found.dtype or expected.dtype.kind == "U"  # words are stored as characters
    return same_kind and np.array_equal(expected, found, equal_nan=floating)


def _plain(attributes: dict[Any, Any]) -> dict[str, list]:
    return {str(name): np.atleast_1d(value).tolist() for name, value in attributes.items()}


def _outdated_texts(study: Study, folder: Folder, dataset: xr.Dataset) -> Iterator[str]:
    """A line for each file of claims or of the summary that differs from the dataset."""
    for name, paths in text_files(study, folder).items():
        if study.can_report(name):
            for path, content in zip(paths, texts(study, name, dataset), strict=True):
                if not path.is_file() or path.read_bytes() != content:
                    yield f"{path} differs from the dataset: {REWRITE}"
