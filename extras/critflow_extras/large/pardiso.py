"""The Pardiso solver of Intel's MKL, called by its C interface: phases 11, 22 and 33, and −1 at the end of life.

Diagonal pivoting only, no scaling and no matching: then A = L D Lᵀ with a diagonal D as everywhere else here, the signs
of D are the inertia, and the same input gives the same bits.  `pip install 'critflow[fast]'` installs MKL.
"""

from __future__ import annotations

import ctypes
import os
import sys
import sysconfig
import weakref
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from critflow.result import SolveError

Array = NDArray[np.float64]


def _load() -> Any:
    """MKL's runtime library in the folders of pip, of pip for one user, and of conda, or None."""
    user = sysconfig.get_path("data", sysconfig.get_preferred_scheme("user"))
    for prefix in (sys.prefix, sysconfig.get_path("data"), user):
        for folder in ("lib", "Library/bin"):
            for path in sorted(Path(prefix, folder).glob("*mkl_rt.*")):
                try:
                    return ctypes.CDLL(str(path))
                except OSError:
                    continue
    return None


MKL = _load()

_SYMMETRIC_INDEFINITE = -2
_ANALYSE, _FACTORISE, _SOLVE, _RELEASE = 11, 22, 33, -1
# A pivot below 10⁻³⁰ ‖A‖ is replaced by that, and counted: far below rounding, so that no valid pivot changes.
_SMALLEST_PIVOT = 30
# Entries of iparm, counted from 1 as in Intel's manual, that differ from its zeros.
_SETTINGS = {
    1: 1,  # these, not the defaults
    2: 2,  # nested dissection
    10: _SMALLEST_PIVOT,
    21: 0,  # diagonal pivots only
    35: 1,  # indices start at zero
    56: 1,  # keep the diagonal for `pardiso_getdiag`
}
_N_REPLACED = 14


class Pardiso:
    """The interface is that of `Backend` in `critflow.sparse`."""

    def __init__(self, model: sp.csc_matrix):
        self.size = model.shape[0]
        # The upper triangle by rows, and the position of each of its entries in the columns.
        number = np.arange(model.nnz, dtype=np.int32)
        by_rows = sp.csc_matrix((number, model.indices, model.indptr), shape=model.shape).tocsr()
        self._place = by_rows.data
        self._starts, self._columns = by_rows.indptr.astype(np.int32), by_rows.indices.astype(np.int32)
        self._values = model.data[self._place]
        self._memory = np.zeros(64, np.int64)
        self._settings = np.zeros(64, np.int32)
        for position, value in _SETTINGS.items():
            self._settings[position - 1] = value
        self._factorised = False
        weakref.finalize(self, _call, _RELEASE, self._memory, self._settings, self.size)
        self._run(_ANALYSE)

    def another(self, model: sp.csc_matrix) -> Pardiso:
        # One handle keeps as many factors as its analysis was made for, so each solver has a handle.
        return Pardiso(model)

    def _run(self, phase: int, right: Array | None = None, x: Array | None = None) -> int:
        arrays = (self._values, self._starts, self._columns, right, x)
        error = _call(phase, self._memory, self._settings, self.size, *arrays)
        if error == -2:
            raise MemoryError("Pardiso has no memory for this factorisation")
        if error and error != -4:
            raise SolveError(f"Pardiso failed with code {error}: choose another backend")
        return error

    def update(self, matrix: sp.csc_matrix) -> None:
        np.take(matrix.data, self._place, out=self._values)
        self._factorised = bool(np.isfinite(self._values).all()) and self._run(_FACTORISE) == 0

    @property
    def _n_replaced(self) -> int:
        """Number of pivots that vanished."""
        return int(self._settings[_N_REPLACED - 1])

    def solve(self, right: Array) -> Array:
        x = np.full(self.size, np.nan)
        if self._factorised and not self._n_replaced:
            self._run(_SOLVE, np.ascontiguousarray(right, dtype=float), x)
        return x

    def pivots(self) -> Array:
        pivots, before = np.zeros(self.size), np.empty(self.size)
        if self._factorised:
            error = ctypes.c_int32(0)
            arguments = (_address(self._memory), _address(pivots), _address(before), ctypes.byref(_ONE))
            MKL.pardiso_getdiag(*arguments, ctypes.byref(error))
            if self._n_replaced:
                pivots[np.argpartition(np.abs(pivots), self._n_replaced - 1)[: self._n_replaced]] = 0.0
        return pivots


_ONE = ctypes.c_int32(1)


def _call(phase: int, memory: NDArray[np.int64], settings: NDArray[np.int32], size: int, *arrays: Any) -> int:
    """The error code of one call of `pardiso`, on one thread unless the environment sets a number of threads."""
    values, starts, columns, right, x = arrays or (None,) * 5
    number = [ctypes.c_int32(i) for i in (_SYMMETRIC_INDEFINITE, phase, size, 0)]
    kind, step, n, silent = map(ctypes.byref, number)
    one, error = ctypes.byref(_ONE), ctypes.c_int32(0)
    threads = None if "MKL_NUM_THREADS" in os.environ else MKL.MKL_Set_Num_Threads_Local(1)
    # memory, maxfct, mnum, mtype, phase, n, a, ia, ja, perm, nrhs, iparm, msglvl, b, x, error
    MKL.pardiso(
        *(_address(memory), one, one, kind, step, n, _address(values), _address(starts), _address(columns), None),
        *(one, _address(settings), silent, _address(right), _address(x), ctypes.byref(error)),
    )
    if threads is not None:
        MKL.MKL_Set_Num_Threads_Local(threads)
    return error.value


def _address(array: NDArray[Any] | None) -> ctypes.c_void_p | None:
    return None if array is None else ctypes.c_void_p(array.ctypes.data)
