"""Conjugate gradients with algebraic multigrid (PyAMG), for Laplacians of positive stresses: solves without pivots.

In space the factor of a Laplacian fills in as N^(4/3), and multigrid needs memory and time ∝ N (physics: the smooth
errors that relaxation leaves are those of a coarser network).  Levels are those of Ruge and Stüben; one sweep of Gauss
and Seidel forwards before the coarser level and one backwards after it keep the preconditioner symmetric.

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

from critflow.linalg.tolerances import EPS

INSTALLED = find_spec("pyamg") is not None
REDUCED = 1e-12  # reduction of a residual that ends a solve: rounding is near 1e-14 at 10⁶ vertices
MOST_STEPS = 300  # of one solve; 20 to 60 suffice where stresses span up to four decades

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
        A = (upper + sp.triu(upper, 1, format="csc").T).tocsr()
        # Neighbours in space become neighbours in memory, which halves the time of a product.
        self._order = reverse_cuthill_mckee(A, symmetric_mode=True)
        A = A[self._order][:, self._order]
        A.sort_indices()
        # 0.2 s, and only large networks in space need it.
        solver = import_module("pyamg").ruge_stuben_solver
        self._levels = solver(
            A,
            presmoother=("gauss_seidel", {"sweep": "forward"}),
            postsmoother=("gauss_seidel", {"sweep": "backward"}),
        )

    def solve(self, right: Array, reduction: float = REDUCED) -> Array:
        """x of A x = r, both (n,), up to a reduced residual; NaN where the iteration does not converge."""
        options = {"tol": reduction, "maxiter": MOST_STEPS, "accel": "cg", "return_info": True}
        with np.errstate(all="ignore"):
            # Parts of a network without a fixed vertex let it overflow.
            x, failed = self._levels.solve(right[self._order], **options)
        answer = np.full(len(right), np.nan)
        if not failed:
            answer[self._order] = x
        return answer
