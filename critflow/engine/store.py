"""A results folder: its files and its lock, the stored cases and their state.

    study.json            the note of the last run: study, settings, version, file
    shards/seed3-HASH.nc  the complete cases of one network, or of one value of the first axis; each further thousand
                          of them in a folder of its own, as in shards/2/seed2003-HASH.nc
    failed/CASE_ID.txt    a failed case: the command that runs it alone, its parameters, its traceback
    NAME.nc, or NAME-part000.nc ...  figures/  claims.md  claims.json  summary.json  run.log  .lock

A shard is a netCDF file (CDF-5) of named arrays; those that differ between its cases have the dimension `stored_case`,
and the attribute `cases` lists the cases with their status and the code that computed each.  It ends with a seal, the
SHA-256 of all bytes before it, which netCDF tools ignore.  Every file is written under a temporary name, synced and
renamed, so that it is either complete or absent; a shard is also read back before it is renamed.  Whoever opens a shard
reads it once, and verifies the seal before the netCDF library sees a byte: a damaged header can crash it.

A shard counts before a failed text of the same case.  The existence of a failed text alone says that the case failed:
its contents are for the reader, and damage in them changes no result.
"""

from __future__ import annotations

import errno
import glob
import json
import os
import platform
import re
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import wraps
from hashlib import sha256
from itertools import groupby, islice
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple, ParamSpec, TypeVar
from uuid import uuid4

import netCDF4
import numpy as np
from filelock import FileLock, Timeout

from critflow.engine.code_digest import StudyFile, code_version, load_file, load_study
from critflow.engine.settings import SEED_ENTROPY, Case, Selection
from critflow.engine.study import Study
from critflow.result import CritflowError, EnvironmentFailure, InputError, IntegrityError, Status, StudyError

SCHEMA_VERSION = 5
# States of a case; `OTHER` is complete, computed by other code.
DONE, FAILED, MISSING, DAMAGED, CHANGED, OTHER = "done", "failed", "missing", "damaged", "changed", "other"

_PARTIAL = ".partial"  # suffix of temporary files; no pattern for results matches it
_MARK = b"\nsealed sha256 "
_SEAL_LENGTH = len(_MARK) + 64
_NO_MEMORY = (errno.ENOMEM, -61)  # of the system, and NC_ENOMEM of the netCDF library
_netcdf = threading.Lock()  # the netCDF library is not thread-safe
_CASE = "stored_case"  # dimension
_MOST_REASONS = 20  # lines
_FLEETING = (errno.EIO, errno.ESTALE)  # a file system that many machines share shows them for a moment
_PAUSES = (1.0, 5.0)  # seconds before the second try and before the third
_PART = re.compile(r"-part\d+$")  # at the end of the name of a part of a dataset
_THOUSAND = 1000  # shards of a folder
RESUME = "run the same command again to resume"
AT_ONCE = 8  # files that are read at once: a shared file system answers late

_P = ParamSpec("_P")
_T = TypeVar("_T")
_Item = TypeVar("_Item")


class OtherTable(IntegrityError):
    """A complete shard of the case, stored with another table of variables than that of the study."""


class LockedError(CritflowError):
    """Another run is active in the folder."""


class Interrupted(CritflowError):
    """The run was stopped; all cases computed before are stored."""


# Files


def is_fleeting(error: BaseException) -> bool:
    """Whether a shared file system may have failed for a moment; the netCDF library reports its errors as texts."""
    return any(os.strerror(number) in str(error.__cause__ or error) for number in _FLEETING)


def persistent(work: Callable[_P, _T]) -> Callable[_P, _T]:
    """The function with three tries, after pauses, where a shared file system fails."""

    @wraps(work)
    def tried(*args: _P.args, **kwargs: _P.kwargs) -> _T:
        for pause in _PAUSES:
            try:
                return work(*args, **kwargs)
            except (OSError, CritflowError) as error:
                if not is_fleeting(error):
                    raise
            time.sleep(pause)
        return work(*args, **kwargs)

    return tried


def several(work: Callable[[_Item], _T], items: Iterable[_Item], at_once: int = AT_ONCE) -> Iterator[_T]:
    """Results of the items in their order, a few at a time.

    No thread works while the caller has a result: it may write with the netCDF library, which is not thread-safe.
    """
    left = iter(items)
    with ThreadPoolExecutor(at_once) as pool:
        while some := list(islice(left, 2 * at_once)):
            yield from list(pool.map(work, some))


def dataset_files(path: Path) -> list[Path]:
    """The file of a dataset, or the parts of a large one, for which its name and that of each part stand."""
    stem = _PART.sub("", path.stem)
    parts = sorted(path.parent.glob(f"{glob.escape(stem)}-part*{path.suffix}"))
    return [path] if path.exists() and stem == path.stem else parts


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A temporary file that replaces `path` if the block succeeds and is deleted otherwise."""
    partial = path.with_name(f".{path.name}.{uuid4().hex[:12]}{_PARTIAL}")
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
        raise EnvironmentFailure(
            f"cannot write {path}: {getattr(error, 'strerror', None) or error}: free disk space, or choose another "
            "folder with --out"
        ) from error
    finally:
        partial.unlink(missing_ok=True)


@persistent
def write_text(path: Path, text: str) -> None:
    with replacing(path) as partial:
        partial.write_text(text, encoding="utf-8")


def append_seal(path: Path) -> None:
    """End a file with the seal of its bytes."""
    with open(path, "rb+") as file:
        file.write(_MARK + _checksum(file, path.stat().st_size).encode())


def verified_checksum(path: Path, content: bytearray | None = None) -> str:
    """Checksum of a sealed file, which is read once; `IntegrityError` unless the seal is that of its bytes.

    content  receives the bytes before the seal
    """
    try:
        if not path.is_file():  # reading a pipe would block
            raise IntegrityError(f"{path} is damaged: it is not a file")
        with open(path, "rb") as file:
            checksum = _checksum(file, max(os.fstat(file.fileno()).st_size - _SEAL_LENGTH, 0), content)
            seal = file.read()
    except OSError as error:
        raise EnvironmentFailure(f"cannot read {path}: {error.strerror}: correct this and run again") from error
    if seal != _MARK + checksum.encode():
        cut = not seal.startswith(_MARK)
        reason = "it is cut short, its seal is missing" if cut else "its contents do not match its checksum"
        raise IntegrityError(f"{path} is damaged: {reason}")
    return checksum


def _checksum(file: BinaryIO, length: int, content: bytearray | None = None) -> str:
    """SHA-256 of the first bytes of a file, read in pieces."""
    whole = sha256()
    while piece := file.read(min(length, 2**20)):
        whole.update(piece)
        length -= len(piece)
        if content is not None:
            content += piece
    return whole.hexdigest()


# Shards


@dataclass(frozen=True)
class StoredCase:
    """One complete case; it has no arrays where only the list of the cases was read."""

    values: Mapping[str, int | str]  # of the axes
    status: Status
    code: str  # code that computed it, and its libraries
    environment: str
    absent: tuple[str, ...] = ()  # variables that it does not have
    arrays: Mapping[str, np.ndarray] = field(default_factory=dict)  # in the dtypes of the table


def shard_path(folder: Path, case: Case) -> Path:
    """The shard of a case in the folder of its thousand; earlier versions stored all shards in one folder."""
    name, value = f"{case.shard}.nc", next(iter(case.values.values()))
    if isinstance(value, str) or value < _THOUSAND or (folder / name).exists():
        return folder / name
    return folder / str(value // _THOUSAND) / name


@persistent
def write_shard(folder: Path, study: Study, case: Case, stored: Mapping[str, StoredCase]) -> str:
    """Store complete cases of one value of the first axis, by their ids, and return the checksum of their shard.

    case  one of them, which names the shard

    The bytes depend on the cases alone, not on the order in which they were computed.
    """
    in_order = sorted(stored, key=lambda name: [axis.place(stored[name].values[axis.name]) for axis in study.axes])
    cases = {name: stored[name] for name in in_order}
    with replacing(shard_path(folder, case)) as partial:
        with _netcdf, netCDF4.Dataset(partial, "w", format="NETCDF3_64BIT_DATA") as file:
            file.set_fill_off()
            file.setncatts(_identity(study, case) | {"seed_entropy": SEED_ENTROPY})
            file.setncattr("cases", json.dumps({name: _listed(one) for name, one in cases.items()}))
            file.createDimension(_CASE, len(cases))
            for variable in study.variables:
                name, dims = variable.name, study.inner_dims[variable.name]
                having = [one.arrays.get(name) for one in cases.values()]
                array = next((one for one in having if one is not None), None)
                if array is None:
                    continue
                if name not in shared_variables(study):
                    empty = np.full(array.shape, variable.filler, array.dtype)
                    dims, array = (_CASE, *dims), np.stack([empty if one is None else one for one in having])
                for dim, size in zip(dims, array.shape, strict=True):
                    if dim not in file.dimensions:
                        file.createDimension(dim, size)
                file.createVariable(name, array.dtype, dims, fill_value=False)[...] = array
        append_seal(partial)
        written, checksum = read_shard(partial, study, case)
        if {name: _bytes(one) for name, one in written.items()} != {name: _bytes(one) for name, one in cases.items()}:
            raise OSError("it does not read back as written")
    return checksum


@persistent
def read_shard(path: Path, study: Study, case: Case, with_arrays: bool = True) -> tuple[dict[str, StoredCase], str]:
    """The cases of the shard of a case by their ids, and its checksum; `IntegrityError` if it is damaged."""
    content = bytearray()
    checksum = verified_checksum(path, content)
    content += bytes(len(content))  # the library reads a header by halves of the memory, and refuses to pass its end
    try:
        with _netcdf, netCDF4.Dataset("shard", memory=content) as file:  # a path would be opened again
            file.set_auto_maskandscale(False)
            for name, expected in _identity(study, case).items():
                if (value := file.getncattr(name)) != expected:
                    kind = OtherTable if name == "table" else IntegrityError  # compared last
                    raise kind(f"{path} is damaged: its {name} is {value}, not {expected}")
            arrays = {name: np.asarray(variable[...]) for name, variable in file.variables.items() if with_arrays}
            each = {name for name in arrays if _CASE in file[name].dimensions}
            cases = {
                name: StoredCase(
                    one["values"],
                    Status(one["status"]),
                    sys.intern(one["code"]),  # texts that 10⁶ cases share are stored once
                    sys.intern(one["environment"]),
                    tuple(one["absent"]),
                    {k: a[n] if k in each else a for k, a in arrays.items() if k not in one["absent"]},
                )
                for n, (name, one) in enumerate(json.loads(file.getncattr("cases")).items())
            }
            return cases, checksum
    except (OSError, RuntimeError, ValueError, TypeError, LookupError, AttributeError) as error:
        if isinstance(error, OSError) and error.errno in _NO_MEMORY:
            raise EnvironmentFailure(f"cannot read {path}: {error.strerror}: correct this and run again") from error
        raise IntegrityError(f"{path} is damaged: it is not a readable shard: {error}") from error


def _identity(study: Study, case: Case) -> dict[str, Any]:
    return {"schema_version": SCHEMA_VERSION, "study": study.name, "shard": case.shard, "table": study.table_digest}


def _listed(stored: StoredCase) -> dict[str, Any]:
    """What the list of a shard has about a case."""
    record = {**vars(stored), "values": dict(stored.values), "status": int(stored.status)}
    return {name: value for name, value in record.items() if name != "arrays"}


def _bytes(stored: StoredCase) -> tuple[dict[str, Any], dict[str, bytes]]:
    return _listed(stored), {name: array.tobytes() for name, array in stored.arrays.items()}


def shared_variables(study: Study) -> set[str]:
    """Variables that all cases of a shard share."""
    return {variable.name for variable in study.variables if set(study.axis_names[1:]).isdisjoint(variable.dims)}


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
            raise IntegrityError(
                f"case {case_id} has length {sizes[dim]} in {dim!r}, cases before it {known[dim]}: run each size into "
                "a folder of its own and join them (docs/howto/dataset.md, Several sizes), or store numbers alone with "
                "--set variables=scalars"
            )


def refuse_values(case: Case, name: str, array: np.ndarray, shared: np.ndarray) -> None:
    """Raise `IntegrityError` where a case has another value of a variable than the cases that share it."""
    if array.tobytes() != shared.tobytes():
        raise IntegrityError(
            f"case {case.id} gives another {name!r} than cases that share it: correct the case function and raise the "
            "study's version"
        )


# The folder


class CaseState(NamedTuple):
    """A case and its state; the reason explains every state but `done`, of `other` it is the code."""

    case: Case
    state: str
    reason: str = ""
    record: StoredCase | None = None  # of a complete case


class Folder:
    """Paths of one results folder, its lock, its note and the state of its cases.

    study  name or file of its study; by default as in the note of the last run
    """

    def __init__(self, path: Path, study: str = ""):
        self.path, self.study = path, study
        self.shards, self.failed, self.figures = path / "shards", path / "failed", path / "figures"
        self.note, self.log = path / "study.json", path / "run.log"
        self.stop = path / ".stop"  # if it exists, workers begin no further case
        self._read: dict[Path, tuple[Any, dict[str, StoredCase], tuple[str, str]]] = {}  # shards with their stamps

    def dataset(self, study: str) -> Path:
        return self.path / f"{study}.nc"

    def trace(self, case: Case) -> Path:
        """The file that names the case of a network that is computed now."""
        return shard_path(self.shards, case).with_name(f".{case.shard}.trace")

    def failure(self, case: Case) -> Path:
        return self.failed / f"{case.id}.txt"

    def delete_failure(self, case: Case) -> None:
        """Delete the text of a case that is computed again; a folder with its name is not ours to delete."""
        if not self.failure(case).is_dir():
            self.failure(case).unlink(missing_ok=True)

    @contextmanager
    def locked(self, loaded: StudyFile) -> Iterator[None]:
        """Exclude other runs until the end of the process, and delete temporary files of runs that were killed.

        Raises `LockedError` if another run is active.
        """
        self.check_owner(loaded)
        holder, folders = self.path / ".lock", (self.path, self.shards, self.failed, self.figures)
        lock = FileLock(holder, timeout=0, mode=0o660)  # every reader could lock it
        try:
            for folder in folders:
                folder.mkdir(parents=True, exist_ok=True)
            lock.acquire()
            holder.write_text(f"process {os.getpid()} on {platform.node()} since {time.ctime()}\n")
            hidden = (file for folder in folders for file in folder.glob(".*"))
            for file in (*hidden, *self.shards.glob("*/.*")):
                if file.name.endswith((_PARTIAL, ".trace")) or file == self.stop:
                    file.unlink(missing_ok=True)
        except Timeout:
            name = holder.read_text(errors="replace")[:200].strip() or "unknown process"
            raise LockedError(
                f"another run is active in {self.path} ({name}): wait for its end, or choose another folder with --out"
            ) from None
        except (OSError, NotImplementedError) as error:
            raise EnvironmentFailure(
                f"cannot write in {self.path}: {getattr(error, 'strerror', None) or error}: choose another folder with "
                "--out"
            ) from error
        try:
            yield
        finally:
            self.stop.unlink(missing_ok=True)
            lock.release()

    def check_owner(self, loaded: StudyFile) -> None:
        """Raise unless the folder is new or belongs to this study."""
        if self.path.exists() and not self.path.is_dir():
            raise EnvironmentFailure(f"{self.path} is a file: give a folder with --out")
        try:
            owner = self.read_note()["study"] if self.note.exists() else loaded.study.name
        except IntegrityError:  # `run` reports it
            return
        if owner != loaded.study.name:
            raise StudyError(
                f"{self.path} contains study {owner!r}, not {loaded.study.name!r}: choose another folder with --out"
            )

    def write_note(self, loaded: StudyFile, selection: Selection) -> None:
        study = selection.study
        note = {
            "schema_version": SCHEMA_VERSION,
            "study": study.name,
            "version": study.version,
            # Relative to the folder, which can be moved.
            "file": None if loaded.by_name else os.path.relpath(loaded.path, self.path.absolute()),
            "parameters": dict(selection.parameters),
            "axes": dict(selection.axes),
            "variables": study.selected,
            "table": study.table_digest,
            "code": code_version(study),
        }
        write_text(self.note, _note_text(note))

    @persistent
    def read_note(self) -> dict[str, Any]:
        """The note; `IntegrityError` if it is damaged, `StudyError` if it does not exist."""
        if not self.note.exists():
            raise StudyError(f"{self.path} is not a results folder: it has no study.json, which `critflow run` writes")
        try:
            text = self.note.read_text(encoding="utf-8") if self.note.is_file() else "null"
            note = json.loads(text)
            if text != _note_text({key: value for key, value in note.items() if key != "sha256"}):
                raise ValueError("it does not match its checksum")
            version = note["schema_version"]
        except OSError as error:
            raise EnvironmentFailure(f"cannot read {self.note}: {error.strerror}: correct this first") from error
        except (ValueError, TypeError, LookupError, AttributeError, RecursionError) as error:
            raise IntegrityError(f"{self.note} is damaged: {error}: run the study again to write it") from error
        if version != SCHEMA_VERSION:
            raise InputError(
                f"{self.path} contains results of schema {version}, not {SCHEMA_VERSION}: its files stay as they "
                f"are; compute into a new folder with --out {self.path}-new"
            )
        parameters = {k: tuple(v) if isinstance(v, list) else v for k, v in note["parameters"].items()}
        axes = {name: tuple(values) for name, values in note["axes"].items()}
        return note | {"parameters": parameters, "axes": axes, "variables": tuple(note["variables"])}

    def selection(self) -> tuple[StudyFile, Selection]:
        """The study of the note, and the cases of its dataset."""
        note = self.read_note()
        file = None if note["file"] is None else Path(os.path.normpath(self.path / note["file"]))
        if not self.study and file is not None and not file.exists():
            raise StudyError(f"{self.path} was moved or copied, and its study is not {file}: add --study FILE")
        loaded = load_study(self.study or note["study"]) if self.study or file is None else load_file(file)
        study = loaded.study
        if study.name != note["study"]:
            raise StudyError(
                f"{self.path} contains study {note['study']!r}, not {study.name!r}: add --study FILE of it"
            )
        variables = {variable.name for variable in study.variables}
        needed = {key for key, default in study.parameters.items() if default != ""}
        same = needed <= set(note["parameters"]) <= set(study.parameters) and tuple(note["axes"]) == study.axis_names
        if not same or not set(note["variables"]) <= variables:
            raise StudyError(f"study {study.name!r} has other settings now than {self.path}: run it again there")
        return loaded, Selection.of(study, note["variables"], note["parameters"], note["axes"])

    def word(self) -> str:
        """The study as a word of the command `critflow run`, by the note: its name, or its file without a folder."""
        note = self.read_note()
        return str(note["study"] if note["file"] is None else Path(note["file"]).name)

    def states(self, selection: Selection) -> list[CaseState]:
        """State of every case: the single decision whether a case is stored.

        Every shard is read and verified to the last byte, and again after it was replaced.
        """
        code = code_version(selection.study)
        shards, failed = _names(self.shards, ".nc"), _names(self.failed, ".txt")
        groups = [list(group) for _, group in groupby(selection.cases, lambda case: case.shard)]
        stored = several(self._stored, (cases[0] for cases in groups if cases[0].shard in shards))
        states = list[CaseState]()
        for cases in groups:
            records, absent = next(stored) if cases[0].shard in shards else ({}, (MISSING, "not computed yet"))
            for case in cases:
                state = absent
                if record := records.get(case.id):
                    state = (DONE, "") if record.code == code else (OTHER, record.code)
                elif absent[0] == MISSING and case.id in failed and self.failure(case).is_file():
                    text = self.failure(case).read_text(encoding="utf-8", errors="replace")
                    state = (FAILED, last_line(text))
                states.append(CaseState(case, *state, record))
        return states

    def _stored(self, case: Case) -> tuple[dict[str, StoredCase], tuple[str, str]]:
        """The cases of a shard, and the state of others of its network with the reason."""
        path, records, absent = shard_path(self.shards, case), dict[str, StoredCase](), (MISSING, "not computed yet")
        stamps = path.exists() and ((found := path.stat()).st_ino, found.st_mtime_ns, found.st_size)
        if path not in self._read or self._read[path][0] != stamps:
            try:
                records, _ = read_shard(path, case.study, case, with_arrays=False)
            except OtherTable:
                absent = (CHANGED, "stored with another table of variables")
            except IntegrityError as error:
                absent = (DAMAGED, str(error).rpartition(" is damaged: ")[2])
            self._read[path] = stamps, records, absent
        return self._read[path][1:]


def reason_lines(states: Sequence[CaseState]) -> list[str]:
    """One line for each state and reason, without the cases that are done."""
    groups: dict[tuple[str, str], list[Case]] = {}
    for case, state, reason, _ in states:
        if state != DONE:
            groups.setdefault((state, reason), []).append(case)
    lines = []
    for (state, reason), cases in groups.items():
        first = ", ".join(f"{name} {value}" for name, value in cases[0].values.items())
        others = f" and {len(cases) - 1} more" if len(cases) > 1 else ""
        lines.append(f"{state}: {first}{others}: {reason}")
    more = [f"and {len(lines) - _MOST_REASONS} more reasons"] if len(lines) > _MOST_REASONS else []
    return [*lines[:_MOST_REASONS], *more]


def _names(folder: Path, suffix: str) -> set[str]:
    """Names of the files of a folder and of the thousands in it."""
    names = os.listdir(folder) if folder.is_dir() else []
    names += [inner for name in names if name.isdigit() for inner in os.listdir(folder / name)]
    return {name.removesuffix(suffix) for name in names if name.endswith(suffix)}


def _note_text(note: Mapping[str, Any]) -> str:
    """The file of a note, which contains its checksum."""
    checksum = sha256(json.dumps(note, sort_keys=True).encode()).hexdigest()
    return json.dumps({**note, "sha256": checksum}, indent=1) + "\n"


def last_line(text: str) -> str:
    """Reason at the end of a traceback."""
    return (text.strip().splitlines() or ["unknown reason"])[-1][:300]
