"""What made a file: code, versions and command, in words that are the same wherever the same code runs.

No name of a machine, user or folder is among them, and nothing that differs between two runs of the same code on the
same libraries, save the one attribute `history`.
"""

from __future__ import annotations

import os
import platform
import re
import shlex
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from functools import cache
from hashlib import sha256
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import netCDF4
import numpy as np

from critflow.result import InputError, Status
from critflow.workflow.plan import Case
from critflow.workflow.seeds import SEED_ENTROPY
from critflow.workflow.study import Study

STUDY_MODULE = "critflow_study_"  # how modules of study files are called while they are loaded
VOLATILE = ("history",)  # attributes of a dataset that differ between two runs of the same code

_PACKAGE = Path(__file__).parents[1]
_NUMBERS_BELOW = ("workflow/seeds.py", "workflow/study.py")
_NOT_NUMBERS = ("cli.py", "plot.py", "workflow", "studies")  # parts of the package that change no number
_ENVIRONMENT = ("numpy", "scipy", "qdldl", "clarabel", "pypardiso", "pymetis")  # what numbers may depend on
_MOST_CHECKSUMS = 100  # of single shards in a dataset: more would drown what else its head says


def code_version(study: Study) -> str:
    """What computes a case of this study: version and digest of the library's numbers, digest of the study's."""
    return f"{library_version()}, study {_study_digest(study)}"


@cache
def library_version() -> str:
    """Version and digest of the library's numbers, with which every `code_version` begins."""
    return f"critflow {version('critflow')} {_library_digest()}"


@cache
def environment() -> str:
    """Interpreter, processor and libraries that the numbers of a case may depend on."""
    return ", ".join(f"{name} {number}" for name, number in _environment().items())


@cache
def libraries() -> Mapping[str, str]:
    """What has to be the same in every process of a run: versions, and for the library a digest of its numbers."""
    return {"critflow": library_version().removeprefix("critflow ")} | _versions()


def _versions() -> dict[str, str]:
    return {name: number for name in _ENVIRONMENT if (number := _version(name))}


def _environment() -> dict[str, str]:
    blas = np.show_config(mode="dicts")["Build Dependencies"]["blas"]
    found = {"python": platform.python_version(), "processor": platform.machine()}
    return found | _versions() | {"BLAS": f"{blas['name']} {blas.get('version', '')}".strip()}


def dataset_versions() -> dict[str, str]:
    """The same, and the libraries that wrote the dataset."""
    storing = {name: version(name) for name in ("xarray", "netCDF4")}
    storing |= {"netcdf-c": netCDF4.__netcdf4libversion__, "hdf5": netCDF4.__hdf5libversion__}
    return {"critflow": version("critflow")} | _environment() | storing


@cache
def source_tree(folder: Path = _PACKAGE.parent) -> Mapping[str, str]:
    """Commit of the source tree that the library runs from, and whether code there differs from it.

    Nothing where the library was installed from a wheel, or where git does not answer.
    """
    if not (folder / ".git").exists():
        return {}
    code = [name for name in ("critflow", "workflows", "pyproject.toml") if (folder / name).exists()]
    try:
        commit = _git(folder, "rev-parse", "HEAD")
        changed = _git(folder, "status", "--porcelain", "--", *code)
    except (OSError, subprocess.SubprocessError):
        return {}
    return {"commit": commit, "commit_dirty": "true" if changed else "false"}


def _git(folder: Path, *words: str) -> str:
    # Variables that a hook sets would point to another repository; no lock is taken, no program of a monitor started.
    clean = {name: value for name, value in os.environ.items() if not name.startswith("GIT_")}
    command = ["git", "--no-optional-locks", "-c", "core.fsmonitor=false", "-C", str(folder), *words]
    return subprocess.run(command, env=clean, capture_output=True, text=True, check=True, timeout=10).stdout.strip()


def command_line(study: str, settings: Sequence[str], workers: int, cluster: str | None) -> str:
    """The command and where it computed, without the folders and addresses of a machine."""
    words = ["critflow", "run", Path(study).name, *(f"--set={word}" for word in settings)]
    places = {0: "in one process", 1: "in 1 worker process"}
    through = "through a dask scheduler" if cluster == "scheduler" else f"in jobs of {cluster}"
    place = through if cluster else places.get(workers, f"in up to {workers} worker processes")
    return f"{shlex.join(words)} ({place})"


def written_at() -> str:
    """The date for `history`: now, or the one that SOURCE_DATE_EPOCH sets where nothing at all may differ."""
    word = os.environ.get("SOURCE_DATE_EPOCH", str(int(time.time())))
    if not re.fullmatch(r"[0-9]{1,11}", word):
        raise InputError(f"SOURCE_DATE_EPOCH={word} must be whole seconds since 1970: set it so, or unset it")
    return time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime(int(word)))


class Origins:
    """What the shards of a dataset say about themselves, gathered while they are merged."""

    def __init__(self, study: Study):
        self._volatile = any(variable.volatile for variable in study.variables)
        self._whole = 0
        self._each: list[str] = []
        self._code: Counter[str] = Counter()
        self._environment: Counter[str] = Counter()

    def add(self, case: Case, status: Status, checksum: str, code: str, environment: str) -> None:
        """A shard, in any order.  The traceback of a failed one may differ: its bytes do not count."""
        checksum = "failed" if status is Status.failed else checksum
        self._whole += int.from_bytes(sha256(f"{case.id} {checksum}\n".encode()).digest())
        if len(self._each) <= _MOST_CHECKSUMS:
            self._each.append(f"{case.id}:{checksum}")
        self._code[code] += 1
        self._environment[environment] += 1

    def attributes(self) -> dict[str, str]:
        """Global attributes; what made the cases stands beside what made the dataset, since it may be older."""
        found = {
            "cases_code": _counted(self._code),
            "cases_environment": _counted(self._environment),
            "shards_sha256": f"{self._whole % 2**256:064x}",
            "shards_sha256_each": " ".join(sorted(self._each)) if len(self._each) <= _MOST_CHECKSUMS else "",
        }
        volatile = [*VOLATILE, *(name for name in found if self._volatile and name.startswith("shards_"))]
        return found | {"volatile_attributes": " ".join(volatile)}


def _counted(counter: Counter[str]) -> str:
    return "; ".join(f"{text}: {count} cases" for text, count in sorted(counter.items()))


@cache
def _library_digest() -> str:
    files = [path for path in sorted(_PACKAGE.rglob("[!_]*.py")) if _relative(path).parts[0] not in _NOT_NUMBERS]
    files += [_PACKAGE / name for name in _NUMBERS_BELOW]
    return _digest({_relative(path).as_posix(): path for path in files})


def _relative(path: Path) -> Path:
    return path.relative_to(_PACKAGE)


def _study_digest(study: Study) -> str:
    module = str(getattr(study.case, "__module__", ""))
    reports = (*study.figures.values(), *study.animations.values(), study.claims, study.summary, study.verify)
    return _module_digest(module, frozenset(str(getattr(report, "__module__", "")) for report in reports))


@cache
def _module_digest(module: str, reporting: frozenset[str]) -> str:
    """Digest of the file of a case function and of those beside it that it brought, but not of figures and claims."""
    root = module.split(".")[0]
    names = [module]
    if root.startswith(STUDY_MODULE):
        beside = [name for name in sys.modules if name.startswith(f"{root}.") and name not in reporting]
        names = sorted({root, module, *beside})
    files = {name.removeprefix(root): getattr(sys.modules.get(name), "__file__", None) for name in names}
    return _digest({name: Path(file) for name, file in files.items() if file})


def _digest(files: Mapping[str, Path]) -> str:
    whole = sha256()
    for name, path in files.items():
        whole.update(f"{name}\0".encode() + sha256(path.read_bytes()).digest())
    return whole.hexdigest()[:12]


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def shard_attributes(study: Study, case: Case) -> dict[str, str]:
    """What a shard says about itself; `code` first, where `critflow status` finds it without the netCDF library."""
    return {
        "code": code_version(study),
        "environment": environment(),
        "identity": case.identity,
        "seed_entropy": SEED_ENTROPY,
    }
