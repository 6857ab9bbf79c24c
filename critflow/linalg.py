"""The one file that factorises: sparse symmetric matrices whose pattern is fixed and whose values change.

A network's matrices keep their pattern while σ, the lengths or the strain change.  So the pattern and its symbolic
analysis are made once, the values follow from the edges by one precomputed sparse product, and every later
factorisation L D Lᵀ is numeric only.  The signs of D give the inertia, which tells rigid from unstable.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import qdldl
import scipy.sparse as sp
from numpy.typing import NDArray

from critflow.network import Array, Network
from critflow.result import CritflowError


class StaleFactorError(CritflowError):
    """A factor was used after its matrix had been factorised anew."""


class FixedPattern:
    """A sparse symmetric matrix A = Σ_s values_s A_s with constant A_s, given as entries of its upper triangle.

    rows, cols, sources, coefficients  (n_entries,) entry (row, col) gains coefficient × values[source]; entries
    below the diagonal are ignored, so that symmetric contributions may be listed in full
    """

    def __init__(self, size: int, n_sources: int, entries: Sequence[tuple[Any, Any, Any, Any]]):
        parts = [np.broadcast_arrays(*part) for part in entries]
        rows, cols, sources, coefficients = (np.concatenate([p[k].ravel() for p in parts]) for k in range(4))
        upper = (rows <= cols) & (rows >= 0)
        rows, cols, sources, coefficients = rows[upper], cols[upper], sources[upper], coefficients[upper]
        # Every diagonal entry is part of the pattern, so that shifts and zero blocks fit.
        diagonal = np.arange(size)
        place = np.concatenate([cols, diagonal]) * size + np.concatenate([rows, diagonal])
        slots, slot = np.unique(place, return_inverse=True)
        self.size = size
        self._gather = sp.csr_array((coefficients, (slot[: len(rows)], sources)), shape=(len(slots), n_sources))
        self._diagonal = slot[len(rows) :]
        indptr = np.searchsorted(slots // size, np.arange(size + 1))
        data = np.zeros(len(slots))
        self._matrix = sp.csc_matrix((data, slots % size, indptr), shape=(size, size))
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
            # The analysis needs the pattern only; a singular matrix would be refused here, but not by the update.
            values_of = matrix.data.copy()
            matrix.data[:] = 0.0
            matrix.data[self._diagonal] = 1.0
            self._solver = qdldl.Solver(matrix, upper=True)
            np.copyto(matrix.data, values_of)
        self._solver.update(matrix, upper=True)
        self._generation += 1
        return Factor(self, self._generation)

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
        upper = self._current()._matrix
        diagonal = upper.data[self._owner._diagonal]
        return upper @ x + upper.T @ x - (diagonal * x.T).T

    @property
    def pivots(self) -> Array:
        """The diagonal D, (n,)."""
        if self._pivots is None:
            self._pivots = self._current()._solver.factors()[1].copy()
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
        # The solver stops at an exact zero without saying so; the pivots after it are then leftovers.
        return not bool(size.min() > len(size) * np.finfo(float).eps * size.max() and np.isfinite(size).all())

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


def laplacian(network: Network) -> FixedPattern:
    """P = gᵀ diag(σ) g over the free vertices, (n_free, n_free), from σ (N_b,) (`PrestressMatrix`)."""
    tail, head = _unknowns(network).T
    edge = np.arange(network.n_edges)
    # An edge from a vertex to its own image moves with it and adds nothing; the entries cancel.
    low, high = np.minimum(tail, head), np.maximum(tail, head)
    return FixedPattern(
        len(network.free),
        network.n_edges,
        [
            (tail, tail, edge, 1.0),
            (head, head, edge, 1.0),
            (low, high, edge, np.where(tail == head, -2.0, -1.0)),
        ],
    )


def block_laplacian(network: Network) -> FixedPattern:
    """Σ_α g_α g_αᵀ ⊗ C_α over the free coordinates, (d·n_free)², from the upper triangles of C_α (`GenericHessian`).

    The values are `edge_blocks(...)`: with C_α = K_α L_α L_αᵀ + σ_α 1 this is the elastic Hessian.
    """
    d = network.dimension
    ends = _unknowns(network)
    tail, head = ends.T
    edge = np.arange(network.n_edges)
    entries = []
    # Number of each pair (row, col) in the upper triangle of a symmetric block.
    number = np.zeros((d, d), int)
    number[np.triu_indices(d)] = np.arange(d * (d + 1) // 2)
    number = np.maximum(number, number.T)
    for row in range(d):
        for col in range(d):
            source = edge + network.n_edges * number[row, col]
            for i, j, sign in ((tail, tail, 1.0), (head, head, 1.0), (tail, head, -1.0), (head, tail, -1.0)):
                inside = (i >= 0) & (j >= 0)
                entries.append((d * i[inside] + row, d * j[inside] + col, source[inside], sign))
    return FixedPattern(d * len(network.free), network.n_edges * d * (d + 1) // 2, entries)


def edge_blocks(along: Array, vectors: Array, isotropic: Array) -> Array:
    """Values for `block_laplacian` of C_α = along_α v_α v_αᵀ + isotropic_α 1: two (N_b,) and v (N_b, d)."""
    d = vectors.shape[1]
    blocks = np.empty((d * (d + 1) // 2, len(vectors)))
    for block, row, col in zip(blocks, *np.triu_indices(d), strict=True):
        np.multiply(along * vectors[:, row], vectors[:, col], out=block)
        if row == col:
            block += isotropic
    return blocks.ravel()


def pair_laplacian(network: Network, pairs: tuple[NDArray[np.integer], NDArray[np.integer]]) -> FixedPattern:
    """Σ_{αβ} g_α g_βᵀ ⊗ C_{αβ} over the free coordinates, (d·n_free)², for energies that couple edges.

    pairs  edges α and β, (n_pairs,) each, with (β, α) beside every (α, β); the values are C of shape (n_pairs, d, d)
    """
    d = network.dimension
    ends, signs = _unknowns(network), (-1.0, 1.0)
    first, second = ends[pairs[0]], ends[pairs[1]]
    entries = []
    for row, col in np.ndindex(d, d):
        source = np.arange(len(first)) * d * d + d * row + col
        for end, other in np.ndindex(2, 2):
            i, j = first[:, end], second[:, other]
            inside = (i >= 0) & (j >= 0)
            entries.append((d * i[inside] + row, d * j[inside] + col, source[inside], signs[end] * signs[other]))
    return FixedPattern(d * len(network.free), len(first) * d * d, entries)


class Saddle:
    """Systems with the matrix [[P ⊗ 1, Rᵀ], [R, 0]], P = gᵀ diag(σ) g and R = g L, by a quasi-definite factorisation.

    The unknowns are displacements u (n_free, d) and edge multipliers λ (N_b,).  Where R has a left null vector (the
    self-stress) the second equation must be consistent; λ is then free by a multiple of it.  The tiny −δ that makes
    the matrix factorisable for any ordering is removed by iterative refinement.
    """

    def __init__(self, network: Network):
        d, n_edges = network.dimension, network.n_edges
        self._shape = (len(network.free), d)
        size = d * len(network.free) + n_edges
        tail, head = _unknowns(network).T
        edge = np.arange(n_edges)
        entries = []
        for axis in range(d):
            i, j = d * tail + axis, d * head + axis
            i[tail < 0], j[head < 0] = -1, -1
            both = (i >= 0) & (j >= 0)
            entries += [(i, i, edge, 1.0), (j, j, edge, 1.0)]
            entries += [
                (np.minimum(i, j)[both], np.maximum(i, j)[both], edge[both], np.where(i == j, -2.0, -1.0)[both])
            ]
            multiplier = d * len(network.free) + edge
            component = n_edges * (1 + axis) + edge
            entries += [(i, multiplier, component, -1.0), (j, multiplier, component, 1.0)]
        self._pattern = FixedPattern(size, n_edges * (1 + d), entries)

    def factorize(self, sigma: Array, bond_vectors: Array) -> Saddle:
        """Factorise at stresses σ (N_b,) and bond vectors L (N_b, d); the last factorisation is the one that solves."""
        shift = self._shifts(sigma, bond_vectors)
        self._shift, self._null = shift, sigma / np.linalg.norm(sigma)
        # Residuals are judged by the size of the terms that cancel in them; the right side itself may vanish.
        length = np.linalg.norm(bond_vectors, axis=1)
        self._scale = np.full(self._pattern.size, float(np.mean(length**2)))
        self._scale[: self._shape[0] * self._shape[1]] = float(np.mean(np.abs(sigma) * length))
        self._factor = self._pattern.factorize(self._values(sigma, bond_vectors), shift)
        return self

    def _shifts(self, sigma: Array, bond_vectors: Array, regularisation: float = 1e-7) -> Array:
        shift = np.zeros(self._pattern.size)
        size = float(np.mean(bond_vectors**2) / np.mean(np.abs(sigma)))
        shift[self._shape[0] * self._shape[1] :] = -regularisation * size
        return shift

    def _values(self, sigma: Array, bond_vectors: Array) -> Array:
        return np.concatenate([sigma, bond_vectors.T.ravel()])

    def stable(self, sigma: Array, bond_vectors: Array, margin: float = 1e-7) -> bool:
        """Whether P is positive on the null space of R, by `margin` times the mean stress.

        Then exactly the multipliers give negative pivots.  A positive stress needs no factorisation to tell.
        """
        if (sigma > margin * np.mean(np.abs(sigma))).all():
            return True
        n_coordinates = self._shape[0] * self._shape[1]
        shift = self._shifts(sigma, bond_vectors)
        shift[:n_coordinates] = -margin * float(np.mean(np.abs(sigma)))
        factor = self._pattern.factorize(self._values(sigma, bond_vectors), shift)
        return factor.sound and factor.n_negative == self._pattern.size - n_coordinates

    def solve(
        self, forces: Array, elongations: Array, tolerance: float = 1e-15, max_refinements: int = 30
    ) -> tuple[Array, Array, float]:
        """Solve P u + Rᵀ λ = forces (n_free, d), R u = elongations (N_b,); also the relative residual.

        What the elongations have along σ, which no displacement can give, is left out.
        """
        consistent = elongations - (self._null @ elongations) * self._null
        right = np.concatenate([forces.ravel(), consistent])
        solution = np.zeros_like(right)
        residual, best = right, np.inf
        for _ in range(max_refinements):
            trial = solution + self._factor.solve(residual)
            residual = right - self._factor.multiply(trial) + self._shift * trial
            error = float(np.max(np.abs(residual) / self._scale))
            if not error < 0.9 * best:
                break
            solution, best = trial, error
            if error < tolerance:
                break
        n_coordinates = forces.size
        return solution[:n_coordinates].reshape(self._shape), solution[n_coordinates:], best


def _unknowns(network: Network) -> NDArray[np.int64]:
    """Tail and head of each edge as positions among the free vertices, −1 for fixed ones, (N_b, 2)."""
    index = np.full(network.n_vertices, -1)
    index[network.free] = np.arange(len(network.free))
    return index[network.edges]
