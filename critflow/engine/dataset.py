"""The labelled dataset: the only place where names, units and meanings are applied to the arrays of cases."""

from __future__ import annotations

import inspect
import json
import math
import re
import sys
import textwrap
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from enum import IntEnum
from hashlib import sha256
from importlib.metadata import version
from itertools import groupby, islice
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np
import xarray as xr

from critflow.engine.code_digest import code_version, environment_versions, source_tree, timestamp
from critflow.engine.settings import SEED_ENTROPY, Case, Selection, spelled
from critflow.engine.store import (
    AT_ONCE,
    FAILED,
    SCHEMA_VERSION,
    CaseState,
    StoredCase,
    append_seal,
    dataset_files,
    persistent,
    read_shard,
    refuse_sizes,
    refuse_values,
    replacing,
    several,
    shard_path,
    sizes_of,
    verified_checksum,
)
from critflow.engine.study import VALID, Variable
from critflow.result import IntegrityError, Status, StudyError

REWRITE = "run the study again to write it"  # end of a message about a damaged or outdated file
SMALL = 2**29  # bytes of a dataset that may be in memory as a whole

_KEYWORDS = ("rigidity transition", "spring networks", "force density", "prestress stability")
_COMMENT = (
    "Attributes named in volatile_attributes, and variables with such a comment, differ from run to run; shards_sha256 "
    "adds up, modulo 2**256, the SHA-256 of a line for each stored network: the name and the checksum of its shard."
)
_ORIGINS = {  # of a case: a variable of the dataset where it differs
    "code": "code that computed the case",
    "environment": "interpreter, processor and libraries that computed the case",
}
_CHUNK = 2**24  # bytes of a chunk of the largest variable; a piece in memory is one chunk of each
_LARGEST_CHUNK = 2**26
_PART = 4 * 10**9  # bytes of a file
AS_ONE: Any = {"data_vars": "minimal", "coords": "minimal", "compat": "override"}  # of the parts of a dataset
_AHEAD = 2**27  # bytes of shards that are read before they are needed
_LAZY = 2**26  # bytes of a variable of a large dataset that is read in parts
_WIDTH, _MOST_OUTCOMES = 118, 10  # columns of the summary, and its lines about the outcomes


class Assembly:
    """The dataset of a selection in pieces along its first axis, so that one piece at a time is in memory.

    states  those of its cases; without a shard a case has fill values and the status `missing` or `failed`
    word    the study as a word of the command, its name by default

    Where the code of the cases differs there is a further variable, `code`; where their libraries do, `environment`.
    """

    def __init__(self, selection: Selection, shards: Path, states: Sequence[CaseState], word: str = ""):
        study, self.selection, self.shards = selection.study, selection, shards
        self.word = word or study.name
        self.records = {one.case.id: one.record for one in states if one.record}
        self.failed = {one.case.id for one in states if one.state == FAILED}
        self.origins = {name: sorted({getattr(one, name) for one in self.records.values()}) for name in _ORIGINS}
        self.first, self.variables = study.axis_names[0], study.variables
        self.undefined = [variable for variable in study.variables if variable.undefined_at]
        for name, texts in self.origins.items():
            if len(texts) > 1:
                self.variables = (*self.variables, _origin_variable(selection, name, texts, states))
        self.inner = {c.name: len(c.labels(selection.parameters)) for c in study.coordinates}  # sizes
        # Inner sizes are those of the first cases.
        dims = {dim for variable in self.variables for dim in variable.dims} - selection.axes.keys()
        cases, self.at_once = self._cases(), 1
        while not dims <= self.inner.keys() and next(cases, None):
            pass
        one_row = [
            np.dtype(v.dtype).itemsize * math.prod(self.shape(v, 1)) for v in self.variables if self.first in v.dims
        ]
        n_rows, row = len(selection.axes[self.first]), max(1, sum(one_row))
        self.rows = max(1, min(n_rows, _CHUNK // max(1, *one_row)))
        self.at_once = max(1, min(AT_ONCE, _AHEAD // row))
        # Numbers alone are one file; arrays are parts, each of whole pieces.
        self.part_rows = max(1, _PART // row // self.rows) * self.rows if any(study.inner_dims.values()) else n_rows

    def shape(self, variable: Variable, rows: int | None = None) -> tuple[int, ...]:
        """The shape of a variable, or of some rows of it; a size is 0 where no case has the variable."""
        sizes = self.inner | {name: len(values) for name, values in self.selection.axes.items()}
        sizes |= {} if rows is None else {self.first: rows}
        return tuple(sizes.get(dim, 0) for dim in variable.dims)

    def chunk(self, variable: Variable) -> tuple[int, ...] | None:
        """The chunk of a variable along the first axis, None for one without it or without values."""
        chunk = self.shape(variable, self.rows)
        if np.dtype(variable.dtype).itemsize * math.prod(chunk) > _LARGEST_CHUNK:
            sizes = zip(variable.dims, chunk, strict=True)
            chunk = tuple(1 if dim in self.selection.axes else size for dim, size in sizes)
        return chunk if self.first in variable.dims and 0 not in chunk else None

    def pieces(self) -> Iterator[tuple[slice, dict[str, np.ndarray]]]:
        """Rows of the first axis and the arrays of these rows; variables without this axis come with the last piece.

        Raises `IntegrityError` if inner sizes differ between cases, or values that cases share differ.
        """
        axes, cases = self.selection.axes, self._cases()
        n_rows, places = len(axes[self.first]), {name: {v: i for i, v in enumerate(axes[name])} for name in axes}
        whole = {v.name: self._empty(v) for v in self.variables if self.first not in v.dims}
        filled = set[tuple[str, tuple]]()  # places of variables without some axis
        for start in range(0, n_rows, self.rows):
            rows = slice(start, min(start + self.rows, n_rows))
            table = whole | {v.name: self._empty(v, rows.stop - start) for v in self.variables if self.first in v.dims}
            filled = {place for place in filled if place[0] in whole}
            for case, arrays in islice(cases, (rows.stop - start) * self.selection.count // n_rows):
                index = {name: places[name][value] for name, value in case.values.items()}
                index[self.first] -= start
                for name, dims in ((v.name, v.dims) for v in self.variables if v.name in arrays):
                    place = tuple(index.get(dim, slice(None)) for dim in dims)
                    outer = (name, tuple(one for one in place if isinstance(one, int)))
                    if len(outer[1]) < len(axes):
                        if outer in filled:
                            refuse_values(case, name, arrays[name], table[name][place])
                        filled.add(outer)
                    table[name][place] = arrays[name]
            last = rows.stop == n_rows
            yield rows, {name: array for name, array in table.items() if last or name not in whole}

    def _cases(self) -> Iterator[tuple[Case, dict[str, Any]]]:
        """Every case in order and what the dataset has of it; its shard stays in memory for the next one.

        Counts the cases by their outcome and environment, and adds up the checksums of the shards.  Raises
        `IntegrityError` if inner sizes differ between cases.
        """
        study, known, shard = self.selection.study, "", dict[str, StoredCase]()
        self.environments, self.checksum = Counter[str](), 0
        self.outcomes = Counter[tuple[str, Status, bool]]()  # by the word of the last axis
        stored_cases = (case for case in self.selection.cases if case.id in self.records)
        networks = (next(group) for _, group in groupby(stored_cases, lambda case: case.shard))
        read = several(lambda one: read_shard(shard_path(self.shards, one), study, one), networks, self.at_once)
        for case in self.selection.cases:
            status, sound = Status.failed if case.id in self.failed else Status.missing, False
            arrays = dict[str, Any]()
            if case.id in self.records:
                if case.shard != known:
                    (shard, checksum), known = next(read), case.shard
                    self.checksum += int.from_bytes(sha256(f"{known} {checksum}\n".encode()).digest())
                stored = shard[case.id]
                sizes = sizes_of(study, stored.arrays)
                refuse_sizes(case.id, sizes, self.inner)
                self.inner |= sizes
                self.environments[stored.environment] += 1
                status, sound = stored.status, stored.status in study.sound
                arrays = {
                    **stored.arrays,
                    VALID: np.array(sound),
                    **{k: np.array(texts.index(getattr(stored, k)), "i2") for k, texts in self.origins.items()},
                }
                for variable in (v for v in self.undefined if status in v.undefined_at and v.name in arrays):
                    arrays[variable.name] = np.full_like(arrays[variable.name], variable.filler)
            word = str([*case.values.values()][-1]) if study.axes[-1].is_words else ""
            self.outcomes[word, status, sound] += 1
            yield case, arrays if status is Status.missing else {**arrays, "status": np.asarray(status)}

    def coordinates(self) -> xr.Dataset:
        """The coordinates and attributes of the dataset."""
        selection, study, labelled = self.selection, self.selection.study, dict[str, xr.Variable]()
        for axis in study.axes:
            values = selection.axes[axis.name]
            labelled[axis.name] = xr.Variable(axis.name, list(values), _meaning(axis.long_name, "1"))
            for label in axis.labels:
                texts = [label.texts[word] for word in values]
                labelled[label.name] = xr.Variable(axis.name, texts, _meaning(label.long_name, "1"))
        for c in study.coordinates:
            labels = np.asarray(c.labels(selection.parameters))
            labelled[c.name] = xr.Variable(c.name, labels, _meaning(c.long_name, c.units))
        for one in labelled.values():
            one.encoding["_FillValue"] = None  # xarray would add one
            if one.dtype.kind == "U":
                # Fixed characters: the library crashes on strings of variable length in a file that is opened twice.
                one.encoding["dtype"] = "S1"
        libraries = {name: version(name) for name in ("critflow", "xarray", "netCDF4")}
        storing = {"netcdf-c": netCDF4.__netcdf4libversion__, "hdf5": netCDF4.__hdf5libversion__}
        attributes = {
            "Conventions": "CF-1.11, ACDD-1.3",
            "title": study.title,
            "keywords": ", ".join((*_KEYWORDS, study.name.replace("_", " "))),
            "id": study.name,
            "product_version": str(study.version),
            "source": f"critflow {libraries['critflow']}",
            "references": study.references,
            "comment": _COMMENT,
            "code": code_version(study),
            **source_tree(),
            "seed_entropy": SEED_ENTROPY,
            "versions": json.dumps(environment_versions() | libraries | storing),
            "study": study.name,
            "study_version": study.version,
            "schema_version": SCHEMA_VERSION,
            "axes": " ".join(study.axis_names),
            "parameters": json.dumps(dict(selection.parameters), sort_keys=True),
        }
        return xr.Dataset(coords=labelled, attrs={name: value for name, value in attributes.items() if value != ""})

    def variable_attributes(self, variable: Variable) -> dict[str, Any]:
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
        if variable.symbol:
            attributes["symbol"] = variable.symbol
        errors = {f"{variable.name}{ending}" for ending in ("_error_bound", "_standard_error")}
        if stored := [one.name for one in self.variables if one.name in errors]:
            attributes["ancillary_variables"] = " ".join(stored)
        return attributes

    def origin_attributes(self) -> dict[str, str]:
        """Checksum, code and environments of the shards of the pieces, known after the last one.

        The code that computed the cases may be older than the code that wrote the dataset.
        """
        volatile = " shards_sha256" * any(v.volatile for v in self.variables)
        codes = counted_cases(Counter(record.code for record in self.records.values()))
        attributes = {
            "summary": summary_text(self.word, self.selection, self.inner, self.outcomes, codes),
            "cases_code": codes,
            "cases_environment": counted_cases(self.environments),
            "shards_sha256": f"{self.checksum % 2**256:064x}",
            "volatile_attributes": f"history{volatile}",
        }
        return {name: value for name, value in attributes.items() if value != ""}

    def _empty(self, variable: Variable, rows: int | None = None) -> np.ndarray:
        return np.full(self.shape(variable, rows), variable.filler, variable.dtype)


def write_dataset(assembly: Assembly, path: Path, origin: Mapping[str, str]) -> None:
    """Write the file, or its parts, in pieces and read every byte of them back; all are put in place together.

    origin: attributes about the command that writes it, which is its `history`, the only one that differs between
    equal runs
    """
    stamped = assembly.coordinates().assign_attrs({**origin, "history": f"{timestamp()} {origin['history']}"})
    n_rows, size = stamped.sizes[assembly.first], assembly.part_rows
    parts = [slice(start, min(start + size, n_rows)) for start in range(0, n_rows, size)]
    files = [path.with_stem(f"{path.stem}-part{number:03}") for number in range(len(parts))] if parts[1:] else [path]
    stamped = stamped.assign_attrs(parts=len(parts)) if parts[1:] else stamped
    pieces, written = assembly.pieces(), [list[tuple[str, tuple, bytes]]() for _ in parts]
    whole = {variable.name for variable in assembly.variables if assembly.first not in variable.dims}
    with ExitStack() as stack:
        partials = [stack.enter_context(replacing(file)) for file in files]
        for partial, part, places in zip(partials, parts, written, strict=True):
            stamped.isel({assembly.first: part}).to_netcdf(partial, engine="netcdf4", format="NETCDF4")
            with netCDF4.Dataset(partial, "a") as file:
                _declare(assembly, file, part.stop - part.start)
                for rows, arrays in pieces:
                    shared = {name: arrays.pop(name) for name in whole & arrays.keys()}  # with the last piece
                    here = slice(rows.start - part.start, rows.stop - part.start)
                    _fill(file, (assembly.first, here), arrays, places)
                    if rows.stop == part.stop:
                        break
        for partial, places in zip(partials, written, strict=True):
            with netCDF4.Dataset(partial, "a") as file:
                _fill(file, ("", slice(None)), shared, places)
                file.setncatts(assembly.origin_attributes())
            with netCDF4.Dataset(partial) as file:
                file.set_auto_maskandscale(False)
                if any(sha256(file[name][place].tobytes()).digest() != digest for name, place, digest in places):
                    raise OSError("it does not read back as written")
            append_seal(partial)
        for other in {*dataset_files(path)} - {*files}:
            other.unlink()


def _declare(assembly: Assembly, file: netCDF4.Dataset, n_rows: int) -> None:
    """The dimensions and variables of a file with these rows of the first axis."""
    for variable in assembly.variables:
        shape = assembly.shape(variable, n_rows)
        for dim, size in zip(variable.dims, shape, strict=True):
            if dim not in file.dimensions:
                file.createDimension(dim, size)
        # In chunks along the first axis; integers are compressed, which repeat.
        number = variable.dtype[0] == "f"
        options: dict[str, Any] = {"fill_value": np.nan if number else None}
        if chunk := assembly.chunk(variable):
            options["chunksizes"] = [min(pair) for pair in zip(chunk, shape, strict=True)]
            options |= {} if number else {"compression": "zlib", "complevel": 1, "shuffle": True}
        created = file.createVariable(variable.name, variable.dtype, variable.dims, **options)
        created.setncatts(assembly.variable_attributes(variable))


def _fill(
    file: netCDF4.Dataset,
    rows: tuple[str, slice],
    arrays: Mapping[str, np.ndarray],
    places: list[tuple[str, tuple, bytes]],
) -> None:
    """Write arrays at these rows of an axis, and note the place and the digest of each."""
    file.set_auto_maskandscale(False)
    for name, array in arrays.items():
        place = (*(rows[1] if dim == rows[0] else slice(None) for dim in file[name].dimensions),)
        file[name][place] = array
        places.append((name, place, sha256(array.tobytes()).digest()))


def _origin_variable(selection: Selection, name: str, texts: Sequence[str], states: Sequence[CaseState]) -> Variable:
    """The variable that tells cases of different code or libraries apart, along the fewest axes that do."""
    known = [(one.case.values, getattr(one.record, name)) for one in states if one.record]
    dims = next(variable for variable in selection.study.variables if variable.name == "status").dims
    for axis in dims:
        fewer = tuple(dim for dim in dims if dim != axis)
        labelled = {(tuple(values[dim] for dim in fewer), text) for values, text in known}
        if len({place for place, _ in labelled}) == len(labelled):
            dims = fewer
    flags = IntEnum(name, [(re.sub(r"\W+", "_", text), n) for n, text in enumerate(texts)])  # type: ignore[misc]
    return Variable(name, dims, "i2", long_name=_ORIGINS[name], flags=flags, fill=-1)


@contextmanager
def opened_dataset(path: Path) -> Iterator[xr.Dataset]:
    """A dataset of `critflow run`, or all its parts as one, every byte verified; one message if it cannot be read."""
    if not (files := dataset_files(path)):
        raise StudyError(f"there is no dataset {path}: run the study first")
    with ExitStack() as stack:
        try:
            for _ in several(persistent(verified_checksum), files):
                pass
            # All variables of a large dataset, read one after the other, may not fit in memory together.
            small = sum(file.stat().st_size for file in files) < SMALL
            chunks: Any = None if small or len(files) == 1 else {}
            parts = [
                stack.enter_context(xr.open_dataset(file, engine="netcdf4", cache=small, chunks=chunks))
                for file in files
            ]
            axis = str(parts[0].attrs.get("axes", "")).partition(" ")[0]
            dataset = parts[0] if len(parts) == 1 else xr.concat(parts, axis, combine_attrs="no_conflicts", **AS_ONE)
            if not small:
                in_memory = {k: v.compute() for k, v in dataset.data_vars.items() if v.chunks and v.nbytes <= _LAZY}
                large = {k: v.chunk("auto") for k, v in dataset.data_vars.items() if v.nbytes > _LAZY}
                dataset = dataset.assign(in_memory | large)
        except IntegrityError as error:
            raise IntegrityError(f"{error}: {REWRITE}") from error
        except (OSError, RuntimeError, ValueError) as error:
            raise IntegrityError(f"{path} is not a readable dataset: {error}: {REWRITE}") from error
        if not {"study", "axes"} <= dataset.attrs.keys() or "status" not in dataset:
            raise IntegrityError(f"{path} was not written by `critflow run`: it has no study and no status")
        if (schema := int(dataset.attrs.get("schema_version", 0))) != SCHEMA_VERSION:
            raise StudyError(f"{path} has schema {schema}, not {SCHEMA_VERSION}: run the study in a new folder")
        if (number := int(dataset.attrs.get("parts", 1))) != len(files):
            raise IntegrityError(f"{path} has {len(files)} of its {number} parts: {REWRITE}")
        yield dataset


def counted_cases(texts: Counter[str]) -> str:
    return "; ".join(f"{text}: {count} cases" for text, count in sorted(texts.items()))


def _meaning(long_name: str, units: str, content: str = "coordinate") -> dict[str, Any]:
    return {"long_name": long_name, "units": units, "coverage_content_type": content}


def summary_text(
    word: str,
    selection: Selection,
    sizes: Mapping[str, int],
    outcomes: Mapping[tuple[str, Status, bool], int],
    codes: str,
) -> str:
    """What a dataset is, how and by which code it was made, what is missing, and how to select valid members.

    word      the study as a word of the command
    sizes     of the inner dimensions
    outcomes  number of cases by the value of the last axis, the status, and whether their numbers are sound
    codes     the code that computed the cases, with their numbers

    It is the attribute `summary`, which `critflow show FILE` prints.
    """
    study = selection.study
    inner = ", ".join(f"{size} {name}" for name, size in sizes.items())
    about = inspect.getdoc(sys.modules.get(getattr(study.case, "__module__", ""))) or ""  # of the study file
    changed = {axis.key: selection.axes[axis.name] for axis in study.axes if selection.axes[axis.name] != axis.values}
    changed |= {k: v for k, v in selection.parameters.items() if v != study.parameters[k]}
    changed |= {"variables": study.selected} if study.selected else {}
    words = ("critflow run", word, *(f"--set {key}={spelled(value)}" for key, value in changed.items()))
    settings = ", ".join(f"{key}={spelled(value)}" for key, value in selection.parameters.items())
    lines = [
        f"{study.title} (study {study.name}, version {study.version})",
        *(part for line in about.splitlines() for part in textwrap.wrap(line, _WIDTH) or [""]),
        f"cases: {selection.sizes} = {selection.count}{f'; in each {inner}' if inner else ''}",
        *textwrap.wrap(f"made by: {' '.join(words)}", _WIDTH, subsequent_indent="  "),
        *textwrap.wrap(f"settings: {settings or 'none'}", _WIDTH, subsequent_indent="  ", max_lines=3),
        *textwrap.wrap(f"code: {codes or 'none'}", _WIDTH, subsequent_indent="  "),
        *_outcome_lines(study.axes[-1].name, outcomes),
    ]
    names = {variable.name for variable in study.variables}
    numbers = [v.name for v in study.variables if v.dtype[0] == "f" and set(v.dims) == set(study.axis_names)][:2]
    if numbers:
        lines.append(f"valid members: ds[{numbers}].where(ds.valid); the whole dataset is not masked")
    if {"edges", "offsets", "cell", "position"} <= names:
        one = {axis.name: selection.axes[axis.name][-1] for axis in study.axes}
        chosen = ", ".join(f"{name}={value!r}" for name, value in one.items())
        lines.append(f"one network: cf.read_network(ds.sel({chosen}))")
        lines.append(f"its figure: critflow show FILE {' '.join(f'--set {k}={value}' for k, value in one.items())}")
    return "\n".join(lines)


def _outcome_lines(axis: str, outcomes: Mapping[tuple[str, Status, bool], int]) -> list[str]:
    """Numbers of cases by status, ok first and others marked if valid, with a line for each word of the last axis."""
    rows: dict[str, Counter[str]] = {}
    for (group, status, sound), count in outcomes.items():
        name = f"{status.name}{', valid' * (sound and status is not Status.ok)}"
        rows.setdefault(group, Counter())[name] += count
    counted = {
        group: ", ".join(f"{count} {name}" for name, count in sorted(row.items(), key=lambda one: one[0] != "ok"))
        for group, row in rows.items()
    }
    if len(set(counted.values())) == 1:
        each = f" of each {axis}" if len(counted) > 1 else ""
        return [f"outcomes: {next(iter(counted.values()))}{each}"]
    lines = [f"  {group}: {text}" for group, text in counted.items()]
    more = [f"  and {len(lines) - _MOST_OUTCOMES} more"] if len(lines) > _MOST_OUTCOMES else []
    return ["outcomes:", *lines[:_MOST_OUTCOMES], *more]
