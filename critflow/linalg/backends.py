"""The sparse solvers of symmetric matrices behind one interface, and the choice between them by size.

All eliminate along the diagonal only, so that A = L D Lᵀ and the signs of D are the inertia:

qdldl    row by row on a minimum-degree ordering; always installed, and the fastest for small matrices
superlu  SciPy's SuperLU on a minimum-degree ordering; always installed

Extras bring others for large networks (`backends` of their `extra.toml`, with the sizes from which they are faster):
eliminating ones, and iterative ones for Laplacians of positive stresses, without inertia, as a kind of `Factor`.
"""

from __future__ import annotations

from copy import copy
from functools import cache
from typing import Any, Protocol

import numpy as np
import qdldl
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.csgraph import depth_first_order
from scipy.sparse.linalg import SuperLU, splu

from critflow.extensions import extras
from critflow.linalg.vectors import product
from critflow.result import InputError

Array = NDArray[np.float64]
IntArray = NDArray[np.int32]

# Entries of the upper triangle up to which qdldl is faster, of networks in the plane and in space.  Measured for one
# numeric factorisation and four solves: on Voronoi networks of 300 to 10⁵ vertices the crossovers of the Laplacian, the
# elastic Hessian and the saddle matrix are 180,000, 100,000 and 170,000 entries; they have 2.5, 9 and 12.5 a vertex.
# In space factors fill in faster, as N^(4/3): on foams of 60 to 8,000 vertices the crossovers are 6,000, 11,000 and
# 10,000 entries, of 3, 24 and 23 a vertex.
CROSSOVERS = {"superlu": (150_000, 9_000)}


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
        self.solve = self._solver.solve

    def another(self, model: sp.csc_matrix) -> QDLDL:
        # The library shares no analysis between solvers, but repeats it alike.
        return QDLDL(model)

    def update(self, matrix: sp.csc_matrix) -> None:
        self._solver.update(matrix, upper=True)

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


def _eliminate(matrix: sp.csc_matrix, ordering: str) -> SuperLU:
    return splu(matrix, permc_spec=ordering, diag_pivot_thresh=0.0, options={"SymmetricMode": True})


def multiply(upper: sp.csc_matrix, lower: sp.csr_matrix, x: Array) -> Array:
    """A x of the symmetric matrix with this upper triangle and its transpose, x (n,) or (n, d)."""
    diagonal = upper.data[upper.indptr[1:] - 1]
    return product(upper, x) + product(lower, x) - (diagonal * x.T).T


# The solvers of the scene by name.
BACKENDS: dict[str, type[Backend]] = {"qdldl": QDLDL, "superlu": MinimumDegree}


@cache
def _brought(table: str) -> dict[str, Any]:
    """The installed solvers that extras declare in a table, "backends" or "iterations", by name."""
    declared = [(extra, name, entry) for extra in extras().values() for name, entry in getattr(extra, table).items()]
    kinds = {name: extra.named(entry["place"]) for extra, name, entry in declared}
    return {name: kind for name, kind in kinds.items() if kind.installed()}


def _crossovers(table: str) -> dict[str, Any]:
    """The crossovers that extras declare in a table, by name, also of solvers that are not installed."""
    return {name: entry["crossovers"] for extra in extras().values() for name, entry in getattr(extra, table).items()}


def eliminating_backends() -> dict[str, type[Backend]]:
    """The installed sparse solvers that have an inertia, by name."""
    return BACKENDS | _brought("backends")


def backend_named(name: str) -> type[Backend]:
    """The eliminating solver of a name; an extra is imported for its own alone."""
    return BACKENDS[name] if name in BACKENDS else _brought("backends")[name]


def iterative_factor(name: str) -> Any:
    """The kind of `Factor` of an iterative solver; None for an eliminating one."""
    return None if name in BACKENDS else _brought("iterations").get(name)


def available_backends() -> tuple[str, ...]:
    """Names of the sparse solvers that are installed, each good for `backend=`."""
    return *eliminating_backends(), *_brought("iterations")


def choose_backend(backend: str, n_entries: int, in_space: bool = False) -> str:
    """The name itself if it is installed, or for "auto" the fastest elimination for that many entries (`CROSSOVERS`).

    in_space  whether the network has three dimensions

    Raises `InputError` for a name that is unknown or not installed.
    """
    if backend == "auto":
        sizes = {name: entries[in_space] for name, entries in (CROSSOVERS | _crossovers("backends")).items()}
        if n_entries <= min(sizes.values()):
            return "qdldl"  # without the import of an extra
        larger = min(eliminating_backends().keys() & sizes.keys(), key=sizes.__getitem__)
        return larger if n_entries > sizes[larger] else "qdldl"
    if backend not in BACKENDS and backend not in (installed := available_backends()):
        raise InputError(
            f"no backend {backend!r} is installed: choose 'auto' or one of {', '.join(installed)}, and pip install "
            "'critflow[fast,multigrid]' for all of them"
        )
    return backend


def choose_iteration(elimination: str, n_entries: int) -> str:
    """The iterative solver that is faster than an elimination for a Laplacian in space; none, "", for smaller ones."""
    for name, crossovers in _crossovers("iterations").items():
        if n_entries > crossovers.get(elimination, np.inf) and name in _brought("iterations"):
            return name
    return ""
