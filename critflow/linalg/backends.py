"""The sparse solvers that may factorise a symmetric matrix, behind one interface, and which of them serves what size.

Every one eliminates along the diagonal only, so that A = L D Lᵀ and the signs of D are the inertia:

qdldl    row by row on a minimum-degree ordering; always there, and the fastest while matrices are small
superlu  SciPy's SuperLU on a minimum-degree ordering; always there
metis    SuperLU on a nested dissection, which keeps large planar networks sparser (extra `fast`)
pardiso  Intel's MKL, blocked, on a nested dissection (extra `fast`, x86 only)
single   SuperLU in single precision, refined in double; only where it is asked for
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
import qdldl
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.csgraph import depth_first_order
from scipy.sparse.linalg import SuperLU, splu

from critflow.linalg.pardiso import MKL, Pardiso
from critflow.result import InputError

try:
    import pymetis
except ImportError:
    pymetis = None

Array = NDArray[np.float64]
IntArray = NDArray[np.int32]

# Entries of the upper triangle up to which qdldl is the fastest; of what is installed, the first here serves larger
# matrices.  Measured on Voronoi networks of 300 to 10⁵ vertices, for "factorise anew and solve four times", where the
# Laplacian, the elastic Hessian and the saddle matrix cross qdldl at
#   pardiso 24,000, 9,000 and 40,000;  metis 120,000, 90,000 and 170,000;  superlu 180,000, 100,000 and 170,000
# entries.  A Laplacian has 2.5 of them a vertex, the others in two dimensions 9 and 12.5.
CROSSOVERS = {"pardiso": 20_000, "metis": 120_000, "superlu": 150_000}


class Backend(Protocol):
    """Factorisations of matrices of one pattern, each given by its upper triangle in columns, diagonal included.

    The analysis is made from a model, any positive definite matrix of that pattern.  A vanishing pivot is no error: it
    is a zero of `pivots`.
    """

    def __init__(self, model: sp.csc_matrix): ...

    def update(self, matrix: sp.csc_matrix) -> None:
        """Factorise anew."""

    def solve(self, right: Array) -> Array:
        """x of A x = r, both (n,)."""

    def pivots(self) -> Array:
        """D in the order of elimination, (n,)."""

    def lost(self) -> float:
        """Size of a pivot, against the largest, that is lost in rounding."""


class QDLDL:
    """Without pivoting; stops at an exact zero, and the pivots after it are leftovers."""

    def __init__(self, model: sp.csc_matrix):
        self._size = model.shape[0]
        self._solver = qdldl.Solver(model, upper=True)

    def update(self, matrix: sp.csc_matrix) -> None:
        self._solver.update(matrix, upper=True)

    def solve(self, right: Array) -> Array:
        return self._solver.solve(right)

    def pivots(self) -> Array:
        return self._solver.factors()[1].copy()

    def lost(self) -> float:
        return self._size * np.finfo(float).eps


class MinimumDegree:
    """SuperLU in its symmetric mode, on an ordering that is found once."""

    precision: type[np.floating] = np.float64

    def __init__(self, model: sp.csc_matrix):
        # The matrix in full and in its order, with the place of each entry in the upper triangle, from 1.
        place = sp.csc_matrix((np.arange(1, model.nnz + 1, dtype=np.int32), model.indices, model.indptr), model.shape)
        full = place + sp.triu(place, 1, format="csc").T
        self._order = self._ordering(sp.csc_matrix((model.data[full.data - 1], full.indices, full.indptr), full.shape))
        full = full[self._order][:, self._order].tocsc()
        full.sort_indices()
        self._place = full.data - 1
        self._matrix = sp.csc_matrix((np.empty(full.nnz, self.precision), full.indices, full.indptr), full.shape)
        self._factor: SuperLU | None = None

    def _ordering(self, full: sp.csc_matrix) -> IntArray:
        factor = _eliminate(full, "MMD_AT_PLUS_A")
        order, L = np.argsort(factor.perm_c), factor.L
        # The elimination tree leads from each column to its first row below the diagonal.  In postorder the columns
        # of a subtree stand side by side, which makes wide blocks.
        L.sort_indices()
        n = len(order)
        inner = np.diff(L.indptr) > 1
        parent = np.full(n, n)
        parent[inner] = L.indices[L.indptr[:-1][inner] + 1]
        tree = sp.csr_array((np.ones(n), (parent, np.arange(n))), shape=(n + 1, n + 1))
        return order[depth_first_order(tree, n, return_predecessors=False)[:0:-1]]

    def update(self, matrix: sp.csc_matrix) -> None:
        with np.errstate(over="ignore"):
            np.copyto(self._matrix.data, matrix.data[self._place])
        self._factor = None
        if np.isfinite(self._matrix.data).all():
            try:
                self._factor = _eliminate(self._matrix, "NATURAL")
            except RuntimeError:
                # A column without any pivot.
                self._factor = None

    def solve(self, right: Array) -> Array:
        x = np.full(right.shape, np.nan)
        if self._factor is not None:
            x[self._order] = self._factor.solve(right[self._order].astype(self.precision, copy=False))
        return x

    def pivots(self) -> Array:
        # Where the diagonal vanished, rows were exchanged, and the pivots are not those of L D Lᵀ.
        if self._factor is None or (self._factor.perm_r != np.arange(len(self._order))).any():
            return np.zeros(len(self._order))
        return self._factor.U.diagonal().astype(float)

    def lost(self) -> float:
        return len(self._order) * np.finfo(float).eps


class NestedDissection(MinimumDegree):
    """SuperLU on the ordering of METIS, whose columns stand almost in postorder already."""

    def _ordering(self, full: sp.csc_matrix) -> IntArray:
        return _nested_dissection(full)


def _nested_dissection(full: sp.csc_matrix) -> IntArray:
    graph = (sp.triu(full, 1) + sp.tril(full, -1)).tocsc()
    adjacency = pymetis.CSRAdjacency(graph.indptr, graph.indices)
    return np.array(pymetis.nested_dissection(adjacency)[0], dtype=np.int32)


def _eliminate(matrix: sp.csc_matrix, ordering: str) -> SuperLU:
    return splu(matrix, permc_spec=ordering, diag_pivot_thresh=0.0, options={"SymmetricMode": True})


class Single(MinimumDegree):
    """SuperLU in single precision, whose solutions are refined in double.

    Solutions are NaN where the refinement fails, beyond a condition of about 10⁷; a pivot below 10⁻⁶ of the largest
    counts as lost, so that `singular` is said far more often than by the others.
    """

    precision = np.float32

    def _ordering(self, full: sp.csc_matrix) -> IntArray:
        return super()._ordering(full) if pymetis is None else _nested_dissection(full)

    def update(self, matrix: sp.csc_matrix) -> None:
        super().update(matrix)
        self._upper, self._lower, self._norm = matrix, matrix.T, float(np.abs(matrix.data).max())

    def solve(self, right: Array) -> Array:
        scale = float(np.abs(right).max(initial=0.0))
        if not scale:
            return np.zeros_like(right)
        x, rest, best = np.zeros_like(right), right / scale, np.inf
        for _ in range(_MOST_REFINEMENTS):
            trial = x + super().solve(rest)
            rest = right / scale - multiply(self._upper, self._lower, trial)
            # Backward error: the change of the matrix, against its largest entry, that would explain the residual.
            error = float(np.abs(rest).max() / (self._norm * np.abs(trial).max()))
            if not error < 0.5 * best:
                break
            x, best = trial, error
        return scale * x if best < _REFINED else np.full_like(right, np.nan)

    def lost(self) -> float:
        return 1e-6


_MOST_REFINEMENTS = 30
# Backward error of a solution that is as good as one in double precision.
_REFINED = 1e-14


def multiply(upper: sp.csc_matrix, lower: sp.csr_matrix, x: Array) -> Array:
    """A x of the symmetric matrix with this upper triangle and its transpose, x (n,) or (n, d)."""
    diagonal = upper.data[upper.indptr[1:] - 1]
    return upper @ x + lower @ x - (diagonal * x.T).T


_ALWAYS: dict[str, type[Backend]] = {"qdldl": QDLDL, "superlu": MinimumDegree, "single": Single}


def _installed() -> dict[str, type[Backend]]:
    backends = dict(_ALWAYS)
    if pymetis is not None:
        backends["metis"] = NestedDissection
    if MKL is not None:
        backends["pardiso"] = Pardiso
    return backends


def available_backends() -> tuple[str, ...]:
    """Names of the sparse solvers that are installed, each good for `backend=`."""
    return tuple(_installed())


def choose_backend(backend: str, n_entries: int) -> str:
    """The name itself if it is installed, or for "auto" the fastest for that many entries (see `CROSSOVERS`).

    Raises `InputError` for a name that is unknown or not installed.
    """
    installed = _installed()
    if backend == "auto":
        larger = next(name for name in CROSSOVERS if name in installed)
        return larger if n_entries > CROSSOVERS[larger] else "qdldl"
    if backend in installed:
        return backend
    if backend in CROSSOVERS:
        raise InputError(f"the backend {backend!r} is not installed: pip install 'critflow[fast]', or backend='auto'")
    raise InputError(
        f"there is no backend {backend!r}: choose 'auto' or one of {', '.join(installed)}, and pip install "
        "'critflow[fast]' for all of them"
    )


def make_backend(name: str, model: sp.csc_matrix) -> Backend:
    """The backend of an installed name, with its analysis of the pattern of the model."""
    return _installed()[name](model)
