"""Provenance: code, versions and command that made a file, in words that are equal wherever the same code runs.

No name of a machine, user or folder is stored.  Two runs of the same code on the same libraries differ only in the
attribute `history`.
"""

from __future__ import annotations

import os
import platform
import re
import subprocess
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
from critflow.workflow.code import numeric_modules

_PACKAGE = Path(__file__).parents[1]
_ENVIRONMENT = ("numpy", "scipy", "qdldl", "clarabel", "pypardiso", "pyamg")  # packages that numbers may depend on


@cache
def libraries() -> Mapping[str, str]:
    """Versions that must be equal in every process of a run, with a digest of the files that decide numbers."""
    whole, numeric = sha256(), [name for name, extra in extras().items() if extra.numeric]
    for name, path in numeric_modules(numeric).items():
        whole.update(f"{name}\0".encode() + sha256(path.read_bytes()).digest())
    return {"critflow": f"{version('critflow')} {whole.hexdigest()[:12]}"} | _versions()


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
