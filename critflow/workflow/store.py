"""Stored cases: one shard for the complete cases of each value of the first axis, one text for each failed case.

A shard is a netCDF file (CDF-5) of named arrays; those that differ between its cases have the dimension `case`, and
the attribute `cases` lists the cases with their status and the code that computed each.  It ends with a seal, the
SHA-256 of all bytes before it, which netCDF tools ignore.  Every file is written under a temporary name, synced and
renamed, so that it is either complete or absent; a shard is also read back before it is renamed.  The seal is verified
before the netCDF library sees an array.
"""

from __future__ import annotations

import errno
import json
import os
import sys
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any, TypeVar
from uuid import uuid4

import netCDF4
import numpy as np

from critflow.result import EnvironmentFailure, IntegrityError, Status
from critflow.workflow.plan import SEED_ENTROPY, Case
from critflow.workflow.study import Study

SCHEMA_VERSION = 4
PARTIAL = ".partial"  # suffix of temporary files; no pattern for results matches it

_MARK = b"\nsealed sha256 "
_SEAL_LENGTH = len(_MARK) + 64
# Errors of the machine, which say nothing about the file; -61 is NC_ENOMEM of the netCDF library.
_MACHINE = {errno.EMFILE, errno.ENFILE, errno.ENOMEM, errno.EACCES, errno.EIO, errno.ESTALE, -61}
_netcdf = threading.Lock()  # the netCDF library is not thread-safe
_CASE = "stored_case"  # dimension

T = TypeVar("T")


class OtherTable(IntegrityError):
    """A complete shard of the case, stored with another table of variables than that of the study."""


@dataclass(frozen=True)
class Record:
    """What is stored about one case without its arrays."""

    values: Mapping[str, int | str]  # of the axes
    status: Status
    code: str  # code that computed it, and its libraries
    environment: str
    absent: tuple[str, ...] = ()  # variables that it does not have


@dataclass(frozen=True)
class Stored:
    """One complete case."""

    record: Record
    arrays: Mapping[str, np.ndarray]


@dataclass(frozen=True)
class Shard:
    """Contents of a shard: complete cases by their ids."""

    cases: Mapping[str, Stored]
    checksum: str


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A temporary file that replaces `path` if the block succeeds and is deleted otherwise."""
    partial = path.with_name(f".{path.name}.{uuid4().hex[:12]}{PARTIAL}")
    try:
        yield partial
        with open(partial, "rb+") as file:
            os.fsync(file.fileno())
        if path.is_dir():  # not ours to delete
            path.rename(path.with_name(f"{path.name}.{uuid4().hex[:12]}.set-aside"))
        os.replace(partial, path)
        descriptor = os.open(path.parent, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
    except (OSError, RuntimeError) as error:  # HDF5 and netCDF report a full disk as RuntimeError
        reason = getattr(error, "strerror", None) or str(error)
        advice = "free disk space, or choose another folder with --out"
        raise EnvironmentFailure(f"cannot write {path}: {reason}: {advice}") from error
    finally:
        partial.unlink(missing_ok=True)


def write_text(path: Path, text: str) -> None:
    with replacing(path) as partial:
        partial.write_text(text, encoding="utf-8")


def append_seal(path: Path) -> str:
    """End a file with the seal of its bytes; return the checksum."""
    checksum = _checksum(path, path.stat().st_size)
    with open(path, "ab") as file:
        file.write(_MARK + checksum.encode())
    return checksum


def verified_checksum(path: Path) -> str:
    """Checksum of a sealed file; `IntegrityError` unless the seal is that of its bytes."""
    try:
        if not path.is_file():  # reading a pipe would block
            raise IntegrityError(f"{path} is damaged: it is not a file")
        length = max(path.stat().st_size - _SEAL_LENGTH, 0)
        with open(path, "rb") as file:
            file.seek(length)
            seal = file.read()
        if not seal.startswith(_MARK):
            raise IntegrityError(f"{path} is damaged: it is cut short, its seal is missing")
        checksum = _checksum(path, length)
    except OSError as error:
        raise EnvironmentFailure(f"cannot read {path}: {error.strerror}: correct this and run again") from error
    if seal != _MARK + checksum.encode():
        raise IntegrityError(f"{path} is damaged: its contents do not match its checksum")
    return checksum


def _checksum(path: Path, length: int) -> str:
    """SHA-256 of the first bytes of a file, read in pieces."""
    whole = sha256()
    with open(path, "rb") as file:
        while piece := file.read(min(length, 2**20)):
            whole.update(piece)
            length -= len(piece)
    return whole.hexdigest()


def shard_path(folder: Path, case: Case) -> Path:
    return folder / f"{case.shard}.nc"


def write_shard(folder: Path, study: Study, case: Case, stored: Mapping[str, Stored]) -> str:
    """Store complete cases of one value of the first axis and return the checksum of their shard.

    case    one of them, which names the shard
    stored  cases by their ids, with arrays in the dtypes of the table

    The bytes depend on the cases alone, not on the order in which they were computed.
    """
    path, cases = shard_path(folder, case), _in_order(study, stored)
    with replacing(path) as partial:
        with _netcdf, netCDF4.Dataset(partial, "w", format="NETCDF3_64BIT_DATA") as file:
            file.set_fill_off()
            file.setncatts(_identity(study, case) | {"seed_entropy": SEED_ENTROPY})
            file.setncattr("cases", json.dumps({name: _attributes(one.record) for name, one in cases.items()}))
            file.createDimension(_CASE, len(cases))
            for name, (dims, array) in _joined(study, cases).items():
                for dim, size in zip(dims, array.shape, strict=True):
                    if dim not in file.dimensions:
                        file.createDimension(dim, size)
                file.createVariable(name, array.dtype, dims, fill_value=False)[...] = array
        checksum = append_seal(partial)
        written = _read(partial, study, case)
        if {name: _bytes(one) for name, one in written.cases.items()} != {k: _bytes(one) for k, one in cases.items()}:
            raise OSError("it does not read back as written")
    return checksum


def read_shard(folder: Path, study: Study, case: Case) -> Shard | None:
    """The shard that stores a case, every byte verified.

    None if it does not exist, `IntegrityError` if it is damaged.
    """
    path = shard_path(folder, case)
    return _read(path, study, case) if path.exists() else None


def read_records(folder: Path, study: Study, case: Case, verified: bool = False) -> dict[str, Record]:
    """The cases of the shard that stores a case, by their ids, without a look at its arrays.

    verified  read every byte of it
    """
    if verified:
        verified_checksum(shard_path(folder, case))
    return _opened(shard_path(folder, case), study, case, _records)


def sizes_of(study: Study, arrays: Mapping[str, np.ndarray]) -> dict[str, int]:
    """Sizes of the inner dimensions of a case."""
    return {
        dim: size
        for name, array in arrays.items()
        for dim, size in zip(study.inner_dims[name], array.shape, strict=True)
    }


def refuse_sizes(case_id: str, sizes: Mapping[str, int], known: Mapping[str, int]) -> None:
    """Raise `IntegrityError` where a case has other sizes than those before it."""
    for dim in sizes.keys() & known.keys():
        if sizes[dim] != known[dim]:
            lengths = f"length {sizes[dim]} in {dim!r}, cases before it {known[dim]}"
            advice = (
                "run each size into a folder of its own and join them (docs/howto/dataset.md, Several sizes), or "
                "store numbers alone with --set variables=scalars"
            )
            raise IntegrityError(f"case {case_id} has {lengths}: {advice}")


def refuse_misfit(study: Study, case: Case, arrays: Mapping[str, np.ndarray], others: Iterable[Stored]) -> None:
    """Raise `IntegrityError` where a case does not fit cases of its shard: other sizes, or other shared values."""
    for other in others:
        refuse_sizes(case.id, sizes_of(study, arrays), sizes_of(study, other.arrays))
        for name in _shared(study) & arrays.keys() & other.arrays.keys():
            if arrays[name].tobytes() != other.arrays[name].tobytes():
                advice = "correct the case function and raise the study's version"
                raise IntegrityError(f"case {case.id} gives another {name!r} than cases that share it: {advice}")


def _shared(study: Study) -> set[str]:
    """Variables that all cases of a shard share."""
    return {variable.name for variable in study.variables if set(study.axis_names[1:]).isdisjoint(variable.dims)}


def _read(path: Path, study: Study, case: Case) -> Shard:
    checksum = verified_checksum(path)
    return Shard(_opened(path, study, case, lambda file: _cases(study, file)), checksum)


def _opened(path: Path, study: Study, case: Case, read: Callable[[netCDF4.Dataset], T]) -> T:
    """What a function reads from a shard, which must be that of the case and the study."""
    try:
        with _netcdf, netCDF4.Dataset(path) as file:
            file.set_auto_maskandscale(False)
            for name, expected in _identity(study, case).items():
                if (value := file.getncattr(name)) != expected:
                    kind = OtherTable if name == "table" else IntegrityError  # compared last
                    raise kind(f"{path} is damaged: its {name} is {value}, not {expected}")
            return read(file)
    except (OSError, RuntimeError, ValueError, TypeError, LookupError, AttributeError) as error:
        if isinstance(error, OSError) and error.errno in _MACHINE:
            raise EnvironmentFailure(f"cannot read {path}: {error.strerror}: correct this and run again") from error
        raise IntegrityError(f"{path} is damaged: it is not a readable shard: {error}") from error


def _identity(study: Study, case: Case) -> dict[str, Any]:
    return {"schema_version": SCHEMA_VERSION, "study": study.name, "shard": case.shard, "table": study.table_digest}


def _attributes(record: Record) -> dict[str, Any]:
    return {**vars(record), "values": dict(record.values), "status": int(record.status)}


def _records(file: netCDF4.Dataset) -> dict[str, Record]:
    known = json.loads(file.getncattr("cases"))
    return {name: _record(**one) for name, one in known.items()}


def _record(values: dict[str, Any], status: int, code: str, environment: str, absent: list[str]) -> Record:
    # Texts that 10⁶ cases share are stored once.
    return Record(values, Status(status), sys.intern(code), sys.intern(environment), tuple(absent))


def _cases(study: Study, file: netCDF4.Dataset) -> dict[str, Stored]:
    """The cases of a shard with their arrays."""
    arrays = {name: np.asarray(variable[...]) for name, variable in file.variables.items()}
    each = {name for name, variable in file.variables.items() if _CASE in variable.dimensions}
    return {
        case: Stored(record, {k: a[n] if k in each else a for k, a in arrays.items() if k not in record.absent})
        for n, (case, record) in enumerate(_records(file).items())
    }


def _in_order(study: Study, stored: Mapping[str, Stored]) -> dict[str, Stored]:
    """The cases in the order of the values of their axes."""

    def place(name: str) -> list[tuple[int, str]]:
        values = stored[name].record.values
        return [axis.place(values[axis.name]) for axis in study.axes]

    return {name: stored[name] for name in sorted(stored, key=place)}


def _joined(study: Study, cases: Mapping[str, Stored]) -> dict[str, tuple[tuple[str, ...], np.ndarray]]:
    """The arrays of all cases and their dimensions; variables that all cases share stand once."""
    joined = {}
    for variable in study.variables:
        having = [one.arrays.get(variable.name) for one in cases.values()]
        known = next((array for array in having if array is not None), None)
        if known is None:
            continue
        dims = study.inner_dims[variable.name]
        if variable.name in _shared(study):
            joined[variable.name] = (dims, known)
        else:
            empty = np.full(known.shape, variable.filler, known.dtype)
            joined[variable.name] = ((_CASE, *dims), np.stack([empty if a is None else a for a in having]))
    return joined


def _bytes(stored: Stored) -> tuple[Record, dict[str, bytes]]:
    return stored.record, {name: array.tobytes() for name, array in stored.arrays.items()}


def failure_path(folder: Path, case: Case) -> Path:
    return folder / f"{case.id}.txt"


def delete_failure(folder: Path, case: Case) -> None:
    """Delete the text of a case that is computed again; a folder with its name is not ours to delete."""
    path = failure_path(folder, case)
    if not path.is_dir():
        path.unlink(missing_ok=True)


def last_line(text: str) -> str:
    """Reason at the end of a traceback."""
    return (text.strip().splitlines() or ["unknown reason"])[-1][:300]


def failure_reason(folder: Path, case: Case) -> str:
    """Reason of a failed case, empty if it has no text; for messages only: the existence of the text decides."""
    path = failure_path(folder, case)
    return last_line(path.read_text(encoding="utf-8", errors="replace")) if path.is_file() else ""
