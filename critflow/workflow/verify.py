"""Whether a results folder can be believed: every byte of every shard, the dataset made of them, what was read off it,
and its physics."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from critflow.result import IntegrityError, Status, StudyError
from critflow.workflow.errors import OtherTable
from critflow.workflow.folder import Folder
from critflow.workflow.manifest import strangers
from critflow.workflow.merge import empty_table, merged
from critflow.workflow.plan import Case, Selection
from critflow.workflow.provenance import Origins
from critflow.workflow.report import claims_texts, left_out_by, opened_dataset, summary_text
from critflow.workflow.schema import Table, variable_attributes
from critflow.workflow.store import Shard, check_seal, read_shard
from critflow.workflow.study import Study, Variable

_IN_MEMORY = 2**28  # bytes of a dataset that is loaded for its physics; of a larger one each case is read by itself
_ANEW = "run the study again to write it anew"
# What says which data a file holds; other attributes say what made it, and may differ from what is at work now.
_IDENTITY = ("study", "study_version", "schema_version", "axes", "parameters")


class _Shards:
    """The shards of a folder, each read to its last byte, and what is wrong with them."""

    def __init__(self, selection: Selection, folder: Path):
        self.selection, self.folder = selection, folder
        self.stored = self.of_other_table = 0
        self.damage: list[str] = []

    def read(self, case: Case) -> Shard | None:
        try:
            shard = read_shard(self.folder, self.selection.study, case)
        except OtherTable:
            self.of_other_table += 1
            return None
        except IntegrityError as error:
            self.damage.append(str(error))
            return None
        self.stored += shard is not None and shard.status is not Status.failed
        return shard

    def problems(self) -> list[str]:
        if not self.of_other_table:
            return self.damage
        those = f"{self.of_other_table} of {math.prod(self.selection.shape)} cases"
        changed = f"{self.folder}: the table of the study changed since {those} were stored: run the study again"
        return [*self.damage, changed]


def verify_folder(folder: Folder) -> tuple[int, list[str], bool]:
    """Number of cases looked at, a line for each thing that is wrong, and whether the physics was recomputed.

    A case not computed yet is not wrong.  Shards and dataset go through memory slab by slab, as in the merge.
    """
    _, selection = folder.selection()
    study, path = selection.study, folder.dataset(selection.study.name)
    shards = _Shards(selection, folder.shards)
    with ExitStack() as stack:
        try:
            dataset = stack.enter_context(opened_dataset(path))
        except (IntegrityError, StudyError) as error:
            for case in itertools.chain.from_iterable(selection.batches()):
                shards.read(case)
            if isinstance(error, StudyError) and not shards.problems():  # a run that was stopped has none yet
                raise
            return shards.stored, [*shards.problems(), str(error)], False
        contradictions = list(_contradictions(selection, shards, dataset, path))
        problems = shards.problems() or contradictions  # of damaged shards nothing is known
        if not check_seal(path):
            problems.append(f"{path}: its seal is missing: {_ANEW}")
        if dataset.nbytes < _IN_MEMORY:
            dataset = dataset.load()
        if not problems:  # what is read off a dataset that is wrong says nothing more
            problems += _read_off(study, folder, dataset)
            problems += (f"{stranger}: {_ANEW}" for stranger in strangers(folder.path))
        if study.verify is None:
            return shards.stored, problems, False
        try:
            return shards.stored, [*problems, *(f"{path}: {problem}" for problem in study.verify(dataset))], True
        except Exception as error:
            if not problems and not left_out_by(study, error):  # the physics of a dataset that is wrong may be anything
                raise
        return shards.stored, problems, False


def _contradictions(selection: Selection, shards: _Shards, dataset: xr.Dataset, path: Path) -> Iterator[str]:
    """A line for each variable or attribute of the dataset that the shards do not say, once all of them are read."""
    whole = empty_table(selection, _Shards(selection, shards.folder).read)
    labels = whole.labels()
    declared = {variable.name: variable for variable in selection.study.variables}
    for key in _IDENTITY:
        if dataset.attrs.get(key) != labels.attrs[key]:
            yield f"{path}: its {key} is {dataset.attrs.get(key)!r}, not {labels.attrs[key]!r}: {_ANEW}"
    for unknown in sorted(map(str, dataset.variables.keys() - labels.variables.keys() - declared.keys())):
        yield f"{path}: no shard holds {unknown}: {_ANEW}"
    wrong = {name for name, variable in declared.items() if not _alike(variable, whole, dataset)}
    wrong |= {str(name) for name, label in labels.variables.items() if not _same(label, dataset.variables.get(name))}
    origins = Origins(selection.study)
    for variable, place, array in merged(whole, shards.read, origins):
        if variable.name not in wrong and not shards.problems():
            held = dataset.variables[variable.name][place].values
            if not np.array_equal(array, held, equal_nan=held.dtype.kind == "f"):
                wrong.add(variable.name)
    attributes = {name: variable_attributes(variable) for name, variable in declared.items()}
    attributes |= {str(name): label.attrs for name, label in labels.variables.items()}
    for name, right in attributes.items():
        if name in wrong:
            yield f"{path}: {name} is not what the shards hold: {_ANEW}"
        elif _plain(right) != _plain(dataset.variables[name].attrs):
            yield f"{path}: the attributes of {name} are not those of the study: {_ANEW}"
    for name, origin in origins.attributes().items():
        if not wrong and dataset.attrs.get(name, "") != origin:
            yield f"{path}: its {name} is not what the shards say: {_ANEW}"


def _alike(variable: Variable, whole: Table, dataset: xr.Dataset) -> bool:
    """Whether the dataset holds such a variable, of the shape that the shards make."""
    held = dataset.variables.get(variable.name)
    shape = tuple(whole.sizes[dim] for dim in variable.dims)
    return held is not None and (held.dims, held.shape, held.dtype) == (variable.dims, shape, variable.dtype)


def _plain(attributes: Mapping[Any, Any]) -> dict[str, list]:
    return {str(name): np.atleast_1d(value).tolist() for name, value in attributes.items()}


def _same(label: xr.Variable, held: xr.Variable | None) -> bool:
    # Words come back from a file in another dtype than they had.
    if held is None or not (label.dtype == held.dtype or label.dtype.kind in "UT"):
        return False
    return label.dims == held.dims and np.array_equal(label.values, held.values, equal_nan=held.dtype.kind == "f")


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
