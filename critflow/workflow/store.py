"""Files that are either complete or absent: one shard per case.

A shard is a netCDF file in the plain CDF-5 layout, which is read and written two to five times faster than HDF5 at
these sizes.  It is written beside its place, closed, read back, synced and renamed, so a crash leaves no half shard;
a checksum over names, dimensions, types and bytes is verified on every read.
"""

from __future__ import annotations

import json
import os
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any
from uuid import uuid4

import netCDF4
import numpy as np

from critflow.result import EnvironmentFailure, IntegrityError, Status
from critflow.workflow.plan import Case
from critflow.workflow.study import Study

SCHEMA_VERSION = 1
PARTIAL = ".partial"  # no glob for results matches it

_END = "complete"  # the last variable of every shard: a file cut anywhere reads 0 here
_netcdf = threading.Lock()  # the netCDF library is not thread-safe


@dataclass(frozen=True)
class Shard:
    """What is stored of one case."""

    status: Status
    arrays: Mapping[str, np.ndarray]
    checksum: str
    error: str = ""  # the traceback of a failed case


@contextmanager
def written_beside(path: Path) -> Iterator[Path]:
    """A file to write that takes the place of `path` when the block ends well, and vanishes when it does not."""
    partial = path.with_name(f".{path.name}.{uuid4().hex[:12]}{PARTIAL}")
    try:
        yield partial
        with open(partial, "rb+") as file:
            os.fsync(file.fileno())
        os.replace(partial, path)
        _sync_folder(path.parent)
    except (OSError, RuntimeError) as error:  # HDF5 and netCDF report a full disk as RuntimeError
        reason = getattr(error, "strerror", None) or str(error)
        raise EnvironmentFailure(
            f"cannot write {path}: {reason}: make room there, or choose another folder with --out"
        ) from error
    finally:
        partial.unlink(missing_ok=True)


def write_text(path: Path, text: str) -> None:
    with written_beside(path) as partial:
        partial.write_text(text, encoding="utf-8")


def shard_path(folder: Path, case: Case) -> Path:
    return folder / f"{case.id}.nc"


def write_shard(
    folder: Path, study: Study, case: Case, status: Status, arrays: Mapping[str, np.ndarray], error: str = ""
) -> str:
    """Store one case and return its checksum."""
    path = shard_path(folder, case)
    if path.is_dir():  # not ours to delete
        path.rename(path.with_name(f"{path.name}.{uuid4().hex[:12]}.set-aside"))
    dims = {variable.name: study.inner_dims(variable) for variable in study.variables}
    attributes = {
        "study": study.name,
        "case_id": case.id,
        "schema_version": SCHEMA_VERSION,
        "status": int(status),
        "error": error,
    }
    with written_beside(path) as partial:
        with _netcdf, netCDF4.Dataset(partial, "w", format="NETCDF3_64BIT_DATA") as file:
            file.set_fill_off()
            variables = {}
            for name, array in arrays.items():
                for dim, size in zip(dims[name], array.shape, strict=True):
                    if dim not in file.dimensions:
                        file.createDimension(dim, size)
                variables[name] = file.createVariable(name, array.dtype, dims[name], fill_value=False)
            end = file.createVariable(_END, "i4", fill_value=False)
            checksum = _checksum(attributes, dims, arrays)
            file.setncatts({**attributes, "checksum": checksum})
            for name, variable in variables.items():
                variable[...] = arrays[name]
            end[...] = 1
        _read(partial, study, case)
    return checksum


def read_shard(folder: Path, study: Study, case: Case) -> Shard | None:
    """The stored case, verified to the last byte; None when there is none, `IntegrityError` when it is damaged."""
    path = shard_path(folder, case)
    return _read(path, study, case) if path.exists() else None


def read_status(folder: Path, study: Study, case: Case) -> Status:
    """How a stored case ended, from the head and the end of the file alone."""
    path = shard_path(folder, case)
    if not path.exists():
        return Status.missing
    with _opened(path, study, case) as file:
        return Status(int(file.getncattr("status")))


def _read(path: Path, study: Study, case: Case) -> Shard:
    dims = {variable.name: study.inner_dims(variable) for variable in study.variables}
    with _opened(path, study, case) as file:
        names = [name for name in file.variables if name != _END]
        if any(file.variables[name].dimensions != dims.get(name) for name in names):
            raise IntegrityError(f"{path} holds other variables than study {study.name!r} declares")
        stored = {name: file.variables[name] for name in names}
        if sum(int(np.prod(v.shape, dtype=object)) * v.dtype.itemsize for v in stored.values()) > path.stat().st_size:
            raise IntegrityError(f"{path} is cut short")
        arrays = {name: np.asarray(variable[...]) for name, variable in stored.items()}
        attributes = {name: file.getncattr(name) for name in file.ncattrs()}
    checksum = attributes.pop("checksum")
    attributes = {k: v if isinstance(v, str) else int(v) for k, v in attributes.items()}
    if checksum != _checksum(attributes, dims, arrays):
        raise IntegrityError(f"{path} is damaged: its contents do not match its checksum")
    return Shard(Status(attributes["status"]), arrays, checksum, attributes["error"])


@contextmanager
def _opened(path: Path, study: Study, case: Case) -> Iterator[netCDF4.Dataset]:
    """The file, when its head says that it is this case and its end is there; every other finding is one error."""
    try:
        with _netcdf, netCDF4.Dataset(path) as file:
            file.set_auto_maskandscale(False)
            if file.getncattr("schema_version") != SCHEMA_VERSION:
                raise IntegrityError(
                    f"{path} has schema {file.getncattr('schema_version')}, this version reads {SCHEMA_VERSION}"
                )
            if (file.getncattr("study"), file.getncattr("case_id")) != (study.name, case.id):
                raise IntegrityError(f"{path} holds another case: {file.getncattr('case_id')}")
            if int(file.variables[_END][...]) != 1:
                raise IntegrityError(f"{path} is cut short")
            yield file
    except (OSError, RuntimeError, ValueError, TypeError, LookupError, AttributeError, MemoryError) as error:
        raise IntegrityError(f"{path} is not a readable shard: {error}") from error


def _checksum(
    attributes: Mapping[str, Any], dims: Mapping[str, tuple[str, ...]], arrays: Mapping[str, np.ndarray]
) -> str:
    """Over everything a shard says; big-endian values count as their little-endian equals."""
    digest = sha256(json.dumps(attributes, sort_keys=True).encode())
    for name in sorted(arrays):
        array = np.ascontiguousarray(arrays[name], arrays[name].dtype.newbyteorder("<"))
        digest.update(json.dumps([name, dims[name], array.dtype.str, array.shape]).encode())
        digest.update(array.tobytes())
    return digest.hexdigest()


def _sync_folder(folder: Path) -> None:
    if os.name != "posix":  # elsewhere a folder cannot be opened
        return
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
