"""Patterns of the matrices of a network: stress-weighted Laplacian and elastic Hessian.

Their patterns stay the same while σ, the lengths or the strain change, so each is a `FixedPattern` made once.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations_with_replacement

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from critflow.linalg.factor import Entries, FixedPattern
from critflow.networks.network import Array, IntArray, Network

# Shift of the Hessian of unit springs, relative to ⟨|L|²⟩, that removes the zero modes of any geometry.
BALANCE_SHIFT = 1e-13


def laplacian(network: Network, backend: str = "auto") -> FixedPattern:
    """P = gᵀ diag(σ) g over the free vertices, (n_free, n_free), from σ (N_b,) (`PrestressMatrix`)."""
    entries = [Entries(*pair) for pair in end_pairs(network)]
    return FixedPattern(len(network.free), network.n_edges, entries, backend, network.dimension > 2, laplacian=True)


def end_pairs(network: Network) -> Iterator[tuple[IntArray, IntArray, IntArray, float]]:
    """All pairs (i, j) of free ends of an edge, with the edges α and the product g_αi g_αj.

    The four of an edge from a vertex to its own image, which moves with it, cancel.
    """
    tail, head = free_ends(network).T
    for i, j, sign in ((tail, tail, 1.0), (head, head, 1.0), (tail, head, -1.0), (head, tail, -1.0)):
        edge = np.flatnonzero((i >= 0) & (j >= 0))
        yield i[edge], j[edge], edge, sign


def block_laplacian(network: Network, backend: str = "auto") -> FixedPattern:
    """Σ_α g_α g_αᵀ ⊗ C_α over the free coordinates, (d·n_free)², from the upper triangles of C_α (`GenericHessian`).

    The values are `edge_blocks(...)`: with C_α = K_α L_α L_αᵀ + σ_α 1 this is the elastic Hessian.
    """
    d = network.dimension
    return FixedPattern(d * len(network.free), n_block_values(network), block_entries(network), backend, d > 2)


def n_block_values(network: Network) -> int:
    """Number of values of `block_laplacian`."""
    return network.n_edges * network.dimension * (network.dimension + 1) // 2


def block_entries(network: Network) -> Iterator[Entries]:
    """The entries of `block_laplacian`, for patterns with further ones."""
    d = network.dimension
    # Number of each pair (row, col) in the upper triangle of a symmetric block.
    number = np.zeros((d, d), int)
    number[np.triu_indices(d)] = np.arange(d * (d + 1) // 2)
    number = np.maximum(number, number.T)
    for i, j, edge, sign in end_pairs(network):
        for row, col in np.ndindex(d, d):
            yield Entries(d * i + row, d * j + col, edge + network.n_edges * number[row, col], sign)


def edge_blocks(axial: Array, vectors: Array, isotropic: Array) -> Array:
    """Values for `block_laplacian` of C_α = axial_α v_α v_αᵀ + isotropic_α 1: two (N_b,) and v (N_b, d)."""
    d = vectors.shape[1]
    blocks = np.empty((d * (d + 1) // 2, len(vectors)))
    for block, (row, col) in zip(blocks, combinations_with_replacement(range(d), 2), strict=True):
        np.multiply(axial * vectors[:, row], vectors[:, col], out=block)
        if row == col:
            block += isotropic
    return blocks.ravel()


def free_ends(network: Network) -> NDArray[np.int64]:
    """Tail and head of each edge as positions among the free vertices, −1 for fixed ones, (N_b, 2)."""
    index = np.full(network.n_vertices, -1)
    index[network.free] = np.arange(len(network.free))
    return index[network.edges]


def rigidity_matrix(network: Network, coordinates: Array) -> sp.csr_array:
    """R = ∂|L|/∂x over the free coordinates, (N_b, d·n_free): incidence times unit vectors (`RigidityMatrix`)."""
    L = network.bond_vectors(coordinates)
    return spread_columns(network, L / np.linalg.norm(L, axis=1)[:, None])


def spread_columns(network: Network, vectors: Array) -> sp.csr_array:
    """The matrix (N_b, d·n_free) with entries g_{αi} v_{αμ} of edge vectors v (N_b, d)."""
    g, d = network.free_incidence, network.dimension
    columns = [sp.diags_array(vectors[:, axis]) @ g for axis in range(d)]
    order = np.arange(d * g.shape[1]).reshape(d, -1).T.ravel()
    return sp.csr_array(sp.hstack(columns).tocsc()[:, order])


def balanced_part(
    network: Network, L: Array, sigma: Array, pattern: FixedPattern, shift: float = BALANCE_SHIFT
) -> Array:
    """The component of σ in balance at bond vectors L: σ less its projection on the columns of R^h.

    Close to the transition, where extensions have few digits, or where edges are much shorter than the coordinates are
    large, unbalanced forces from rounding are not small compared with the tensions.

    pattern  of the elastic Hessian, whose `shift` removes the zero modes
    """
    ones = np.ones(len(sigma))
    factor = pattern.factorize(edge_blocks(ones, L, 0 * ones), shift)
    for _ in range(3):
        force = network.divergence @ (sigma[:, None] * L)
        u = factor.solve(force.ravel()).reshape(force.shape)
        sigma = sigma - np.einsum("ad,ad->a", L, network.free_incidence @ u)
    return sigma
