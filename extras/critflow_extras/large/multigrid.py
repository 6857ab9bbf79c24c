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
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.linalg.blas import daxpy, saxpy
from scipy.sparse.csgraph import reverse_cuthill_mckee

from critflow.numerics import EPS, KERNELS, product, quasi_random
from critflow.sparse import REDUCED

INSTALLED = find_spec("pyamg") is not None
MOST_STEPS = 400  # of one solve; 20 to 80 suffice where stresses span up to four decades
# Part of the geometric mean of two diagonal entries from which an entry between them is strong, and joins an aggregate,
# of the given matrix and of the coarser ones.  Of stresses over four decades the first one halves the steps of 0.01;
# with all of them strong or weak alike it makes no difference.  Coarser aggregates grow too small with it.
_STRONG, _COARSE_STRONG = 0.1, 0.01
# Of Jacobi: a sweep needs a product with the largest eigenvalue below 2, and that of the given matrix is at most 2.
_DAMPING = 0.9
# That of a coarser level times its largest eigenvalue, of which some steps give 0.9 or more.  That is near 1.3, so
# that a sweep reduces more errors than with the damping of the given matrix, and a solve needs a sixth fewer steps.
_COARSE_DAMPING, _LANCZOS_STEPS = 1.7, 8
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
        A = _scaled(A, self._scale, self._scale)
        self._off_diagonal = off_diagonal = _off_diagonal(A)
        # Damping, −damping × off-diagonal entries and restriction of every level; prolongation is its transpose.
        self._levels: list[tuple[float, sp.csr_array, sp.csr_array, sp.csr_array]] = []
        with np.errstate(all="ignore"):
            while A.shape[0] > _COARSEST:
                damping = _COARSE_DAMPING / _largest_eigenvalue(A) if self._levels else _DAMPING
                data = (-damping * off_diagonal.data).astype(np.float32)
                smoothing = sp.csr_array((data, off_diagonal.indices, off_diagonal.indptr), A.shape)
                R, A, smooth = _coarser(A, smooth, _COARSE_STRONG if self._levels else _STRONG)
                R = R.astype(np.float32)
                self._levels.append((damping, smoothing, R, R.T.tocsr()))
                off_diagonal = _off_diagonal(A)
            self._inverse = np.linalg.pinv(A.toarray(), hermitian=True).astype(np.float32)

    def _cycle(self, right: Single, level: int = 0) -> Single:
        """A rough x of A x = r at a level, (n,)."""
        if level == len(self._levels):
            return self._inverse @ right
        damping, smoothing, restriction, prolongation = self._levels[level]
        x = np.float32(damping) * right
        left = add_product(smoothing, right, right - x)
        coarse = add_product(restriction, left, np.zeros(restriction.shape[0], np.float32))
        np.copyto(left, x)
        better = add_product(prolongation, self._cycle(coarse, level + 1), left)
        return add_product(smoothing, better, saxpy(better, x, a=1 - damping))

    def solve(self, right: Array, reduction: float = REDUCED) -> Array:
        """x of A x = r, both (n,), up to a reduced residual; NaN where the iteration does not converge."""
        r = self._scale * right[self._order]
        given = np.linalg.norm(r)
        # Single precision spans the residuals relative to the given one.
        r /= given or 1.0
        rough, (x, p, z, Ap) = np.empty(len(r), np.float32), np.zeros((4, len(r)))
        last, size, step = 1.0, float(given > 0), 0
        # Parts of a network without a fixed vertex let it overflow.
        with np.errstate(all="ignore"):
            while size > reduction and step < MOST_STEPS:
                step += 1
                np.copyto(rough, r, casting="same_kind")
                np.copyto(z, self._cycle(rough))
                slope = r @ z
                p, z = daxpy(p, z, a=slope / last), p
                np.copyto(Ap, p)
                length = slope / (p @ add_product(self._off_diagonal, p, Ap))
                daxpy(p, x, a=length)
                daxpy(Ap, r, a=-length)
                last, size = slope, float(np.linalg.norm(r))
        answer = np.full(len(right), np.nan)
        if size <= reduction:
            answer[self._order] = given * self._scale * x
        return answer


def _coarser(A: sp.csr_array, smooth: Array, least: float) -> tuple[sp.csr_array, sp.csr_array, Array]:
    """The restriction to the next level, its matrix and its smooth vector.

    A       (n, n) with a unit diagonal
    smooth  the vector b of smooth errors, (n,)
    least   size of a strong entry
    """
    connections = sp.csr_matrix(_part(A, np.abs(A.data) >= least))
    # 0.2 s, and only large networks in space need it.
    T = sp.csr_array(import_module("pyamg.aggregation.aggregate").standard_aggregation(connections)[0], dtype=float)
    sizes = np.sqrt(T.T @ smooth**2)
    T = _scaled(T, smooth, 1 / sizes)
    weights = _SMOOTHED / abs(A).sum(axis=1)
    R = sp.csr_array((T - _scaled(A @ T, weights, np.ones(T.shape[1]))).T)
    coarse = R @ (A @ R.T)
    scale = 1 / np.sqrt(coarse.diagonal())
    return _scaled(R, scale, np.ones(len(smooth))), _scaled(coarse, scale, scale), sizes / scale


def _part(A: sp.csr_array, kept: NDArray[np.bool_]) -> sp.csr_array:
    """Some of the entries of A."""
    starts = np.concatenate([[0], np.cumsum(kept)]).astype(A.indptr.dtype)[A.indptr]
    return sp.csr_array((A.data[kept], A.indices[kept], starts), A.shape)


def _off_diagonal(A: sp.csr_array) -> sp.csr_array:
    """A without its diagonal, which is 1."""
    return _part(A, A.indices != np.repeat(np.arange(A.shape[0], dtype=A.indices.dtype), np.diff(A.indptr)))


def _largest_eigenvalue(A: sp.csr_array) -> float:
    """A lower estimate of the largest eigenvalue of A, by Lanczos' method; zero for a matrix that is not finite."""
    v, last, alphas, betas = 2 * quasi_random(A.shape[0]) - 1, np.zeros(A.shape[0]), [], [0.0]
    v /= np.linalg.norm(v)
    for _ in range(_LANCZOS_STEPS):
        w = product(A, v) - betas[-1] * last
        alphas.append(v @ w)
        w -= alphas[-1] * v
        betas.append(float(np.linalg.norm(w)))
        last, v = v, w / np.float64(betas[-1])
    return np.linalg.eigvalsh(np.nan_to_num(np.diag(alphas) + np.diag(betas[1:-1], -1)))[-1]


def _scaled(matrix: sp.csr_array, left: Array, right: Array) -> sp.csr_array:
    """diag(left) A diag(right)."""
    matrix = sp.csr_array(matrix)
    data = np.repeat(left, np.diff(matrix.indptr)) * matrix.data * right[matrix.indices]
    return sp.csr_array((data, matrix.indices, matrix.indptr), matrix.shape)


def add_product(matrix: sp.csr_array | sp.csc_matrix, x: NDArray[Any], y: NDArray[Any]) -> NDArray[Any]:
    """y + A x in place of a contiguous y (n,) or (n, d), all of the same precision."""
    # The kernels make a contiguous copy of an x that is not.
    KERNELS[matrix.format][x.ndim - 1](y.shape[0], *x.shape, matrix.indptr, matrix.indices, matrix.data, x, y)
    return y
