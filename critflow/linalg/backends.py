"""The sparse solvers of symmetric matrices behind one interface, and the choice between them by size.

All eliminate along the diagonal only, so that A = L D Lᵀ and the signs of D are the inertia:

qdldl    row by row on a minimum-degree ordering; always installed, and the fastest for small matrices
superlu  SciPy's SuperLU on a minimum-degree ordering; always installed
metis    SuperLU on a nested dissection, which keeps large planar networks sparser (extra `fast`)
pardiso  Intel's MKL, blocked, on a nested dissection (extra `fast`, x86 only)

One solves without elimination, so without inertia, and Laplacians of positive stresses alone:

pyamg    conjugate gradients with algebraic multigrid, for large networks in space (extra `multigrid`)
"""

from __future__ import annotations

from copy import copy
from typing import Protocol

import numpy as np
import qdldl
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.csgraph import depth_first_order
from scipy.sparse.linalg import SuperLU, splu

from critflow.extras.large import multigrid
from critflow.extras.large.pardiso import MKL, Pardiso
from critflow.linalg.products import product
from critflow.result import InputError

try:
    import pymetis
except ImportError:
    pymetis = None

Array = NDArray[np.float64]
IntArray = NDArray[np.int32]

# Entries of the upper triangle up to which qdldl is the fastest; the first of these solvers that is installed takes
# larger matrices.  Measured on Voronoi networks of 300 to 10⁵ vertices for one numeric factorisation and four solves.
# The crossovers of the Laplacian, the elastic Hessian and the saddle matrix are, in entries,
#   pardiso 24,000, 9,000 and 40,000;  metis 120,000, 90,000 and 170,000;  superlu 180,000, 100,000 and 170,000.
# Per vertex in two dimensions the Laplacian has 2.5 entries, the others 9 and 12.5.
CROSSOVERS = {"pardiso": 20_000, "metis": 120_000, "superlu": 150_000}
# In space factors fill in faster, as N^(4/3).  Measured likewise on foams of 60 to 8,000 vertices the crossovers of the
# Laplacian, 3 entries a vertex, and of the Hessian and the saddle matrix, 24 and 23, are
#   pardiso 2,000, 5,000 and 6,000;  metis 5,000, 9,000 and 10,000;  superlu 6,000, 11,000 and 10,000.
CROSSOVERS_IN_SPACE = {"pardiso": 3_000, "metis": 8_000, "superlu": 9_000}
# Entries of a Laplacian in space, 3 a vertex of a foam, from which multigrid is faster than each of them for one matrix
# and three solves, by a third or more: with stresses over one decade it takes 0.03 s at 5,000 vertices, against 0.02,
# 0.04 and 0.07, then 0.05 against 0.04, 0.12 and 0.24 at 10,000, 0.11 against 0.14, 0.43 and 1.3 at 20,000, and 0.3
# against 0.7 and 2.4 at 50,000.  Stresses over four decades need three times as many steps.
MULTIGRID = "pyamg"
MULTIGRID_CROSSOVERS = {"pardiso": 60_000, "metis": 20_000, "superlu": 15_000}


class Backend(Protocol):
    """Factorisations of matrices of one pattern, each given by its upper triangle in columns, diagonal included.

    The analysis is made from a model, any positive definite matrix of that pattern.  A vanishing pivot is no error: it
    is a zero of `pivots`.
    """

    def __init__(self, model: sp.csc_matrix): ...

    def another(self, model: sp.csc_matrix) -> Backend:
        """A second solver for the same pattern, with the same analysis, so that it gives the same bits."""

    def update(self, matrix: sp.csc_matrix) -> None:
        """Factorise a matrix; the numbers of the last one are overwritten."""

    def solve(self, right: Array) -> Array:
        """x of A x = r, both (n,)."""

    def pivots(self) -> Array:
        """D in the order of elimination, (n,)."""


class QDLDL:
    """Without pivoting; stops at an exact zero, and the pivots after it are leftovers."""

    def __init__(self, model: sp.csc_matrix):
        self._solver = qdldl.Solver(model, upper=True)

    def another(self, model: sp.csc_matrix) -> QDLDL:
        # The library shares no analysis between solvers, but repeats it alike.
        return QDLDL(model)

    def update(self, matrix: sp.csc_matrix) -> None:
        self._solver.update(matrix, upper=True)

    def solve(self, right: Array) -> Array:
        return self._solver.solve(right)

    def pivots(self) -> Array:
        return self._solver.factors()[1].copy()


class MinimumDegree:
    """SuperLU in its symmetric mode, on an ordering that is found once."""

    def __init__(self, model: sp.csc_matrix):
        # The matrix in full and in its order, with the place of each entry in the upper triangle, from 1.
        place = sp.csc_matrix((np.arange(1, model.nnz + 1, dtype=np.int32), model.indices, model.indptr), model.shape)
        full = place + sp.triu(place, 1, format="csc").T
        self._order = self._ordering(sp.csc_matrix((model.data[full.data - 1], full.indices, full.indptr), full.shape))
        full = full[self._order][:, self._order].tocsc()
        full.sort_indices()
        self._place = full.data - 1
        self._matrix = sp.csc_matrix((np.empty(full.nnz), full.indices, full.indptr), full.shape)
        self._factor: SuperLU | None = None

    def another(self, model: sp.csc_matrix) -> MinimumDegree:
        # The ordering is shared, and so is the matrix, which SuperLU reads only while it eliminates.
        solver = copy(self)
        solver._factor = None
        return solver

    def _ordering(self, full: sp.csc_matrix) -> IntArray:
        factor = _eliminate(full, "MMD_AT_PLUS_A")
        order, L = np.argsort(factor.perm_c), factor.L
        # The elimination tree leads from each column to its first row below the diagonal.  In postorder the columns
        # of a subtree are adjacent, which makes wide blocks.
        L.sort_indices()
        n = len(order)
        inner = np.diff(L.indptr) > 1
        parent = np.full(n, n)
        parent[inner] = L.indices[L.indptr[:-1][inner] + 1]
        tree = sp.csr_array((np.ones(n), (parent, np.arange(n))), shape=(n + 1, n + 1))
        return order[depth_first_order(tree, n, return_predecessors=False)[:0:-1]]

    def update(self, matrix: sp.csc_matrix) -> None:
        np.take(matrix.data, self._place, out=self._matrix.data)
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
            x[self._order] = self._factor.solve(right[self._order])
        return x

    def pivots(self) -> Array:
        # Where the diagonal vanished, rows were exchanged, and the pivots are not those of L D Lᵀ.
        if self._factor is None or (self._factor.perm_r != np.arange(len(self._order))).any():
            return np.zeros(len(self._order))
        return self._factor.U.diagonal()


class NestedDissection(MinimumDegree):
    """SuperLU on the ordering of METIS, whose columns are almost in postorder."""

    def _ordering(self, full: sp.csc_matrix) -> IntArray:
        graph = (sp.triu(full, 1) + sp.tril(full, -1)).tocsc()
        adjacency = pymetis.CSRAdjacency(graph.indptr, graph.indices)
        return np.array(pymetis.nested_dissection(adjacency)[0], dtype=np.int32)


def _eliminate(matrix: sp.csc_matrix, ordering: str) -> SuperLU:
    return splu(matrix, permc_spec=ordering, diag_pivot_thresh=0.0, options={"SymmetricMode": True})


def multiply(upper: sp.csc_matrix, lower: sp.csr_matrix, x: Array) -> Array:
    """A x of the symmetric matrix with this upper triangle and its transpose, x (n,) or (n, d)."""
    diagonal = upper.data[upper.indptr[1:] - 1]
    return product(upper, x) + product(lower, x) - (diagonal * x.T).T


# Solvers by name, without the optional ones.  A further solver is a further entry.
BACKENDS: dict[str, type[Backend]] = {"qdldl": QDLDL, "superlu": MinimumDegree}


def eliminating_backends() -> dict[str, type[Backend]]:
    """The installed sparse solvers that have an inertia, by name."""
    backends = dict(BACKENDS)
    if pymetis is not None:
        backends["metis"] = NestedDissection
    if MKL is not None:
        backends["pardiso"] = Pardiso
    return backends


def available_backends() -> tuple[str, ...]:
    """Names of the sparse solvers that are installed, each good for `backend=`."""
    return *eliminating_backends(), *([MULTIGRID] if multigrid.INSTALLED else [])


def choose_backend(backend: str, n_entries: int, in_space: bool = False, laplacian: bool = False) -> str:
    """The name itself if it is installed, or for "auto" the fastest for that many entries (see `CROSSOVERS`).

    in_space   whether the network has three dimensions (`CROSSOVERS_IN_SPACE`)
    laplacian  whether the matrix is its Laplacian, where multigrid is the fastest in space (`MULTIGRID_CROSSOVERS`)

    Raises `InputError` for a name that is unknown or not installed.
    """
    installed = available_backends()
    if backend == "auto":
        crossovers = CROSSOVERS_IN_SPACE if in_space else CROSSOVERS
        larger = next(name for name in crossovers if name in installed)
        if in_space and laplacian and multigrid.INSTALLED and n_entries > MULTIGRID_CROSSOVERS[larger]:
            return MULTIGRID
        return larger if n_entries > crossovers[larger] else "qdldl"
    if backend in installed:
        return backend
    raise InputError(
        f"no backend {backend!r} is installed: choose 'auto' or one of {', '.join(installed)}, and pip install "
        "'critflow[fast,multigrid]' for all of them"
    )
