"""The labelled dataset: the only place where names, units and meanings are applied to the arrays of cases."""

from __future__ import annotations

import json
import math
import re
import zlib
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from enum import IntEnum
from hashlib import sha256
from pathlib import Path
from typing import Any

import dask.array
import netCDF4
import numpy as np
import xarray as xr

from critflow.result import IntegrityError, Status, StudyError
from critflow.workflow.code import code_version
from critflow.workflow.description import summary_text
from critflow.workflow.folder import FAILED, CaseState
from critflow.workflow.plan import SEED_ENTROPY, Case, Selection
from critflow.workflow.provenance import dataset_versions, source_tree, timestamp
from critflow.workflow.store import (
    SCHEMA_VERSION,
    Shard,
    Stored,
    append_seal,
    read_shard,
    refuse_sizes,
    replacing,
    sizes_of,
    verified_checksum,
)
from critflow.workflow.study import Variable

REWRITE = "run the study again to write it"  # end of a message about a damaged or outdated file

_KEYWORDS = ("rigidity transition", "spring networks", "force density", "prestress stability")
_COMMENT = (
    "Attributes named in volatile_attributes, and variables with such a comment, differ from run to run; shards_sha256 "
    "adds up, modulo 2**256, the SHA-256 of a line for each stored network: the name and the checksum of its shard."
)
SMALL = 2**29  # bytes of a dataset that may be in memory as a whole
_PIECE = 2**26  # bytes of a dataset in memory at once
_CHUNK = 2**24  # bytes of a chunk of the largest variable
_LARGEST_CHUNK = 2**26
_SAMPLE = 2**20  # bytes on which compression is tried, and those below which it is not
_TOO_FEW = 2**12
_SAVED = 0.2  # the least part of the bytes that compression must save


class Assembly:
    """The dataset of a selection in pieces along its first axis, so that one piece at a time is in memory.

    states  those of its cases; without a shard a case has fill values and the status `missing` or `failed`

    Cases of different code have a further variable, `code`.
    """

    def __init__(self, selection: Selection, shards: Path, states: Sequence[CaseState]):
        self.selection, self.shards = selection, shards
        self.records = {one.case.id: one.record for one in states if one.record}
        self.failed = {one.case.id for one in states if one.state == FAILED}
        self.first, self.variables = selection.study.axis_names[0], selection.study.variables
        self.codes = sorted({record.code for record in self.records.values()})
        if len(self.codes) > 1:
            self.variables = (*self.variables, _code_variable(selection, self.codes, states))
        self.sizes = {c.name: len(selection.parameters[c.parameter]) for c in selection.study.coordinates}
        self.grouped = selection.study.axes[-1].is_words
        self._shard: tuple[str, Shard | None] = ("", None)
        self._begin_origins()

    def pieces(self) -> Iterator[tuple[slice, dict[str, np.ndarray]]]:
        """Rows of the first axis and the arrays of these rows; variables without this axis come with the last piece.

        Raises `IntegrityError` if inner sizes differ between cases, or values that cases share differ.
        """
        self._begin_origins()
        values, n = self.selection.axes[self.first], self._rows()
        whole = {v.name: self._empty(v, self.selection) for v in self.variables if self.first not in v.dims}
        filled = set[tuple[str, tuple]]()  # places of variables without some axis
        for start in range(0, len(values), n):
            part = replace(self.selection, axes={**self.selection.axes, self.first: values[start : start + n]})
            rows = {v.name: self._empty(v, part) for v in self.variables if self.first in v.dims}
            filled = {place for place in filled if place[0] in whole}
            places = {name: {value: i for i, value in enumerate(values)} for name, values in part.axes.items()}
            for case in part.cases():
                status, sound = (Status.failed if case.id in self.failed else Status.missing), False
                if case.id in self.failed:
                    self._insert(case, {"status": np.asarray(Status.failed)}, rows | whole, places, filled)
                elif stored := self._stored(case):
                    code = {"code": np.array(self.codes.index(stored.record.code), "i2")} if len(self.codes) > 1 else {}
                    status, sound = stored.record.status, bool(np.all(stored.arrays.get("valid", False)))
                    self.environments[stored.record.environment] += 1
                    arrays = {**stored.arrays, "status": np.asarray(status), **code}
                    self._insert(case, arrays, rows | whole, places, filled)
                self.outcomes[str([*case.values.values()][-1]) if self.grouped else "", status, sound] += 1
            last = start + n >= len(values)
            yield slice(start, start + len(part.axes[self.first])), rows | whole if last else rows

    def template(self) -> xr.Dataset:
        """The dataset with its sizes, coordinates and attributes, and lazy fill values in place of the variables."""
        self._rows()
        data = {}
        for variable in self.variables:
            shape = self._shape(variable, self.selection)
            empty = dask.array.full(shape, variable.filler, dtype=variable.dtype, chunks=-1)
            data[variable.name] = xr.Variable(variable.dims, empty, variable_attributes(variable))
        attributes = {name: value for name, value in _global_attributes(self.selection).items() if value != ""}
        for bounded in {
            name.removesuffix("_error_bound") for name in data if name.endswith("_error_bound")
        } & data.keys():
            data[bounded].attrs["ancillary_variables"] = f"{bounded}_error_bound"
        coordinates = {
            axis.name: xr.Variable(axis.name, list(self.selection.axes[axis.name]), _meaning(axis.long_name, "1"))
            for axis in self.selection.study.axes
        }
        for axis in self.selection.study.axes:
            for label in axis.labels:
                texts = [label.texts[word] for word in self.selection.axes[axis.name]]
                coordinates[label.name] = xr.Variable(axis.name, texts, _meaning(label.long_name, "1"))
        for c in self.selection.study.coordinates:
            labels = np.asarray(self.selection.parameters[c.parameter])
            coordinates[c.name] = xr.Variable(c.name, labels, _meaning(c.long_name, c.units))
        dataset = xr.Dataset(data, coordinates, attributes)
        for labelled in dataset.coords.values():
            labelled.encoding["_FillValue"] = None  # xarray would add one
            if labelled.dtype.kind == "U":
                # Fixed characters: the library crashes on strings of variable length in a file that is opened twice.
                labelled.encoding["dtype"] = "S1"
        return dataset

    def origin_attributes(self) -> dict[str, str]:
        """Checksum, code and environments of the shards of the pieces, known after the last one.

        The code that computed the cases may be older than the code that wrote the dataset.
        """
        volatile = " shards_sha256" * any(v.volatile for v in self.variables)
        codes = _counted(Counter(record.code for record in self.records.values()))
        attributes = {
            "summary": summary_text(self.selection, self.sizes, self.outcomes, codes),
            "cases_code": codes,
            "cases_environment": _counted(self.environments),
            "shards_sha256": f"{self.checksum % 2**256:064x}",
            "volatile_attributes": f"history{volatile}",
        }
        return {name: value for name, value in attributes.items() if value != ""}

    def chunk(self, variable: Variable) -> tuple[int, ...] | None:
        """The chunk of a variable along the first axis, None for one without it or without values."""
        shape = self._shape(variable, self.selection)
        if self.first not in variable.dims or 0 in shape:
            return None
        chunk = [
            self._chunk_rows() if dim == self.first else size for dim, size in zip(variable.dims, shape, strict=True)
        ]
        if np.dtype(variable.dtype).itemsize * math.prod(chunk) > _LARGEST_CHUNK:
            outer = self.selection.axes
            chunk = [1 if dim in outer else size for dim, size in zip(variable.dims, chunk, strict=True)]
        return tuple(chunk)

    def _begin_origins(self) -> None:
        self.environments, self.checksum, self._shard = Counter[str](), 0, ("", None)
        self.outcomes = Counter[tuple[str, Status, bool]]()  # by the word of the last axis

    def _stored(self, case: Case) -> Stored | None:
        """A complete case; its shard stays in memory for the next one."""
        if case.id not in self.records:
            return None
        if self._shard[0] != case.shard:
            shard = read_shard(self.shards, self.selection.study, case)
            self._shard = (case.shard, shard)
            if shard:
                self.checksum += int.from_bytes(sha256(f"{case.shard} {shard.checksum}\n".encode()).digest())
        return self._shard[1].cases.get(case.id) if self._shard[1] else None

    def _rows(self) -> int:
        """Rows of a piece of about `_PIECE` bytes, in whole chunks; inner sizes are those of the first cases."""
        for case in self.selection.cases():
            if all(dim in {*self.sizes, *self.selection.axes} for variable in self.variables for dim in variable.dims):
                break
            if stored := self._stored(case):
                self._measure(case, stored.arrays)
        self._begin_origins()
        chunk = self._chunk_rows()
        return chunk * max(1, _PIECE // max(sum(self._row_bytes()) * chunk, 1))

    def _chunk_rows(self) -> int:
        return max(1, min(len(self.selection.axes[self.first]), _CHUNK // max(1, *self._row_bytes())))

    def _row_bytes(self) -> list[int]:
        """Bytes of one value of the first axis, of each variable that has this axis."""
        one = replace(self.selection, axes={**self.selection.axes, self.first: (0,)})
        of_first = [variable for variable in self.variables if self.first in variable.dims]
        return [np.dtype(v.dtype).itemsize * math.prod(self._shape(v, one)) for v in of_first]

    def _shape(self, variable: Variable, part: Selection) -> tuple[int, ...]:
        """The shape of a variable in a part of the cases; a size is 0 where no case has the variable."""
        sizes = self.sizes | {name: len(values) for name, values in part.axes.items()}
        return tuple(sizes.get(dim, 0) for dim in variable.dims)

    def _empty(self, variable: Variable, part: Selection) -> np.ndarray:
        return np.full(self._shape(variable, part), variable.filler, variable.dtype)

    def _measure(self, case: Case, arrays: Mapping[str, np.ndarray]) -> None:
        """Take the inner sizes of a case, and refuse those that differ."""
        sizes = sizes_of(self.selection.study, {k: a for k, a in arrays.items() if k not in ("status", "code")})
        refuse_sizes(case.id, sizes, self.sizes)
        self.sizes |= sizes

    def _insert(
        self,
        case: Case,
        arrays: Mapping[str, np.ndarray],
        table: Mapping[str, np.ndarray],
        places: Mapping[str, Mapping[int | str, int]],
        filled: set[tuple[str, tuple]],
    ) -> None:
        """Insert the arrays of one case at the place of its axis values."""
        self._measure(case, arrays)
        for variable in self.variables:
            if (name := variable.name) not in arrays:
                continue
            where = {dim: places[dim][case.values[dim]] for dim in variable.dims if dim in places}
            place, array = tuple(where.get(dim, slice(None)) for dim in variable.dims), arrays[name]
            if len(where) < len(places):
                known = (name, tuple(where.values()))
                if known in filled and table[name][place].tobytes() != array.tobytes():
                    advice = "correct the case function and raise the study's version"
                    raise IntegrityError(f"case {case.id} gives another {name!r} than cases that share it: {advice}")
                filled.add(known)
            table[name][place] = array


def write_dataset(assembly: Assembly, path: Path, origin: Mapping[str, str]) -> dict[str, str]:
    """Write the file in pieces and read every byte of them back; return the attributes about its shards.

    origin: attributes about the command that writes it, which is its `history`, the only one that differs between
    equal runs
    """
    template, written = assembly.template(), list[tuple[str, tuple, bytes]]()
    stamped = template.coords.to_dataset().assign_attrs(
        {**template.attrs, **origin, "history": f"{timestamp()} {origin['history']}"}
    )
    with replacing(path) as partial:
        stamped.to_netcdf(partial, engine="netcdf4", format="NETCDF4")
        with netCDF4.Dataset(partial, "a") as file:
            for rows, arrays in assembly.pieces():
                if not written:
                    _create_variables(file, assembly, template, arrays)
                for name, array in arrays.items():
                    place = (*(rows if dim == assembly.first else slice(None) for dim in file[name].dimensions),)
                    file[name][place] = array
                    written.append((name, place, sha256(array.tobytes()).digest()))
            attributes = assembly.origin_attributes()
            file.setncatts(attributes)
        with netCDF4.Dataset(partial) as file:
            file.set_auto_maskandscale(False)
            if any(sha256(file[name][place].tobytes()).digest() != digest for name, place, digest in written):
                raise OSError("it does not read back as written")
        append_seal(partial)
    return attributes


def _create_variables(
    file: netCDF4.Dataset, assembly: Assembly, template: xr.Dataset, first: Mapping[str, np.ndarray]
) -> None:
    """Create the variables of a file, in chunks along the first axis, compressed where the first piece shows a gain."""
    for variable in assembly.variables:
        name, empty = variable.name, template[variable.name]
        for dim in [dim for dim in variable.dims if dim not in file.dimensions]:
            file.createDimension(dim, empty.sizes[dim])
        options: dict[str, Any] = {"fill_value": np.nan if empty.dtype.kind == "f" else None}
        if chunk := assembly.chunk(variable):
            options["chunksizes"] = chunk
            if name in first and _saves(first[name]):
                options |= {"compression": "zlib", "complevel": 4, "shuffle": True}
        file.createVariable(name, empty.dtype, variable.dims, **options).setncatts(empty.attrs)
    file.set_auto_maskandscale(False)


def _saves(array: np.ndarray) -> bool:
    """Whether compression saves enough of the bytes at the start of an array."""
    if array.nbytes < _TOO_FEW:
        return False
    flat = array.ravel()[: _SAMPLE // array.dtype.itemsize]
    shuffled = flat.view(np.uint8).reshape(-1, array.dtype.itemsize).T.tobytes()
    return len(zlib.compress(shuffled, 4)) < (1 - _SAVED) * len(shuffled)


def _code_variable(selection: Selection, codes: Sequence[str], states: Sequence[CaseState]) -> Variable:
    """The variable that tells cases of different code apart, along the fewest axes that do."""
    known = [(one.case.values, one.record.code) for one in states if one.record]
    status = next(variable for variable in selection.study.variables if variable.name == "status")
    dims = status.dims
    for axis in status.dims:
        fewer = tuple(dim for dim in dims if dim != axis)
        if len({tuple(values[dim] for dim in fewer) for values, _ in known}) == len(
            {(*(values[dim] for dim in fewer), code) for values, code in known}
        ):
            dims = fewer
    flags = IntEnum("Code", [(re.sub(r"\W+", "_", code), n) for n, code in enumerate(codes)])  # type: ignore[misc]
    return Variable("code", dims, "i2", long_name="code that computed the case", flags=flags, fill=-1)


@contextmanager
def opened_dataset(path: Path) -> Iterator[xr.Dataset]:
    """A dataset of `critflow run`, every byte verified; one message if it cannot be read."""
    if not path.exists():
        raise StudyError(f"there is no dataset {path}: run the study first")
    try:
        verified_checksum(path)
        # All variables of a large dataset, read one after the other, may not fit in memory together.
        small = path.stat().st_size < SMALL
        dataset = xr.open_dataset(path, engine="netcdf4", cache=small)
        if not small:
            dataset = dataset.assign({k: v.chunk("auto") for k, v in dataset.data_vars.items() if v.nbytes > _PIECE})
    except IntegrityError as error:
        raise IntegrityError(f"{error}: {REWRITE}") from error
    except (OSError, RuntimeError, ValueError) as error:
        raise IntegrityError(f"{path} is not a readable dataset: {error}: {REWRITE}") from error
    with dataset:
        if not {"study", "axes"} <= dataset.attrs.keys() or "status" not in dataset:
            raise IntegrityError(f"{path} was not written by `critflow run`: it has no study and no status")
        if (schema := int(dataset.attrs.get("schema_version", 0))) != SCHEMA_VERSION:
            advice = (
                "the page docs/howto/dataset.md has the function that converts it; or run the study in a new folder"
            )
            raise StudyError(f"{path} has schema {schema}, not {SCHEMA_VERSION}: {advice}")
        if (schema := int(dataset.attrs.get("schema_version", 0))) < SCHEMA_VERSION:
            raise StudyError(
                f"{path} has the names of schema {schema}, and this is schema {SCHEMA_VERSION}: convert it with the "
                "function in docs/howto/dataset.md (Files of schema 3), or run the study again with another --out"
            )
        yield dataset


def variable_attributes(variable: Variable) -> dict[str, Any]:
    """Attributes of a variable after the CF and ACDD conventions."""
    content = "qualityInformation" if variable.flags is Status else "modelResult"
    attributes = _meaning(variable.long_name, variable.units, content)
    if variable.flags is not None:
        attributes["flag_values"] = np.array([flag.value for flag in variable.flags], variable.dtype)
        attributes["flag_meanings"] = " ".join(flag.name for flag in variable.flags)
    elif variable.fill is not None:
        attributes["value_if_missing"] = np.array(variable.fill, variable.dtype)[()]
    if comment := "; ".join(filter(None, (variable.comment, "differs from run to run" * variable.volatile))):
        attributes["comment"] = comment
    return attributes


def _counted(texts: Counter[str]) -> str:
    return "; ".join(f"{text}: {count} cases" for text, count in sorted(texts.items()))


def _global_attributes(selection: Selection) -> dict[str, Any]:
    study, versions = selection.study, dataset_versions()
    return {
        "Conventions": "CF-1.11, ACDD-1.3",
        "title": study.title,
        "keywords": ", ".join((*_KEYWORDS, study.name.replace("_", " "))),
        "id": study.name,
        "product_version": str(study.version),
        "source": f"critflow {versions['critflow']}",
        "references": study.references,
        "comment": _COMMENT,
        "code": code_version(study),
        **source_tree(),
        "seed_entropy": SEED_ENTROPY,
        "versions": json.dumps(versions),
        "study": study.name,
        "study_version": study.version,
        "schema_version": SCHEMA_VERSION,
        "axes": " ".join(study.axis_names),
        "parameters": json.dumps(dict(selection.parameters), sort_keys=True),
    }


def _meaning(long_name: str, units: str, content: str = "coordinate") -> dict[str, Any]:
    return {"long_name": long_name, "units": units, "coverage_content_type": content}
