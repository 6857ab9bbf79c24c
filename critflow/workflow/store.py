"""Files that are either complete or absent: one shard per case.

A shard is a netCDF file in the plain CDF-5 layout, read and written faster than HDF5 at these sizes, with a seal behind
it that netCDF tools do not see: the SHA-256 of all bytes before.  It is written beside its place, closed, sealed, read
back, synced and renamed, so a crash leaves no half shard.  The seal is verified before the netCDF library sees a file,
so no damaged length can mislead it.  A seal is no secret, so what the head of a file declares is compared with the
table of the study, and with the size of the file, before any array is made of it.
"""

from __future__ import annotations

import errno
import math
import os
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from hashlib import file_digest, sha256
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple
from uuid import uuid4

import netCDF4
import numpy as np

from critflow.result import EnvironmentFailure, IntegrityError, Status
from critflow.workflow import faults
from critflow.workflow.errors import OtherTable
from critflow.workflow.plan import Case
from critflow.workflow.provenance import shard_attributes
from critflow.workflow.study import Study

SCHEMA_VERSION = 2
PARTIAL = ".partial"  # no glob for results matches it

_MARK = b"\nsealed sha256 "
_SEAL_LENGTH = len(_MARK) + 64
_CDF5 = b"CDF\x05"
# How the text attribute `code` stands in the head of a CDF-5 file: length and letters of its name, type, length.
_CODE = b"\0\0\0\0\0\0\0\4code\0\0\0\2"
_HEAD = 4096  # bytes among which it is
# Errors of a system call that say nothing about the file it was made for.
_THE_MACHINE = {errno.EMFILE, errno.ENFILE, errno.ENOMEM, errno.EACCES, errno.EIO, errno.ESTALE}
_SPARE = 2**24  # bytes without which the netCDF library cannot be trusted to open a shard
_netcdf = threading.Lock()  # the netCDF library is not thread-safe


@dataclass(frozen=True)
class Shard:
    """What is stored of one case."""

    status: Status
    arrays: Mapping[str, np.ndarray]
    checksum: str
    error: str = ""  # the traceback of a failed case
    code: str = ""  # what computed it, and on which libraries
    environment: str = ""


class Ending(NamedTuple):
    """How a case ended, from the head of its shard."""

    status: Status
    error: str = ""
    code: str = ""


@contextmanager
def written_beside(path: Path) -> Iterator[Path]:
    """A file to write that takes the place of `path` when the block ends well, and vanishes when it does not."""
    partial = path.with_name(f".{path.name}.{uuid4().hex[:12]}{PARTIAL}")
    try:
        faults.passing("store.opening", path.name)
        yield partial
        faults.half_written(partial, path.name)
        faults.passing("store.closed", path.name)
        with open(partial, "rb+") as file:
            os.fsync(file.fileno())
        faults.passing("store.synced", path.name)
        set_aside_folder(path)
        os.replace(partial, path)
        faults.passing("store.replaced", path.name)
        _sync_folder(path.parent)
        faults.passing("store.done", path.name)
    except (OSError, RuntimeError) as error:  # HDF5 and netCDF report a full disk as RuntimeError
        reason = getattr(error, "strerror", None) or str(error)
        raise EnvironmentFailure(
            f"cannot write {path}: {reason}: make room there, or choose another folder with --out"
        ) from error
    finally:
        partial.unlink(missing_ok=True)


def set_aside_folder(path: Path) -> None:
    """Make room where a file goes; a folder that stands there is not ours to delete."""
    if path.is_dir():
        path.rename(path.with_name(f"{path.name}.{uuid4().hex[:12]}.set-aside"))


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
    with written_beside(path) as partial:
        with _netcdf, netCDF4.Dataset(partial, "w", format="NETCDF3_64BIT_DATA") as file:
            file.set_fill_off()
            variables = {}
            for name, array in arrays.items():
                for dim, size in zip(study.inner_dims[name], array.shape, strict=True):
                    if dim not in file.dimensions:
                        file.createDimension(dim, size)
                variables[name] = file.createVariable(name, array.dtype, study.inner_dims[name], fill_value=False)
            file.setncatts({**shard_attributes(study, case), **_identity(study, case)})
            file.setncatts({"status": int(status), "error": error})
            for name, variable in variables.items():
                variable[...] = arrays[name]
        seal = _seal(partial.read_bytes())
        with open(partial, "ab") as sealed:
            sealed.write(seal)
        written = _read(partial, study, case).arrays
        if any(written[name].tobytes() != array.tobytes() for name, array in arrays.items()):
            raise OSError("it does not read back as written")
    return _checksum(seal)


def read_shard(folder: Path, study: Study, case: Case) -> Shard | None:
    """The stored case, verified to the last byte; None when there is none, `IntegrityError` when it is damaged."""
    path = shard_path(folder, case)
    return _read(path, study, case) if path.exists() else None


def read_identity(path: Path) -> str:
    """Which case a shard says it is, of whatever study and settings, once every byte of it is verified."""
    with _readable(path):
        _verified_seal(path)
        with _netcdf, netCDF4.Dataset(path) as file:
            return file.getncattr("identity")


def read_code(path: Path) -> str:
    """What computed a shard, from its head, without the netCDF library, which takes a hundred times longer."""
    with _readable(path), _raw(path) as file:
        head = file.read(_HEAD)
        start = head.find(_CODE) + len(_CODE) + 8
        if start < len(_CODE) + 8:
            return "unknown code"
        length = int.from_bytes(head[start - 8 : start], "big")
        return head[start : start + length].decode(errors="replace")


def read_ending(folder: Path, study: Study, case: Case, *, verify: bool) -> Ending:
    """How a stored case ended; `verify` looks at every byte, otherwise at the head and whether the seal is there."""
    path = shard_path(folder, case)
    if not path.exists():
        return Ending(Status.missing)
    with _readable(path):
        if verify:
            _verified_seal(path)
        else:
            with _raw(path) as file:
                file.seek(-min(_SEAL_LENGTH, path.stat().st_size), os.SEEK_END)
                _check_sealed(path, file.read())
        with _opened(path, study, case) as dataset:
            return Ending(_status(dataset), dataset.getncattr("error"), dataset.getncattr("code"))


def append_seal(path: Path) -> None:
    """End a finished file with the seal of its bytes, however many they are; netCDF tools do not look behind theirs."""
    with open(path, "rb+") as file:
        digest = file_digest(file, "sha256").hexdigest()
        file.seek(0, os.SEEK_END)
        file.write(_MARK + digest.encode())


def check_seal(path: Path) -> bool:
    """Whether the file ends with a seal; `IntegrityError` when it is not that of its bytes."""
    with _readable(path), _raw(path) as file:
        left = path.stat().st_size - _SEAL_LENGTH
        file.seek(max(left, 0))
        if not (seal := file.read()).startswith(_MARK):
            return False
        file.seek(0)
        digest = sha256()
        while left > 0 and (piece := file.read(min(left, 2**20))):
            digest.update(piece)
            left -= len(piece)
        if _checksum(seal) != digest.hexdigest():
            raise IntegrityError(f"{path} is damaged: its contents do not match its checksum")
        return True


def _read(path: Path, study: Study, case: Case) -> Shard:
    with _readable(path):
        seal = _verified_seal(path)
        with _opened(path, study, case) as dataset:
            arrays = {name: np.asarray(variable[...]) for name, variable in dataset.variables.items()}
            told = [dataset.getncattr(name) for name in ("error", "code", "environment")]
            return Shard(_status(dataset), arrays, _checksum(seal), *told)


def _verified_seal(path: Path) -> bytes:
    with _raw(path) as file:
        whole = file.read()
    seal = whole[-_SEAL_LENGTH:]
    _check_sealed(path, seal)
    if _seal(whole[:-_SEAL_LENGTH]) != seal:
        raise IntegrityError(f"{path} is damaged: its contents do not match its checksum")
    return seal


@contextmanager
def _raw(path: Path) -> Iterator[BinaryIO]:
    """The bytes of a plain file: a pipe would keep its reader waiting."""
    if not path.is_file():
        raise IntegrityError(f"{path} is not a file")
    with open(path, "rb") as file:
        yield file


@contextmanager
def _opened(path: Path, study: Study, case: Case) -> Iterator[netCDF4.Dataset]:
    """The file, when its head says that it is this case in this layout."""
    with _raw(path) as raw:
        if raw.read(len(_CDF5)) != _CDF5:  # the library would open any of its formats, some of them without bounds
            raise IntegrityError(f"{path} is not a shard: it is not in the CDF-5 layout")
    with _netcdf, netCDF4.Dataset(path) as file:
        file.set_auto_maskandscale(False)
        for name, right in _identity(study, case).items():
            if (found := file.getncattr(name)) != right:
                kind = OtherTable if name == "table" else IntegrityError  # looked at last
                raise kind(f"{path} is not the shard looked for: its {name} is {found}, not {right}")
        _check_layout(study, case, file, path.stat().st_size)
        yield file


def _check_layout(study: Study, case: Case, file: netCDF4.Dataset, size: int) -> None:
    """Raise unless the head declares arrays of the study's table that fit into the file."""
    if not isinstance(file.getncattr("error"), str):
        raise ValueError("its error is not text")
    declared = {variable.name: np.dtype(variable.dtype) for variable in study.variables if variable.name != "status"}
    lengths = {c.name: len(case.parameters[c.parameter]) for c in study.coordinates}
    total = 0
    for name, variable in file.variables.items():
        if name not in declared:
            raise ValueError(f"it holds {name!r}, which is not in the table of the study")
        if variable.dtype != declared[name] or variable.dimensions != study.inner_dims[name]:
            raise ValueError(f"its {name!r} is {variable.dtype} along {variable.dimensions}")
        for dim, length in zip(variable.dimensions, variable.shape, strict=True):
            if length != lengths.get(dim, length):
                raise ValueError(f"its {name!r} has {length} along {dim!r}, not {lengths[dim]}")
        total += math.prod(map(int, variable.shape)) * variable.dtype.itemsize
    if total > size:
        raise ValueError(f"it declares {total:,} bytes of arrays and has {size:,}")
    if _status(file) is Status.ok and (left_out := sorted(declared.keys() - file.variables.keys())):
        raise ValueError(f"it is complete without {', '.join(left_out)}")


def _status(file: netCDF4.Dataset) -> Status:
    return Status(int(file.getncattr("status")))


@contextmanager
def _readable(path: Path) -> Iterator[None]:
    """Whatever a strange file makes the libraries raise becomes one error that names it.

    What the machine refuses says nothing about the file, which may be as good as ever.
    """
    try:
        yield
    except (OSError, RuntimeError, ValueError, TypeError, LookupError, AttributeError) as error:
        if isinstance(error, OSError) and error.errno in _THE_MACHINE:
            raise EnvironmentFailure(f"cannot read {path}: {error.strerror}: mend that and run again") from error
        _refuse_without_memory(path)
        raise IntegrityError(f"{path} is not a readable shard: {error}") from error


def _refuse_without_memory(path: Path) -> None:
    """Raise when there is none left: the netCDF library then calls files strange that it found no room to open."""
    try:
        bytearray(_SPARE)
    except MemoryError:
        raise EnvironmentFailure(f"cannot read {path}: out of memory: free some and run again") from None


def _identity(study: Study, case: Case) -> dict[str, Any]:
    return {"schema_version": SCHEMA_VERSION, "study": study.name, "case_id": case.id, "table": study.table_digest}


def _seal(body: bytes) -> bytes:
    return _MARK + sha256(body).hexdigest().encode()


def _check_sealed(path: Path, end: bytes) -> None:
    if len(end) != _SEAL_LENGTH or not end.startswith(_MARK):
        raise IntegrityError(f"{path} is cut short or not a shard: its seal is missing")


def _checksum(seal: bytes) -> str:
    return seal.removeprefix(_MARK).decode()


def _sync_folder(folder: Path) -> None:
    if os.name != "posix":  # elsewhere a folder cannot be opened
        return
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
