"""A netCDF file from elsewhere, looked at by a process of its own before this one opens it.

A head made to do harm can keep the netCDF library busy for ever, exhaust the memory or crash the process, and no check
from outside can tell.  So the first look is taken by a process with little memory and time, which may end as it likes.
This file is that process's program too; it imports nothing of critflow, to begin at once.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from math import prod
from pathlib import Path

import netCDF4

if os.name == "posix":
    import resource

_MEMORY = 2**31  # bytes of address space, of which the libraries take a quarter
_PROCESSOR_SECONDS = 5  # of which the libraries take one
_SECONDS = 120.0  # a slow disk may take its time


def refusal(path: Path) -> str:
    """Why a file is not opened; nothing when it may be."""
    command = [sys.executable, "-P", __file__, str(path.absolute())]
    environment = os.environ | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}  # each thread takes memory
    try:
        ended = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=_SECONDS)
    except subprocess.TimeoutExpired:
        return "reading its head takes for ever"
    if ended.returncode < 0:
        return "reading its head crashes the netCDF library or takes for ever"
    return ended.stdout.strip() or ("" if ended.returncode == 0 else "its head cannot be read")


def _strange(path: str) -> Iterator[str]:
    """What no study writes into its dataset."""
    with netCDF4.Dataset(path) as file:
        if file.groups or file.cmptypes or file.vltypes or file.enumtypes:
            yield "it has groups or types of its own"
        total = 0
        for name, variable in file.variables.items():
            if variable.dtype is str or variable.dtype.kind not in "iufS":
                yield f"its {name!r} is of a type that no study has"
                return
            total += prod(map(int, variable.shape)) * variable.dtype.itemsize
            _ = [variable.getncattr(key) for key in variable.ncattrs()]
        _ = [file.getncattr(key) for key in file.ncattrs()]
        if total > (size := os.stat(path).st_size):
            yield f"it declares {total:,} bytes of arrays and has {size:,}"


def _limit() -> None:
    if os.name == "posix":
        resource.setrlimit(resource.RLIMIT_AS, (_MEMORY, _MEMORY))
        resource.setrlimit(resource.RLIMIT_CPU, (_PROCESSOR_SECONDS, _PROCESSOR_SECONDS))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


if __name__ == "__main__":
    _limit()
    try:
        print(next(_strange(sys.argv[1]), ""))
    except Exception as error:
        print(f"its head cannot be read: {type(error).__name__}: {error}")
