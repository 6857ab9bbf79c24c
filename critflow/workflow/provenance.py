"""Provenance: code, versions and command that made a file, in words that are equal wherever the same code runs.

No name of a machine, user or folder is stored.  Two runs of the same code on the same libraries differ only in the
attribute `history`.
"""

from __future__ import annotations

import os
import platform
import re
import subprocess
import sys
import time
from collections.abc import Mapping
from functools import cache
from hashlib import sha256
from importlib.metadata import distributions, version
from pathlib import Path

import netCDF4
import numpy as np

from critflow.extensions import extras
from critflow.result import InputError
from critflow.workflow.study import Study

STUDY_MODULE = "critflow_study_"  # prefix of the modules of loaded study files

_PACKAGE = Path(__file__).parents[1]
_NUMERIC = ("workflow/plan.py", "workflow/study.py")  # the parts of the engine that decide numbers
_NOT_NUMERIC = ("command", "figures", "workflow", "studies")
_ENVIRONMENT = ("numpy", "scipy", "qdldl", "clarabel", "pypardiso", "pyamg")  # packages that numbers may depend on


def code_version(study: Study) -> str:
    """The code that computes a case: version and digest of the library, digest of the study."""
    module = str(getattr(study.case, "__module__", ""))
    reports = (*study.figures.values(), *study.animations.values(), study.claims, study.summary, study.verify)
    reporting = frozenset(str(getattr(report, "__module__", "")) for report in reports)
    return f"critflow {libraries()['critflow']}, study {_module_digest(module, reporting)}"


@cache
def libraries() -> Mapping[str, str]:
    """Versions that must be equal in every process of a run, with a digest of the modules that decide numbers."""
    names = [path.relative_to(_PACKAGE).as_posix() for path in sorted(_PACKAGE.rglob("[!_]*.py"))]
    apart = {*_NOT_NUMERIC, *(name for name, extra in extras().items() if not extra.numeric)}
    names = [name for name in names if name.removeprefix("extras/").split("/")[0] not in apart]
    digest = _digest({name: _PACKAGE / name for name in (*names, *_NUMERIC)})
    return {"critflow": f"{version('critflow')} {digest}"} | _versions()


@cache
def environment() -> str:
    """Interpreter, processor and libraries that the numbers of a case may depend on."""
    return ", ".join(f"{name} {number}" for name, number in _environment().items())


def dataset_versions() -> dict[str, str]:
    """The environment, and the libraries that write the dataset."""
    storing = {"netcdf-c": netCDF4.__netcdf4libversion__, "hdf5": netCDF4.__hdf5libversion__}
    return _environment() | {name: version(name) for name in ("critflow", "xarray", "netCDF4")} | storing


@cache
def source_tree(folder: Path = _PACKAGE.parent) -> Mapping[str, str]:
    """Commit of the source checkout that contains the library, and whether its code has uncommitted changes.

    Empty for an installed wheel, or if git fails.
    """
    if not (folder / ".git").exists():
        return {}
    # Variables set by a hook would select another repository; no lock is taken and no monitor is started.
    clean = {name: value for name, value in os.environ.items() if not name.startswith("GIT_")}

    def git(*words: str) -> str:
        command = ["git", "--no-optional-locks", "-c", "core.fsmonitor=false", "-C", str(folder), *words]
        done = subprocess.run(command, env=clean, capture_output=True, text=True, check=True, timeout=10)
        return done.stdout.strip()

    code = [name for name in ("critflow", "workflows", "pyproject.toml") if (folder / name).exists()]
    try:
        commit, changed = git("rev-parse", "HEAD"), git("status", "--porcelain", "--", *code)
    except (OSError, subprocess.SubprocessError):
        return {}
    return {"commit": commit, "commit_dirty": "true" if changed else "false"}


def timestamp() -> str:
    """The date of `history`: now, or SOURCE_DATE_EPOCH if set, for files without any difference."""
    word = os.environ.get("SOURCE_DATE_EPOCH", str(int(time.time())))
    if not re.fullmatch(r"[0-9]{1,11}", word):
        raise InputError(f"SOURCE_DATE_EPOCH={word} must be whole seconds since 1970")
    return time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime(int(word)))


def _versions() -> dict[str, str]:
    return {name: version(name) for name in _ENVIRONMENT if any(distributions(name=name))}


def _environment() -> dict[str, str]:
    blas = np.show_config(mode="dicts")["Build Dependencies"]["blas"]
    machine = {"python": platform.python_version(), "processor": platform.machine()}
    return machine | _versions() | {"BLAS": f"{blas['name']} {blas.get('version', '')}".strip()}


@cache
def _module_digest(module: str, reporting: frozenset[str]) -> str:
    """Digest of the file of a case function and of the modules that it imports from its folder, without reports."""
    root = module.split(".")[0]
    names = [module]
    if root.startswith(STUDY_MODULE):
        neighbours = [name for name in sys.modules if name.startswith(f"{root}.") and name not in reporting]
        names = sorted({root, module, *neighbours})
    files = {name.removeprefix(root): getattr(sys.modules.get(name), "__file__", None) for name in names}
    return _digest({name: Path(file) for name, file in files.items() if file})


def _digest(files: Mapping[str, Path]) -> str:
    whole = sha256()
    for name, path in files.items():
        whole.update(f"{name}\0".encode() + sha256(path.read_bytes()).digest())
    return whole.hexdigest()[:12]
