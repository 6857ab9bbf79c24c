"""Conjugate gradients with algebraic multigrid (PyAMG), for Laplacians of positive stresses: solves without pivots.

In space the factor of a Laplacian fills in as N^(4/3), and multigrid needs memory and time ∝ N (physics: the smooth
errors that relaxation leaves are those of a coarser network).  Levels are those of Ruge and Stüben; one damped Jacobi
step before and one after the coarser level keep the preconditioner symmetric.

The matrices served have negative off-diagonal entries and no negative row sums, so that they are positive definite
where the network is connected: the inertia is known without pivots.
"""

from __future__ import annotations

from importlib import import_module
from importlib.util import find_spec

import numpy as np
import scipy.linalg
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.csgraph import reverse_cuthill_mckee

from critflow.linalg.tolerances import EPS

INSTALLED = find_spec("pyamg") is not None
# Reduction of a residual, in the norm of the preconditioner, that ends a solve: rounding is near 1e-14 at 10⁶ vertices.
REDUCED = 1e-12
MOST_STEPS = 300  # of one solve; 30 to 110 suffice where stresses span two decades, 300 at seven
COARSEST = 400  # rows of a matrix that a dense factor solves
DAMPED = 4 / 3  # over the largest row sum of |D⁻¹A|, which limits its eigenvalues: damps all above half of that

Array = NDArray[np.float64]


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
        # 0.2 s, and only large networks in space need it.
        levels_of = import_module("pyamg").ruge_stuben_solver
        A = (upper + sp.triu(upper, 1, format="csc").T).tocsr()
        # Neighbours in space become neighbours in memory, which halves the time of a product.
        self._order = reverse_cuthill_mckee(A, symmetric_mode=True)
        self._A = A[self._order][:, self._order]
        self._A.sort_indices()
        *levels, coarsest = levels_of(self._A, max_coarse=COARSEST).levels
        # Single precision suffices for a preconditioner, and memory limits its speed.
        self._levels = [
            tuple(part.astype(np.float32) for part in (level.A, _jacobi(level.A), level.P, level.R)) for level in levels
        ]
        try:
            self._coarsest = scipy.linalg.cho_factor(coarsest.A.toarray())
        except np.linalg.LinAlgError:
            # Parts of a network without a fixed vertex.
            self._coarsest = None

    def solve(self, right: Array, reduction: float = REDUCED) -> Array:
        """x of A x = r, both (n,), up to a reduced residual; NaN where the iteration does not converge."""
        answer, x, residual = np.full(len(right), np.nan), np.zeros(len(right)), right[self._order]
        if self._coarsest is None:
            return answer
        step = self._cycle(residual.astype(np.float32), 0).astype(float)
        size = first = float(residual @ step)
        direction = step
        for _ in range(MOST_STEPS):
            if size <= reduction**2 * first:
                answer[self._order] = x
                break
            product = self._A @ direction
            length = size / float(direction @ product)
            x += length * direction
            residual -= length * product
            step = self._cycle(residual.astype(np.float32), 0).astype(float)
            size, before = float(residual @ step), size
            direction = step + (size / before) * direction
        return answer

    def _cycle(self, residual: NDArray[np.float32], depth: int) -> NDArray[np.float32]:
        """An approximation of A⁻¹ r by all coarser levels."""
        if depth == len(self._levels):
            return scipy.linalg.cho_solve(self._coarsest, residual, check_finite=False).astype(np.float32)
        A, damping, prolong, restrict = self._levels[depth]
        x = damping * residual
        x += prolong @ self._cycle(restrict @ (residual - A @ x), depth + 1)
        x += damping * (residual - A @ x)
        return x


def _jacobi(A: sp.csr_matrix) -> Array:
    """The factors of a damped Jacobi step, (n,)."""
    diagonal = A.diagonal()
    return DAMPED / float((np.asarray(abs(A).sum(axis=1)).ravel() / diagonal).max()) / diagonal
