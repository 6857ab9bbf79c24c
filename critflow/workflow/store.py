"""Stored cases: one shard for each complete case, one text for each failed case.

A shard is a netCDF file (CDF-5) of raw named arrays without labels; it ends with a seal, the SHA-256 of all bytes
before it, which netCDF tools ignore.  Every file is written under a temporary name, synced and renamed, so that it is
either complete or absent; a shard is also read back before it is renamed.  The seal is verified before the netCDF
library sees a byte.
"""

from __future__ import annotations

import errno
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
from critflow.workflow.plan import SEED_ENTROPY, Case
from critflow.workflow.provenance import code_version, environment
from critflow.workflow.study import Study

SCHEMA_VERSION = 4
PARTIAL = ".partial"  # suffix of temporary files; no pattern for results matches it

_MARK = b"\nsealed sha256 "
_SEAL_LENGTH = len(_MARK) + 64
# Errors of the machine, which say nothing about the file; -61 is NC_ENOMEM of the netCDF library.
_MACHINE = {errno.EMFILE, errno.ENFILE, errno.ENOMEM, errno.EACCES, errno.EIO, errno.ESTALE, -61}
_netcdf = threading.Lock()  # the netCDF library is not thread-safe


class OtherTable(IntegrityError):
    """A complete shard of the case, stored with another table of variables than that of the study."""


@dataclass(frozen=True)
class Shard:
    """Contents of a shard."""

    status: Status
    arrays: Mapping[str, np.ndarray]
    checksum: str
    code: str  # code that computed it, and its libraries
    environment: str


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
    return folder / f"{case.id}.nc"


def write_shard(folder: Path, study: Study, case: Case, status: Status, arrays: Mapping[str, np.ndarray]) -> str:
    """Store one complete case and return the checksum of its shard.

    arrays: raw arrays in the dtypes of the table; dimensions are named by their lengths.
    """
    path = shard_path(folder, case)
    with replacing(path) as partial:
        with _netcdf, netCDF4.Dataset(partial, "w", format="NETCDF3_64BIT_DATA") as file:
            file.set_fill_off()
            for size in sorted({size for array in arrays.values() for size in array.shape}):
                file.createDimension(f"n{size}", size)
            variables = {
                name: file.createVariable(name, array.dtype, [f"n{size}" for size in array.shape], fill_value=False)
                for name, array in arrays.items()
            }
            origin = {"code": code_version(study), "environment": environment(), "seed_entropy": SEED_ENTROPY}
            file.setncatts(_identity(study, case) | origin | {"identity": case.identity, "status": int(status)})
            for name, variable in variables.items():
                variable[...] = arrays[name]
        checksum = append_seal(partial)
        written = _read(partial, study, case).arrays
        if any(written[name].tobytes() != array.tobytes() for name, array in arrays.items()):
            raise OSError("it does not read back as written")
    return checksum


def read_shard(folder: Path, study: Study, case: Case) -> Shard | None:
    """The stored case, every byte verified; None if it does not exist, `IntegrityError` if it is damaged."""
    path = shard_path(folder, case)
    return _read(path, study, case) if path.exists() else None


def _read(path: Path, study: Study, case: Case) -> Shard:
    checksum = verified_checksum(path)
    try:
        with _netcdf, netCDF4.Dataset(path) as file:
            file.set_auto_maskandscale(False)
            for name, expected in _identity(study, case).items():
                if (value := file.getncattr(name)) != expected:
                    kind = OtherTable if name == "table" else IntegrityError  # compared last
                    raise kind(f"{path} is damaged: its {name} is {value}, not {expected}")
            arrays = {name: np.asarray(variable[...]) for name, variable in file.variables.items()}
            origin = {name: str(file.getncattr(name)) for name in ("code", "environment")}
            return Shard(Status(int(file.getncattr("status"))), arrays, checksum, **origin)
    except (OSError, RuntimeError, ValueError, TypeError, LookupError, AttributeError) as error:
        if isinstance(error, OSError) and error.errno in _MACHINE:
            raise EnvironmentFailure(f"cannot read {path}: {error.strerror}: correct this and run again") from error
        raise IntegrityError(f"{path} is damaged: it is not a readable shard: {error}") from error


def _identity(study: Study, case: Case) -> dict[str, Any]:
    return {"schema_version": SCHEMA_VERSION, "study": study.name, "case_id": case.id, "table": study.table_digest}


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
