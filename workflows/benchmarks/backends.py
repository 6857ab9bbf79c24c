"""The linear solvers that the benchmarks compare."""

from __future__ import annotations

from enum import IntEnum


class Backend(IntEnum):
    """The linear solver of a method or stage, as stored in data files: append, never renumber."""

    none = 0
    qdldl = 1
    pardiso = 2
    metis = 3
    superlu = 4
    single = 5
    dense = 6
    multigrid = 7
    other = 8
