"""Sparse symmetric matrices with a fixed pattern and variable values, and their factors.

The pattern and its symbolic analysis are made once, the values follow from their sources by one precomputed sparse
product, and each factorisation A = L D Lᵀ is numeric only.  The signs of D are the inertia of A, which separates rigid
from unstable configurations.  The solver depends on the size and on the installed packages
(`critflow.linalg.backends`).

A `Factor` owns its numbers.  Solvers overwrite their L and D in place, so the pattern gives its first solver to the
newest factor; an older factor in use again eliminates its own matrix once more, in a second solver that stays with it.
One factor at a time thus needs one analysis and the memory of one L, and any number of factors are valid together.
Threads may share a pattern: they wait for each other.
"""

from __future__ import annotations

import weakref
from collections.abc import Callable, Iterable
from threading import RLock
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from critflow.linalg.backends import (
    Backend,
    backend_named,
    choose_backend,
    choose_iteration,
    iterative_factor,
    multiply,
)
from critflow.linalg.tolerances import EPS
from critflow.linalg.vectors import product

# Shift δ in units of the mean value.  A matrix with the same inertia at ±δ counts as regular; the shift is far above
# the rounding of pivots.
INERTIA_SHIFT = 1e-9
REDUCED = 1e-12  # reduction of the residual at which an iterative solver ends: rounding is near 1e-14 at 10⁶ vertices
REFINED_SOLVES = 20  # most refinements of a solve with A + δ.  Each reduces the error by δ over the smallest eigenvalue

Array = NDArray[np.float64]
IntArray = NDArray[np.int32]


class Entries(NamedTuple):
    """Contributions coefficients_e × values[sources_e] to the entries (rows_e, cols_e) of a matrix, (n_entries,) each.

    Symmetric contributions may be listed in full: entries below the diagonal, and those with a negative index, are
    ignored.
    """

    rows: Any
    cols: Any
    sources: Any
    coefficients: Any


class FixedPattern:
    """A sparse symmetric matrix A = Σ_s values_s A_s with constant A_s, from the entries of its upper triangle.

    size       number of rows n
    n_sources  number of values
    in_space   whether the network has three dimensions
    laplacian  whether it is its Laplacian, for which "auto" may choose an iterative solver in space
    """

    def __init__(
        self,
        size: int,
        n_sources: int,
        entries: Iterable[Entries],
        backend: str = "auto",
        in_space: bool = False,
        laplacian: bool = False,
    ):
        parts = [_upper(*np.broadcast_arrays(*part)) for part in entries]
        rows, cols, sources, coefficients = (np.concatenate(part) for part in zip(*parts, strict=True))
        # Every diagonal entry is part of the pattern, so that shifts and zero blocks fit.
        diagonal = np.arange(size, dtype=np.int32)
        keys = np.concatenate([cols, diagonal]).astype(np.int64) * size + np.concatenate([rows, diagonal])
        places, slot = np.unique(keys, return_inverse=True)
        slot = slot[: len(rows)].astype(np.int32)
        gather = sp.coo_array((coefficients, (slot, sources)), shape=(len(places), n_sources))
        self._gather = sp.csr_array(gather)
        self.size, self.n_sources = size, n_sources
        # One matrix and its transpose take the data of each factor in turn; making them takes longer than a product.
        cols, rows = np.divmod(places, size)
        starts = np.searchsorted(cols, np.arange(size + 1)).astype(np.int32)
        self._matrix = sp.csc_matrix((np.zeros(len(rows)), rows.astype(np.int32), starts), shape=(size, size))
        self._transposed = self._matrix.T
        # The diagonal ends each column of an upper triangle.
        self._diagonal = self._matrix.indptr[1:] - 1
        self.backend = choose_backend(backend, len(places), in_space)
        if backend == "auto" and in_space and laplacian:
            self.backend = choose_iteration(self.backend, len(places)) or self.backend
        kind = iterative_factor(self.backend)
        self._kind: type[Factor] = kind or Factor
        # An iterative solver of "auto" leaves what it cannot serve to this one.
        self.elimination = choose_backend("auto", len(places), in_space) if kind else self.backend
        self.may_eliminate = not kind or backend == "auto"
        # Solvers and the factors whose numbers they contain; the first one belongs to the newest factor.
        self._solvers: list[Backend] = []
        self._owners: list[Callable[[], Factor | None]] = []
        # Solvers and the matrix are overwritten, and solvers release Python's own lock.
        self._lock = RLock()

    def __getstate__(self) -> dict[str, Any]:
        """Without solvers, which a copy makes at its first use, and without the lock."""
        return self.__dict__ | {"_solvers": [], "_owners": [], "_lock": None}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state, _lock=RLock())

    def analyse(self) -> None:
        """Order and analyse the pattern for elimination, as the first elimination does otherwise."""
        with self._lock:
            if not self._solvers:
                self._add(backend_named(self.elimination)(self._model()))

    def factorize(self, values: Array, shift: float | Array = 0.0) -> Factor:
        """L D Lᵀ of A + shift·1, with values (n_sources,) and a shift for all or for each of the rows (n,)."""
        data = product(self._gather, values)
        if isinstance(shift, np.ndarray) or shift:
            data[self._diagonal] += shift
        factor = self._kind(self, data)
        with self._lock:
            factor.prepare()
        return factor

    def filled(self, data: Array) -> sp.csc_matrix:
        """The upper triangle with other data; valid until the next call."""
        self._matrix.data = data
        return self._matrix

    def factorize_shifted(self, values: Array) -> tuple[Factor, bool, int]:
        """L D Lᵀ of A + δ, whether its inertia is that of A, and the number of negative pivots of A − δ.

        Values of both signs may give a vanishing pivot without a vanishing eigenvalue.  Where the inertias of A + δ
        and A − δ differ, an eigenvalue lies within δ of zero.
        """
        shift = INERTIA_SHIFT * float(np.mean(np.abs(values)))
        below = self.factorize(values, -shift)
        sound, n_negative = below.sound, below.n_negative
        above = self.factorize(values, shift)
        return above, sound and above.sound and above.n_negative == n_negative, n_negative

    def factorize_signed(self, values: Array) -> Factor:
        """As `factorize` for values of both signs: `singular` only where an eigenvalue is as good as zero.

        Where a pivot vanishes, A + δ is factorised instead, and `solve` refines its answers.  Right-hand sides in the
        range of a singular A have answers too: none of the null space enters them.
        """
        factor = self.factorize(values)
        if factor.singular:
            factor, regular, _ = self.factorize_shifted(values)
            factor._refine(INERTIA_SHIFT * float(np.mean(np.abs(values))), regular)
        return factor

    def _model(self) -> sp.csc_matrix:
        """A matrix of this pattern for the analysis, safely positive definite: a Laplacian with a weak ground."""
        indices, indptr = self._matrix.indices, self._matrix.indptr
        data = np.full(len(indices), -1.0)
        data[self._diagonal] = np.diff(indptr) + np.bincount(indices, minlength=self.size) - 2 + 0.01
        return sp.csc_matrix((data, indices, indptr), shape=self._matrix.shape)

    def _multiply(self, factor: Factor, x: Array) -> Array:
        with self._lock:
            self._matrix.data = self._transposed.data = factor._data
            return multiply(self._matrix, self._transposed, x)

    def _solver_of(self, factor: Factor) -> Backend:
        """The solver that contains the numbers of a factor, after another elimination if they are overwritten."""
        if self._owners and self._owners[0]() is factor:
            return self._solvers[0]
        for solver, owner in zip(self._solvers, self._owners, strict=True):
            if owner() is factor:
                return solver
        # The first solver stays with the newest factor, or two factors in use would overwrite each other in turn.
        unused = (place for place, owner in enumerate(self._owners) if place and owner() is None)
        place = next(unused, len(self._solvers))
        self.analyse()
        if place == len(self._solvers):
            self._add(self._solvers[0].another(self._model()))
        self.eliminate(factor, place)
        return self._solvers[place]

    def _add(self, solver: Backend) -> None:
        self._solvers.append(solver)
        self._owners.append(_nobody)

    def eliminate(self, factor: Factor, place: int = 0) -> None:
        """Let a solver eliminate the matrix of a factor; the first one serves the newest."""
        if not self._solvers:
            self.analyse()
        self._owners[place] = _nobody
        self._matrix.data = factor._data
        self._solvers[place].update(self._matrix)
        self._owners[place] = weakref.ref(factor)


def _nobody() -> None:
    """The owner of a solver without numbers."""


class Factor:
    """L D Lᵀ of one matrix A, for any number of right-hand sides; no other factorisation changes its answers.

    A factor that another one of the same pattern has displaced repeats its elimination at its next use.
    """

    __slots__ = ("__weakref__", "_data", "_pattern", "_pivots", "_shift", "_singular")

    def __init__(self, pattern: FixedPattern, data: Array):
        # The upper triangle of A + shift, which stands in for A where the shift is not zero.
        self._pattern, self._data, self._shift = pattern, data, 0.0
        self._pivots: Array | None = None
        self._singular = False

    def prepare(self) -> None:
        """Eliminate."""
        self._pattern.eliminate(self)

    def _refine(self, shift: float, regular: bool) -> None:
        """Serve A in place of A + shift; `regular` as the inertias on both sides of A have it."""
        self._shift, self._singular = shift, not regular

    @property
    def backend(self) -> str:
        """Name of the solver (`critflow.linalg.backends`)."""
        return self._pattern.elimination

    @property
    def iterates(self) -> bool:
        """Whether the time of a solve depends on the reduction of the residual."""
        return False

    def solve(self, right_side: Array) -> Array:
        """x of A x = r, for r of shape (n,) or (n, d)."""
        return self._refined(right_side) if self._shift else self._solved(right_side)

    def solve_roughly(self, right_side: Array, reduction: float) -> Array:
        """As `solve`, with the residual reduced by this factor only, where the solver iterates."""
        return self.solve(right_side)

    def eliminate(self) -> bool:
        """Leave an iterative solver for elimination where it may; whether anything changed."""
        return False

    def _solved(self, right_side: Array) -> Array:
        pattern = self._pattern
        with pattern._lock:
            return by_columns(pattern._solver_of(self).solve, right_side)

    def _refined(self, right_side: Array) -> Array:
        """Iterative refinement, which removes the shift."""
        x, best = self._solved(right_side), np.inf
        for _ in range(REFINED_SOLVES):
            residual = right_side - self.multiply(x)
            size = float(np.abs(residual).max(initial=0.0))
            if not size < 0.5 * best:
                break
            x, best = x + self._solved(residual), size
        return x

    def multiply(self, x: Array) -> Array:
        """A x, for x of shape (n,) or (n, d)."""
        product = self._pattern._multiply(self, x)
        return product - self._shift * x if self._shift else product

    @property
    def pivots(self) -> Array:
        """The diagonal D in the order of elimination, (n,); zero where a pivot vanished."""
        if self._pivots is None:
            with self._pattern._lock:
                self._pivots = self._pattern._solver_of(self).pivots()
        return self._pivots

    @property
    def n_negative(self) -> int:
        """Number of negative eigenvalues of A (Sylvester's law of inertia)."""
        return int(np.count_nonzero(self.pivots < 0))

    @property
    def sound(self) -> bool:
        """Whether the elimination is complete: all pivots are finite and not zero, so that their signs count."""
        return bool(np.isfinite(self.pivots).all() and (self.pivots != 0).all())

    @property
    def singular(self) -> bool:
        """Whether a pivot vanishes, is not finite, or is below the rounding of the largest one."""
        if self._shift:
            return self._singular
        size = np.abs(self.pivots)
        return not bool(size.min() > len(size) * EPS * size.max() and np.isfinite(size).all())

    @property
    def indefinite(self) -> bool:
        """Whether A is not safely positive definite."""
        return self.singular or self.n_negative > 0


def by_columns(solve: Callable[[Array], Array], right_side: Array) -> Array:
    """Solutions for one right-hand side (n,) or several (n, d)."""
    if right_side.ndim == 1:
        return solve(right_side)
    x = np.empty(right_side.shape)
    for column in range(right_side.shape[1]):
        x[:, column] = solve(right_side[:, column])
    return x


def _upper(rows: Any, cols: Any, sources: Any, coefficients: Any) -> tuple[IntArray, IntArray, IntArray, Array]:
    """The entries of the upper triangle, flat, with short integers: at 10⁶ vertices memory counts."""
    upper = (rows <= cols) & (rows >= 0)
    short = (part[upper].astype(np.int32) for part in (rows, cols, sources))
    return *short, coefficients[upper].astype(float)
