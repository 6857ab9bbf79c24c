"""The matrices of a network: stress-weighted Laplacian, elastic Hessian and saddle system, ready to be factorised.

They keep their pattern while σ, the lengths or the strain change, so each is a `FixedPattern` made once.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from critflow.linalg.factor import Factor, FixedPattern, ShiftedFactor, StaleFactorError
from critflow.networks.network import Array, Network

__all__ = [
    "Factor",
    "FixedPattern",
    "Saddle",
    "ShiftedFactor",
    "StaleFactorError",
    "block_laplacian",
    "edge_blocks",
    "laplacian",
    "pair_laplacian",
]


def laplacian(network: Network, backend: str = "auto") -> FixedPattern:
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
        backend,
    )


def block_laplacian(network: Network, backend: str = "auto") -> FixedPattern:
    """Σ_α g_α g_αᵀ ⊗ C_α over the free coordinates, (d·n_free)², from the upper triangles of C_α (`GenericHessian`).

    The values are `edge_blocks(...)`: with C_α = K_α L_α L_αᵀ + σ_α 1 this is the elastic Hessian.
    """
    d = network.dimension
    ends = _unknowns(network)
    tail, head = ends.T
    edge = np.arange(network.n_edges)
    # Number of each pair (row, col) in the upper triangle of a symmetric block.
    number = np.zeros((d, d), int)
    number[np.triu_indices(d)] = np.arange(d * (d + 1) // 2)
    number = np.maximum(number, number.T)

    def entries() -> Iterator[tuple[Any, Any, Any, float]]:
        for row, col in np.ndindex(d, d):
            source = edge + network.n_edges * number[row, col]
            for i, j, sign in ((tail, tail, 1.0), (head, head, 1.0), (tail, head, -1.0), (head, tail, -1.0)):
                inside = (i >= 0) & (j >= 0)
                yield d * i[inside] + row, d * j[inside] + col, source[inside], sign

    return FixedPattern(d * len(network.free), network.n_edges * d * (d + 1) // 2, entries(), backend)


def edge_blocks(along: Array, vectors: Array, isotropic: Array) -> Array:
    """Values for `block_laplacian` of C_α = along_α v_α v_αᵀ + isotropic_α 1: two (N_b,) and v (N_b, d)."""
    d = vectors.shape[1]
    blocks = np.empty((d * (d + 1) // 2, len(vectors)))
    for block, row, col in zip(blocks, *np.triu_indices(d), strict=True):
        np.multiply(along * vectors[:, row], vectors[:, col], out=block)
        if row == col:
            block += isotropic
    return blocks.ravel()


def pair_laplacian(
    network: Network, pairs: tuple[NDArray[np.integer], NDArray[np.integer]], backend: str = "auto"
) -> FixedPattern:
    """Σ_{αβ} g_α g_βᵀ ⊗ C_{αβ} over the free coordinates, (d·n_free)², for energies that couple edges.

    pairs  edges α and β, (n_pairs,) each, with (β, α) beside every (α, β); the values are C of shape (n_pairs, d, d)
    """
    d = network.dimension
    ends, signs = _unknowns(network), (-1.0, 1.0)
    first, second = ends[pairs[0]], ends[pairs[1]]

    def entries() -> Iterator[tuple[Any, Any, Any, float]]:
        for row, col in np.ndindex(d, d):
            source = np.arange(len(first)) * d * d + d * row + col
            for end, other in np.ndindex(2, 2):
                i, j = first[:, end], second[:, other]
                inside = (i >= 0) & (j >= 0)
                yield d * i[inside] + row, d * j[inside] + col, source[inside], signs[end] * signs[other]

    return FixedPattern(d * len(network.free), len(first) * d * d, entries(), backend)


class Saddle:
    """Systems with the matrix [[P ⊗ 1, Rᵀ], [R, 0]], P = gᵀ diag(σ) g and R = g L, by a quasi-definite factorisation.

    The unknowns are displacements u (n_free, d) and edge multipliers λ (N_b,).  Where R has a left null vector (the
    self-stress) the second equation must be consistent; λ is then free by a multiple of it.  The tiny −δ that makes
    the matrix factorisable for any ordering is removed by iterative refinement.  Each row of R is divided by the length
    of its edge, or rounding would hide what the shortest edges ask for.
    """

    def __init__(self, network: Network, backend: str = "auto"):
        d, n_edges = network.dimension, network.n_edges
        n_coordinates = d * len(network.free)
        self._shape = (len(network.free), d)
        tail, head = _unknowns(network).T
        edge = np.arange(n_edges)

        def entries() -> Iterator[tuple[Any, Any, Any, Any]]:
            for axis in range(d):
                i, j = d * tail + axis, d * head + axis
                i[tail < 0], j[head < 0] = -1, -1
                both = (i >= 0) & (j >= 0)
                yield i, i, edge, 1.0
                yield j, j, edge, 1.0
                yield np.minimum(i, j)[both], np.maximum(i, j)[both], edge[both], np.where(i == j, -2.0, -1.0)[both]
                component = n_edges * (1 + axis) + edge
                yield i, n_coordinates + edge, component, -1.0
                yield j, n_coordinates + edge, component, 1.0

        self._pattern = FixedPattern(n_coordinates + n_edges, n_edges * (1 + d), entries(), backend)

    @property
    def backend(self) -> str:
        """The sparse solver that was chosen."""
        return self._pattern.backend

    def factorize(self, sigma: Array, bond_vectors: Array) -> Saddle:
        """Factorise at stresses σ (N_b,) and bond vectors L (N_b, d); the last factorisation is the one that solves."""
        shift = self._shifts(sigma)
        self._shift, self._null = shift, sigma / np.linalg.norm(sigma)
        # Residuals are judged by the size of the terms that cancel in them; the right side itself may vanish.
        length = np.linalg.norm(bond_vectors, axis=1)
        self._scale = np.full(self._pattern.size, float(np.mean(length)))
        self._scale[: self._shape[0] * self._shape[1]] = float(np.mean(np.abs(sigma) * length))
        self._divisor = _divisors(length)
        self._factor = self._pattern.factorize(self._values(sigma, bond_vectors), shift)
        return self

    def _shifts(self, sigma: Array, regularisation: float = 1e-7) -> Array:
        shift = np.zeros(self._pattern.size)
        shift[self._shape[0] * self._shape[1] :] = -regularisation / (self._shape[1] * float(np.mean(np.abs(sigma))))
        return shift

    def _values(self, sigma: Array, bond_vectors: Array) -> Array:
        directions = bond_vectors / _divisors(np.linalg.norm(bond_vectors, axis=1))[:, None]
        return np.concatenate([sigma, directions.T.ravel()])

    def stable(self, sigma: Array, bond_vectors: Array, margin: float = 1e-7) -> bool:
        """Whether P is positive on the null space of R, by `margin` times the mean stress.

        Then exactly the multipliers give negative pivots.  A positive stress needs no factorisation to tell.
        """
        if (sigma > margin * np.mean(np.abs(sigma))).all():
            return True
        n_coordinates = self._shape[0] * self._shape[1]
        shift = self._shifts(sigma)
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
        right = np.concatenate([forces.ravel(), consistent / self._divisor])
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
        return solution[:n_coordinates].reshape(self._shape), solution[n_coordinates:] / self._divisor, best

    def solve_bordered(self, forces: Array, elongations: Array, target: Array) -> tuple[Array, Array]:
        """Solve P u + Rᵀ λ = forces (n_free, d), R u − μ t = elongations (N_b,), tᵀ λ = 0 for u and λ.

        These are Newton's steps to lengths in the ratios of a target t (N_b,).  Off their end R has no left null
        vector, only one that nearly is; the factor μ of the target is then what keeps the system well-conditioned.
        """
        border = np.concatenate([np.zeros(forces.size), -target / self._divisor])
        right = np.concatenate([forces.ravel(), elongations / self._divisor])
        through = self._factor.solve(border)
        solution, ratio, best = np.zeros_like(right), 0.0, np.inf
        residual, rest = right, 0.0
        for _ in range(30):
            change = self._factor.solve(residual)
            change_of_ratio = float((border @ change - rest) / (border @ through))
            trial, trial_ratio = solution + change - change_of_ratio * through, ratio + change_of_ratio
            residual = right - self._factor.multiply(trial) + self._shift * trial - trial_ratio * border
            rest = -float(border @ trial)
            error = float(np.max(np.abs(residual) / self._scale))
            if not error < 0.9 * best:
                break
            solution, ratio, best = trial, trial_ratio, error
            if error < 1e-15:
                break
        return solution[: forces.size].reshape(forces.shape), solution[forces.size :] / self._divisor


def _divisors(length: Array) -> Array:
    """What the rows of R are divided by; that of an edge without length is zero anyway."""
    return np.where(length > 0, length, 1.0)


def _unknowns(network: Network) -> NDArray[np.int64]:
    """Tail and head of each edge as positions among the free vertices, −1 for fixed ones, (N_b, 2)."""
    index = np.full(network.n_vertices, -1)
    index[network.free] = np.arange(len(network.free))
    return index[network.edges]
