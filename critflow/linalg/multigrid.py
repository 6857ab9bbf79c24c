"""Conjugate gradients with algebraic multigrid, for Laplacians of positive stresses: solves without pivots.

In space the factor of a Laplacian fills in as N^(4/3), and multigrid needs memory and time ∝ N (physics: the smooth
errors that relaxation leaves are those of a coarser network).  Smoothed aggregation on PyAMG's aggregates:

1. Each level A has a unit diagonal, and a vector b of its smooth errors: of a network, constant before the scaling.
2. Aggregates of strongly connected vertices are the vertices of the next level; T has b on each of them, normalised.
3. The prolongation is T − (4/3) D⁻¹ A T with the sums D of the sizes in each row, the restriction its transpose R, and
   the next level is R A Rᵀ.

A cycle is one sweep of damped Jacobi before and one after the coarser level, so that it is symmetric.  It only
approximates an inverse, so single precision is enough for it, and halves its memory and time.

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
# Of the prolongation: by the sums D of the rows, where a largest eigenvalue would be found from random numbers.
_SMOOTHED = 4 / 3
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
        A = sp.csr_array(upper + sp.triu(upper, 1, format="csc").T)
        # Neighbours in space become neighbours in memory, which halves the time of a product.
        self._order = reverse_cuthill_mckee(A, symmetric_mode=True)
        A = A[self._order][:, self._order]
        A.sort_indices()
        smooth = np.sqrt(A.diagonal())
        self._scale = 1 / smooth
        self._A = A = _scaled(A, self._scale, self._scale)
        # Smoothing and restriction of every level; the prolongation is the transpose of the restriction.
        self._levels: list[tuple[sp.csr_array, sp.csr_array, sp.csc_array]] = []
        with np.errstate(all="ignore"):
            while A.shape[0] > _COARSEST:
                smoothing = sp.csr_array((-_DAMPING * A.data.astype(np.float32), A.indices, A.indptr), A.shape)
                R, A, smooth = _coarser(A, smooth)
                R = R.astype(np.float32)
                self._levels.append((smoothing, R, R.T))
            self._inverse = np.linalg.pinv(A.toarray(), hermitian=True).astype(np.float32)

    def _cycle(self, right: Single, level: int = 0) -> Single:
        """A rough x of A x = r at a level, (n,)."""
        if level == len(self._levels):
            return self._inverse @ right
        smoothing, restriction, prolongation = self._levels[level]
        x = _DAMPING * right
        left = add_product(smoothing, right, right.copy())
        coarse = add_product(restriction, left, np.zeros(restriction.shape[0], np.float32))
        np.copyto(left, x)
        better = add_product(prolongation, self._cycle(coarse, level + 1), left)
        x += better
        return add_product(smoothing, better, x)

    def solve(self, right: Array, reduction: float = REDUCED) -> Array:
        """x of A x = r, both (n,), up to a reduced residual; NaN where the iteration does not converge."""
        r = self._scale * right[self._order]
        x, p, last, size = np.zeros_like(r), np.zeros_like(r), 1.0, np.linalg.norm(r)
        goal, step, rough = reduction * size, 0, np.empty(len(r), np.float32)
        # Parts of a network without a fixed vertex let it overflow.
        with np.errstate(all="ignore"):
            while size > goal and step < MOST_STEPS:
                step += 1
                np.divide(r, size, out=rough, casting="same_kind")
                z = size * self._cycle(rough).astype(float)
                slope = r @ z
                p *= slope / last
                p += z
                Ap = product(self._A, p)
                length = slope / (p @ Ap)
                x += np.multiply(length, p, out=z)
                Ap *= length
                r -= Ap
                last, size = slope, np.linalg.norm(r)
        answer = np.full(len(right), np.nan)
        if size <= goal:
            answer[self._order] = self._scale * x
        return answer


def _coarser(A: sp.csr_array, smooth: Array) -> tuple[sp.csr_array, sp.csr_array, Array]:
    """The restriction to the next level, its matrix and its smooth vector.

    A       (n, n) with a unit diagonal
    smooth  the vector b of smooth errors, (n,)
    """
    strong = np.abs(A.data) >= _STRONG
    counts = np.concatenate([[0], np.cumsum(strong)]).astype(A.indptr.dtype)
    connections = sp.csr_matrix((A.data[strong], A.indices[strong], counts[A.indptr]), A.shape)
    # 0.2 s, and only large networks in space need it.
    T = sp.csr_array(import_module("pyamg.aggregation.aggregate").standard_aggregation(connections)[0], dtype=float)
    sizes = np.sqrt(T.T @ smooth**2)
    T = _scaled(T, smooth, 1 / sizes)
    weights = _SMOOTHED / np.add.reduceat(np.abs(A.data), A.indptr[:-1])
    R = sp.csr_array((T - _scaled(A @ T, weights, np.ones(T.shape[1]))).T)
    coarse = R @ (A @ R.T)
    scale = 1 / np.sqrt(coarse.diagonal())
    return _scaled(R, scale, np.ones(len(smooth))), _scaled(coarse, scale, scale), sizes / scale


def _scaled(matrix: sp.csr_array, left: Array, right: Array) -> sp.csr_array:
    """diag(left) A diag(right)."""
    matrix = sp.csr_array(matrix)
    data = np.repeat(left, np.diff(matrix.indptr)) * matrix.data * right[matrix.indices]
    return sp.csr_array((data, matrix.indices, matrix.indptr), matrix.shape)
