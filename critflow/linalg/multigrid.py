"""Conjugate gradients with algebraic multigrid, for Laplacians of positive stresses: solves without pivots.

In space the factor of a Laplacian fills in as N^(4/3), and multigrid needs memory and time ∝ N (physics: the smooth
errors that relaxation leaves are those of a coarser network).  PyAMG makes the levels by smoothed aggregation; a cycle
is one sweep of damped Jacobi before and one after the coarser level, so that it is symmetric.  It only approximates an
inverse, so single precision is enough for it, and halves its memory and time.  Every level has a unit diagonal.

The matrices served have negative off-diagonal entries and no negative row sums, so that they are positive definite
where the network is connected: the inertia is known without pivots.
"""

from __future__ import annotations

from importlib import import_module
from importlib.util import find_spec

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.csgraph import reverse_cuthill_mckee

from critflow.linalg.products import add_product, product
from critflow.linalg.tolerances import EPS

INSTALLED = find_spec("pyamg") is not None
REDUCED = 1e-12  # reduction of a residual that ends a solve: rounding is near 1e-14 at 10⁶ vertices
MOST_STEPS = 300  # of one solve; 20 to 100 suffice where stresses span up to four decades
# Part of the geometric mean of two diagonal entries from which an entry between them is strong, and joins an aggregate.
# Of stresses over four decades this halves the steps; with all of them strong or weak alike it makes no difference.
_STRONG = 0.01
_DAMPING = np.float32(0.8)  # of Jacobi: from 0.7 to 0.9 the number of steps varies by one in twenty
# Of the prolongation: weights by the rows, where those by the largest eigenvalue start from random numbers.
_SMOOTHED = ("jacobi", {"weighting": "local"})
_COARSEST = 300  # vertices of a level that is solved by its dense inverse

Array = NDArray[np.float64]
Single = NDArray[np.float32]


def serves(upper: sp.csc_matrix) -> bool:
    """Whether a symmetric matrix, given by its upper triangle with the diagonal, is such a Laplacian."""
    diagonal = upper.data[upper.indptr[1:] - 1]
    if not (np.isfinite(upper.data).all() and (diagonal > 0).all()):
        return False
    if np.count_nonzero(upper.data < 0) != upper.nnz - len(diagonal):
        return False
    ones = np.ones(len(diagonal))
    sums = upper @ ones + upper.T @ ones - diagonal
    return bool((sums >= -64 * EPS * diagonal).all())


class Multigrid:
    """The levels of one matrix A (n, n), given by its upper triangle, which `serves` accepts."""

    def __init__(self, upper: sp.csc_matrix):
        A = (upper + sp.triu(upper, 1, format="csc").T).tocsr()
        # Neighbours in space become neighbours in memory, which halves the time of a product.
        self._order = reverse_cuthill_mckee(A, symmetric_mode=True)
        A = A[self._order][:, self._order]
        A.sort_indices()
        roots = np.sqrt(A.diagonal())
        self._A, self._scale = _scaled(A, 1 / roots, 1 / roots), 1 / roots
        # 0.2 s, and only large networks in space need it.  The smooth errors are constant before scaling.
        solver = import_module("pyamg").smoothed_aggregation_solver
        options = {"symmetry": "symmetric", "improve_candidates": None, "max_coarse": _COARSEST, "smooth": _SMOOTHED}
        with np.errstate(all="ignore"):
            levels = solver(self._A, roots[:, None], strength=("symmetric", {"theta": _STRONG}), **options).levels
            scales = [1 / np.sqrt(level.A.diagonal()) for level in levels]
            self._levels = [
                tuple(
                    matrix.astype(np.float32)
                    for matrix in (
                        -_DAMPING * _scaled(level.A, fine, fine),
                        _scaled(level.R, coarse, 1 / fine),
                        _scaled(level.P, 1 / fine, coarse),
                    )
                )
                for level, fine, coarse in zip(levels[:-1], scales[:-1], scales[1:], strict=True)
            ]
            coarsest = _scaled(levels[-1].A, scales[-1], scales[-1]).toarray()
            self._inverse = np.linalg.pinv(coarsest, hermitian=True).astype(np.float32)

    def _cycle(self, right: Single, level: int = 0) -> Single:
        """A rough x of A x = r at a level, (n,)."""
        if level == len(self._levels):
            return self._inverse @ right
        smoothing, restriction, prolongation = self._levels[level]
        x = _DAMPING * right
        left = add_product(smoothing, right, right.copy())
        coarse = add_product(restriction, left, np.zeros(restriction.shape[0], np.float32))
        better = add_product(prolongation, self._cycle(coarse, level + 1), x.copy())
        x += better
        return add_product(smoothing, better, x)

    def solve(self, right: Array, reduction: float = REDUCED) -> Array:
        """x of A x = r, both (n,), up to a reduced residual; NaN where the iteration does not converge."""
        r = self._scale * right[self._order]
        x, p, last, size = np.zeros_like(r), np.zeros_like(r), 1.0, np.linalg.norm(r)
        goal, step = reduction * size, 0
        # Parts of a network without a fixed vertex let it overflow.
        with np.errstate(all="ignore"):
            while size > goal and step < MOST_STEPS:
                step += 1
                z = size * self._cycle((r / size).astype(np.float32)).astype(float)
                slope = r @ z
                p = z + slope / last * p
                Ap = product(self._A, p)
                length = slope / (p @ Ap)
                x += length * p
                r -= length * Ap
                last, size = slope, np.linalg.norm(r)
        answer = np.full(len(right), np.nan)
        if size <= goal:
            answer[self._order] = self._scale * x
        return answer


def _scaled(matrix: sp.csr_array, left: Array, right: Array) -> sp.csr_array:
    """diag(left) A diag(right)."""
    matrix = sp.csr_array(matrix)
    data = np.repeat(left, np.diff(matrix.indptr)) * matrix.data * right[matrix.indices]
    return sp.csr_array((data, matrix.indices, matrix.indptr), matrix.shape)
