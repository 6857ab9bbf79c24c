"""From shards to the labelled dataset: the one place where names, units and meanings are put on arrays."""

from __future__ import annotations

import json
from collections.abc import Callable, Collection, Mapping
from typing import Any

import numpy as np
import xarray as xr

from critflow.linalg.backends import available_backends
from critflow.result import IntegrityError, Status
from critflow.workflow.plan import Case, Selection
from critflow.workflow.provenance import Origins, code_version, dataset_versions, source_tree
from critflow.workflow.seeds import SEED_ENTROPY
from critflow.workflow.store import SCHEMA_VERSION, Shard
from critflow.workflow.study import Variable

Reader = Callable[[Case], Shard | None]

KEYWORDS = ("rigidity transition", "spring networks", "force density", "prestress stability")


class Table:
    """The arrays of a dataset, or of a slab of it, while the cases are put in, each where its axis values say."""

    def __init__(self, selection: Selection, inner_sizes: Mapping[str, int] | None = None):
        """`inner_sizes` where they are known already."""
        self.selection = selection
        self.variables = {variable.name: variable for variable in selection.study.variables}
        self.sizes = {c.name: len(selection.parameters[c.parameter]) for c in selection.study.coordinates}
        self.sizes |= inner_sizes or {}
        self.sizes |= {name: len(values) for name, values in selection.axes.items()}
        self.rows = {name: {value: row for row, value in enumerate(values)} for name, values in selection.axes.items()}
        self.arrays: dict[str, np.ndarray] = {}
        self.given: set[tuple[str, tuple]] = set()  # what variables without some axis hold already

    def next_slab(self, selection: Selection, shared: Collection[str]) -> Table:
        """The table of the slab that follows; `shared` variables are filled and compared through all of them."""
        table = Table(selection, self.sizes)
        table.arrays = {name: array for name, array in self.arrays.items() if name in shared}
        table.given = {where for where in self.given if where[0] in shared}
        return table

    def take(self, read: Reader, origins: Origins) -> None:
        """Put in every case of the selection that is stored, and gather where they come from."""
        for batch in self.selection.batches():
            for case in batch:
                if (shard := read(case)) is not None:
                    self.add(case, shard.status, shard.arrays)
                    origins.add(case, shard.status, shard.checksum, shard.code, shard.environment)

    def add(self, case: Case, status: Status, arrays: Mapping[str, np.ndarray]) -> None:
        for name, array in {**arrays, "status": np.array(status)}.items():
            variable = self.variables[name]
            for dim, size in zip(self.selection.study.inner_dims[name], array.shape, strict=True):
                if self.sizes.setdefault(dim, size) != size:
                    raise IntegrityError(
                        f"case {case.id} has {size} along {dim!r} in {name!r} where the cases before it have "
                        f"{self.sizes[dim]}: run sizes that differ as studies of their own"
                    )
            rows = {dim: row[case.values[dim]] for dim, row in self.rows.items()}
            place = tuple(rows.get(dim, slice(None)) for dim in variable.dims)
            shared = len(variable.dims) - array.ndim < len(self.rows)
            where = (name, tuple(row for row in place if isinstance(row, int)))
            held = self.array(variable)
            if shared and where in self.given:
                if held[place].tobytes() != array.tobytes():
                    raise IntegrityError(
                        f"case {case.id} gives another {name!r} than the cases that share it: mend the case function "
                        f"and raise the study's version"
                    )
                continue
            self.given.add(where)
            held[place] = array

    def array(self, variable: Variable) -> np.ndarray:
        """What is there of a variable; fills where no case gave any."""
        if variable.name not in self.arrays:
            for dim in variable.dims:
                self.sizes.setdefault(dim, 0)  # no case came far enough to tell
            shape = [self.sizes[dim] for dim in variable.dims]
            self.arrays[variable.name] = np.full(shape, variable.filler, variable.dtype)
        return self.arrays[variable.name]

    def labels(self) -> xr.Dataset:
        """The dataset without its data: coordinates and attributes."""
        study, parameters = self.selection.study, self.selection.parameters
        coordinates = {
            axis.name: xr.Variable(axis.name, list(self.selection.axes[axis.name]), _meaning(axis.long_name, "1"))
            for axis in study.axes
        }
        for coordinate in study.coordinates:
            labels = np.asarray(parameters[coordinate.parameter])
            meaning = _meaning(coordinate.long_name, coordinate.units)
            coordinates[coordinate.name] = xr.Variable(coordinate.name, labels, meaning)
        return _encoded(xr.Dataset({}, coordinates, self._global_attributes()))

    def _global_attributes(self) -> dict[str, Any]:
        study, versions = self.selection.study, dataset_versions()
        sizes = " × ".join(
            f"{len(values)} {axis.key}" for axis, values in zip(study.axes, self.rows.values(), strict=True)
        )
        attributes = {
            "Conventions": "CF-1.11, ACDD-1.3",
            "title": study.title,
            "summary": f"{study.description or study.title} Here: {sizes}.",
            "keywords": ", ".join((*KEYWORDS, study.name.replace("_", " "))),
            "id": study.name,
            "product_version": str(study.version),
            "source": f"critflow {versions['critflow']}",
            "references": study.references,
            "comment": "Attributes named in volatile_attributes, and variables that say so, differ from run to run; "
            "shards_sha256 adds up, modulo 2**256, the SHA-256 of a line for each case: its name and its shard's "
            "checksum.",
            "code": code_version(study),
            **source_tree(),
            "sparse_solvers": " ".join(available_backends()),
            "seed_entropy": SEED_ENTROPY,
            "versions": json.dumps(versions),
            "study": study.name,
            "study_version": study.version,
            "schema_version": SCHEMA_VERSION,
            "axes": " ".join(study.axis_names),
            "parameters": json.dumps(dict(self.selection.parameters), sort_keys=True),
        }
        return told(attributes)


def _encoded(dataset: xr.Dataset) -> xr.Dataset:
    for labelled in dataset.variables.values():
        labelled.encoding["_FillValue"] = None  # xarray would add one to coordinates of decimals
        if labelled.dtype.kind == "U":
            # Characters, not strings of variable length: those crash the library when a file is opened twice.
            labelled.encoding["dtype"] = "S1"
    return dataset


def told(attributes: Mapping[str, Any]) -> dict[str, Any]:
    """The attributes that say something."""
    return {name: value for name, value in attributes.items() if value != ""}


def _meaning(long_name: str, units: str, content: str = "coordinate") -> dict[str, Any]:
    """What every variable says of itself, `content` in the words of ACDD."""
    return {"long_name": long_name, "units": units, "coverage_content_type": content}


def variable_attributes(variable: Variable) -> dict[str, Any]:
    content = "qualityInformation" if variable.flags is Status else "modelResult"
    attributes = _meaning(variable.long_name, variable.units, content)
    if variable.flags is not None:
        attributes["flag_values"] = np.array([flag.value for flag in variable.flags], variable.dtype)
        attributes["flag_meanings"] = " ".join(flag.name for flag in variable.flags)
    elif variable.fill is not None:
        attributes["value_if_missing"] = np.array(variable.fill, variable.dtype)[()]
    if variable.volatile:
        attributes["comment"] = "differs from run to run"
    return attributes
