"""Sparse symmetric matrices whose pattern is fixed and whose values change, and their factors.

The pattern and its symbolic analysis are made once, the values follow from their sources by one precomputed sparse
product, and every later factorisation L D Lᵀ is numeric only.  The signs of D give the inertia, which tells rigid from
unstable.  Which solver does it depends on the size and on what is installed (`critflow.linalg.backends`).
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from critflow.linalg.backends import choose_backend, make_backend, multiply
from critflow.result import CritflowError

Array = NDArray[np.float64]
IntArray = NDArray[np.int32]


class StaleFactorError(CritflowError):
    """A factor was used after its matrix had been factorised anew."""


class FixedPattern:
    """A sparse symmetric matrix A = Σ_s values_s A_s with constant A_s, given as entries of its upper triangle.

    rows, cols, sources, coefficients  (n_entries,) entry (row, col) gains coefficient × values[source]; entries
    below the diagonal are ignored, so that symmetric contributions may be listed in full
    """

    def __init__(self, size: int, n_sources: int, entries: Iterable[tuple[Any, Any, Any, Any]], backend: str = "auto"):
        parts = [_upper(*np.broadcast_arrays(*part)) for part in entries]
        rows, cols, sources, coefficients = (np.concatenate(part) for part in zip(*parts, strict=True))
        del parts
        n_entries, diagonal = len(rows), np.arange(size, dtype=np.int32)
        # Every diagonal entry is part of the pattern, so that shifts and zero blocks fit.
        rows, cols = np.concatenate([rows, diagonal]), np.concatenate([cols, diagonal])
        order = _sorted_positions(rows, size)
        order = order[_sorted_positions(cols[order], size)]
        rows, cols = rows[order], cols[order]
        first = np.ones(len(rows), bool)
        first[1:] = (rows[1:] != rows[:-1]) | (cols[1:] != cols[:-1])
        slot = np.cumsum(first, dtype=np.int32) - 1
        rows, cols = rows[first], cols[first]
        given = order < n_entries
        order, slot = order[given], slot[given]
        self.size = size
        self._gather = sp.csr_array(
            (coefficients[order], sources[order], _starts(slot, len(rows))), shape=(len(rows), n_sources)
        )
        self._gather.sum_duplicates()
        self._matrix = sp.csc_matrix((np.zeros(len(rows)), rows, _starts(cols, size)), shape=(size, size))
        # A view of the same numbers; making one takes longer than a product of small matrices.
        self._transposed = self._matrix.T
        # The diagonal ends each column of an upper triangle.
        self._diagonal = self._matrix.indptr[1:] - 1
        self.backend = choose_backend(backend, len(rows))
        self._solver: Any = None
        self._generation = 0

    def assemble(self, values: Array, shift: float | Array = 0.0) -> sp.csc_matrix:
        """The upper triangle of A + shift·1; it is overwritten by the next call."""
        np.copyto(self._matrix.data, self._gather @ values)
        if np.ndim(shift) or shift:
            self._matrix.data[self._diagonal] += shift
        return self._matrix

    def factorize(self, values: Array, shift: float | Array = 0.0) -> Factor:
        """Factorise A + shift·1, numerically only after the first time.  Earlier factors become stale."""
        matrix = self.assemble(values, shift)
        if self._solver is None:
            self._solver = make_backend(self.backend, self._model())
        self._solver.update(matrix)
        self._generation += 1
        return Factor(self, self._generation)

    def _model(self) -> sp.csc_matrix:
        """A matrix of this pattern for the analysis, safely positive definite: a Laplacian with a weak ground."""
        indices, indptr = self._matrix.indices, self._matrix.indptr
        data = np.full(len(indices), -1.0)
        data[self._diagonal] = np.diff(indptr) + np.bincount(indices, minlength=self.size) - 2 + 0.01
        return sp.csc_matrix((data, indices, indptr), shape=self._matrix.shape)

    def factorize_signed(self, values: Array) -> Factor:
        """As `factorize` for values of both signs, where a pivot may vanish though no eigenvalue does.

        Then A + δ is factorised instead.  Where the inertias of A + δ and A − δ differ, an eigenvalue lies within δ of
        zero and the factor is `singular`.
        """
        factor = self.factorize(values)
        if factor.singular:
            shift = _BESIDE * float(np.mean(np.abs(values)))
            below = self.factorize(values, -shift)
            sound, n_negative = below.sound, below.n_negative
            self.factorize(values, shift)
            above = ShiftedFactor(self, self._generation, shift)
            regular = sound and above.sound and above.n_negative == n_negative
            factor = above if regular else self.factorize(values)
        return factor


# Shift, in units of the mean value, that tells a singular matrix from a vanishing pivot.
_BESIDE = 1e-9


class Factor:
    """L D Lᵀ of one matrix, serving many right-hand sides."""

    __slots__ = ("_generation", "_owner", "_pivots")

    def __init__(self, owner: FixedPattern, generation: int):
        self._owner, self._generation = owner, generation
        self._pivots: Array | None = None

    def _current(self) -> FixedPattern:
        if self._owner._generation != self._generation:
            raise StaleFactorError("this factor is stale: its matrix was factorised anew, so factorise it again")
        return self._owner

    @property
    def backend(self) -> str:
        """Name of the solver that made it (`critflow.linalg.backends`)."""
        return self._owner.backend

    def solve(self, right_side: Array) -> Array:
        """Solve A x = r for r of shape (n,) or (n, d)."""
        solver = self._current()._solver
        if right_side.ndim == 1:
            return solver.solve(right_side)
        x = np.empty(right_side.shape)
        for column in range(right_side.shape[1]):
            x[:, column] = solver.solve(right_side[:, column])
        return x

    def multiply(self, x: Array) -> Array:
        """A x, with the matrix that was factorised."""
        owner = self._current()
        return multiply(owner._matrix, owner._transposed, x)

    @property
    def pivots(self) -> Array:
        """The diagonal D in the order of elimination, (n,); zero where a pivot vanished."""
        if self._pivots is None:
            self._pivots = self._current()._solver.pivots()
        return self._pivots

    @property
    def n_negative(self) -> int:
        """Number of negative eigenvalues of A (Sylvester's law of inertia)."""
        return int(np.count_nonzero(self.pivots < 0))

    @property
    def sound(self) -> bool:
        """Whether the elimination came to its end: no pivot is zero or not finite, so that their signs count."""
        return bool(np.isfinite(self.pivots).all() and (self.pivots != 0).all())

    @property
    def singular(self) -> bool:
        """Whether a pivot vanished, is not finite, or is lost in the rounding of the largest."""
        size = np.abs(self.pivots)
        return not bool(size.min() > self._owner._solver.lost() * size.max() and np.isfinite(size).all())

    @property
    def indefinite(self) -> bool:
        """Whether A is not safely positive definite."""
        return self.singular or self.n_negative > 0


class ShiftedFactor(Factor):
    """L D Lᵀ of A + δ, serving right-hand sides of A itself by iterative refinement."""

    __slots__ = ("_shift",)

    def __init__(self, owner: FixedPattern, generation: int, shift: float):
        super().__init__(owner, generation)
        self._shift = shift

    def multiply(self, x: Array) -> Array:
        return super().multiply(x) - self._shift * x

    def solve(self, right_side: Array) -> Array:
        x, best = super().solve(right_side), np.inf
        for _ in range(20):
            rest = right_side - self.multiply(x)
            size = float(np.abs(rest).max(initial=0.0))
            if not size < 0.5 * best:
                break
            x, best = x + super().solve(rest), size
        return x

    @property
    def singular(self) -> bool:
        return False


def _upper(rows: Any, cols: Any, sources: Any, coefficients: Any) -> tuple[IntArray, IntArray, IntArray, Array]:
    """The entries of the upper triangle, flat, with short integers: at 10⁶ vertices memory counts."""
    upper = (rows <= cols) & (rows >= 0)
    short = (part[upper].astype(np.int32) for part in (rows, cols, sources))
    return *short, coefficients[upper].astype(float)


def _sorted_positions(keys: IntArray, n_keys: int) -> IntArray:
    """Positions that sort integers below n_keys and keep the order of equals: a counting sort, by a transposition."""
    count = len(keys)
    marks = np.ones(count, np.int8)
    return sp.csr_array((marks, keys, np.arange(count + 1, dtype=np.int32)), shape=(count, n_keys)).tocsc().indices


def _starts(keys: IntArray, n_keys: int) -> IntArray:
    """Where each key begins in a sorted list, (n_keys + 1,)."""
    return np.concatenate([[0], np.cumsum(np.bincount(keys, minlength=n_keys))]).astype(np.int32)
