"""From shards to the labelled dataset: the one place where names, units and meanings are put on arrays."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from critflow.result import IntegrityError, Status
from critflow.workflow.plan import Case, Selection
from critflow.workflow.provenance import Origins, dataset_attributes, dataset_versions, written_at
from critflow.workflow.store import SCHEMA_VERSION, read_shard, written_beside
from critflow.workflow.study import Variable

KEYWORDS = ("rigidity transition", "spring networks", "force density", "prestress stability")


def merge(selection: Selection, shards: Path) -> xr.Dataset:
    """All cases of the selection in one dataset; failed and missing ones are filled and say so in `status`."""
    table, origins = _Table(selection), Origins(selection.study)
    for case in selection.cases():
        shard = read_shard(shards, selection.study, case)
        if shard is not None:
            table.add(case, shard.status, shard.arrays)
            origins.add(case, shard.status, shard.checksum, shard.code, shard.environment)
    return table.labelled().assign_attrs(_told(origins.attributes()))


def write_dataset(dataset: xr.Dataset, path: Path, command: str) -> None:
    """Put the file in its place at once; its `history` is the one attribute that differs between equal runs."""
    dataset = dataset.assign_attrs(history=f"{written_at()} {command}")
    with written_beside(path) as partial:
        dataset.to_netcdf(partial, engine="netcdf4", format="NETCDF4")
        with xr.open_dataset(partial, engine="netcdf4") as written:
            if dict(written.sizes) != dict(dataset.sizes):
                raise OSError("it does not read back as written")


class _Table:
    """The arrays of a dataset while the cases are put in, each where its axis values say."""

    def __init__(self, selection: Selection):
        self.selection = selection
        self.variables = {variable.name: variable for variable in selection.study.variables}
        self.sizes = {name: len(values) for name, values in selection.axes.items()}
        self.sizes |= {c.name: len(selection.parameters[c.parameter]) for c in selection.study.coordinates}
        self.rows = {name: {value: row for row, value in enumerate(values)} for name, values in selection.axes.items()}
        self.arrays = {"status": self._filled(self.variables["status"])}
        self.given: set[tuple[str, tuple]] = set()  # what variables without some axis hold already

    def add(self, case: Case, status: Status, arrays: Mapping[str, np.ndarray]) -> None:
        for name, array in {**arrays, "status": np.array(status)}.items():
            variable = self.variables[name]
            for dim, size in zip(self.selection.study.inner_dims[name], array.shape, strict=True):
                if self.sizes.setdefault(dim, size) != size:
                    raise IntegrityError(
                        f"case {case.id} has {size} along {dim!r} in {name!r} where the cases before it have "
                        f"{self.sizes[dim]}: run sizes that differ as studies of their own"
                    )
            if name not in self.arrays:
                self.arrays[name] = self._filled(variable)
            rows = {dim: row[case.values[dim]] for dim, row in self.rows.items()}
            place = tuple(rows.get(dim, slice(None)) for dim in variable.dims)
            shared = len(variable.dims) - array.ndim < len(self.rows)
            where = (name, tuple(row for row in place if isinstance(row, int)))
            if shared and where in self.given:
                if self.arrays[name][place].tobytes() != array.tobytes():
                    raise IntegrityError(
                        f"case {case.id} gives another {name!r} than the cases that share it: mend the case function "
                        f"and raise the study's version"
                    )
                continue
            self.given.add(where)
            self.arrays[name][place] = array

    def labelled(self) -> xr.Dataset:
        study, parameters = self.selection.study, self.selection.parameters
        for variable in study.variables:
            for dim in variable.dims:
                self.sizes.setdefault(dim, 0)  # no case came far enough to tell
        coordinates = {
            axis.name: xr.Variable(axis.name, list(self.selection.axes[axis.name]), _meaning(axis.long_name, "1"))
            for axis in study.axes
        }
        for coordinate in study.coordinates:
            labels = np.asarray(parameters[coordinate.parameter])
            meaning = _meaning(coordinate.long_name, coordinate.units)
            coordinates[coordinate.name] = xr.Variable(coordinate.name, labels, meaning)
        for variable in study.variables:
            if variable.name not in self.arrays:
                self.arrays[variable.name] = self._filled(variable)
        data = {v.name: (v.dims, self.arrays[v.name], _attributes(v)) for v in study.variables}
        dataset = xr.Dataset(data, coordinates, self._global_attributes())
        for name, labelled in dataset.variables.items():
            # xarray would add a fill value to float coordinates, and turn integers with one into floats on reading.
            fills = name in data and labelled.dtype.kind == "f"
            labelled.encoding["_FillValue"] = labelled.dtype.type(np.nan) if fills else None
            if labelled.dtype.kind == "U":
                # Characters, not strings of variable length: those crash the library when a file is opened twice.
                labelled.encoding["dtype"] = "S1"
        return dataset

    def _filled(self, variable: Variable) -> np.ndarray:
        return np.full([self.sizes[dim] for dim in variable.dims], variable.filler, variable.dtype)

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
            "shards_sha256 is the SHA-256 of one line for each case, of its name and the checksum of its shard.",
            **dataset_attributes(study),
            "versions": json.dumps(versions),
            "study": study.name,
            "study_version": study.version,
            "schema_version": SCHEMA_VERSION,
            "axes": " ".join(study.axis_names),
            "parameters": json.dumps(dict(self.selection.parameters), sort_keys=True),
        }
        return _told(attributes)


def _told(attributes: Mapping[str, Any]) -> dict[str, Any]:
    """The attributes that say something."""
    return {name: value for name, value in attributes.items() if value != ""}


def _meaning(long_name: str, units: str, content: str = "coordinate") -> dict[str, Any]:
    """What every variable says of itself, `content` in the words of ACDD."""
    return {"long_name": long_name, "units": units, "coverage_content_type": content}


def _attributes(variable: Variable) -> dict[str, Any]:
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
