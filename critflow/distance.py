"""How far a configuration is from the exact equilibrium of its springs, x* − x = H⁻¹ f with f in extended precision.

Forces of springs are differences of nearly equal lengths, and past the transition soft modes resist them by no more
than the strain: a small force is not a small error.  The stress from extended lengths has all its digits; with it the
correction, repeated at x + δ with the same factor, shrinks by a constant, which bounds what it still misses.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from critflow.extended import Extended, add, extended, two_product, two_sum
from critflow.linalg import Factor
from critflow.network import Array, Network

# Corrections that have not settled after so many will not.
_MOST_CORRECTIONS = 10


@dataclass(frozen=True)
class Distance:
    """What leads to the exact equilibrium: displacement D = x* − x (n_free, d), bond vectors L* (N_b, d).

    missing  bound on what D still misses, largest component; infinite where the corrections do not shrink
    """

    displacement: Array
    bond_vectors: Array
    missing: float


def distance(
    network: Network, coordinates: Array, stress: Callable[[Extended], Array], factor: Factor, held: bool = False
) -> Distance:
    """Correct by a factor of H at or near the configuration until less than the rounding of coordinates is missing.

    stress  σ (N_b,) from extended bond vectors
    held    the factor is not of H alone but holds floppy modes in place: then corrections must shrink to the end,
            since soft modes that it holds as well would make small ones
    """
    rounding = float(np.finfo(float).eps * np.abs(coordinates).max())
    enough, noise = 0.05 * rounding, 0.0 if held else rounding
    D = np.zeros((len(network.free), network.dimension))
    before, missing = np.inf, np.inf
    for _ in range(_MOST_CORRECTIONS):
        L = exact_bond_vectors(network, coordinates, D)
        correction = factor.solve(exact_forces(network, stress(L), L).ravel()).reshape(D.shape)
        size = float(np.abs(correction).max())
        if size == 0.0:
            missing = 0.0
            break
        shrinking = size / before
        if not shrinking < 0.5:
            # Rounding does not shrink.
            missing = 2 * size if size <= max(noise, enough) else np.inf
            break
        D = D + correction
        # A first correction may shrink faster than those after it, so never less than half is taken to be missing.
        missing = 0.5 * size
        if before < np.inf and missing <= enough:
            break
        before = size
    else:
        missing = np.inf
    return Distance(D, L.high + (L.low + network.free_incidence @ correction), missing)


def exact_bond_vectors(network: Network, coordinates: Array, displacement: Array) -> Extended:
    """L = g (x + D) + b, (N_b, d), with displacements D (n_free, d) too small for the coordinates to hold."""
    x, change = coordinates.copy(), np.zeros_like(coordinates)
    # What a pin adds is in b; of a periodic network only differences count.
    x[list(network.pins)] = 0.0
    change[network.free] = displacement
    tail, head = network.edges.T
    difference = add(two_sum(x[head], -x[tail]), extended(network.boundary_vectors))
    return add(difference, two_sum(change[head], -change[tail]))


def exact_forces(network: Network, sigma: Array, bond_vectors: Extended) -> Array:
    """−gᵀ(σ ∘ L), (n_free, d), with the rounding of σ and of the result alone."""
    L, weight = bond_vectors, sigma[:, None]
    pull = two_product(weight, L.high)
    return -exact_sums(network.divergence, Extended(pull.high, pull.low + weight * L.low))


def exact_sums(matrix: sp.csr_array, vectors: Extended, less: Array | float = 0.0) -> Array:
    """A v − w for a sparse A, its terms cancelling without loss.

    The leading halves of A and v lie on grids on which their products and sums are exact; what is left of them is
    smaller by 2⁻²⁵, and so is its rounding.
    """
    leading_matrix = matrix.copy()
    leading_matrix.data = _leading(matrix.data)
    rest = sp.csr_array((matrix.data - leading_matrix.data, matrix.indices, matrix.indptr), shape=matrix.shape)
    leading = _leading(vectors.high)
    small = matrix @ ((vectors.high - leading) + vectors.low) + rest @ leading
    return np.asarray((leading_matrix @ leading - less) + small)


def _leading(values: Array) -> Array:
    """Values rounded to a grid common to all, 2⁻²⁶ of the largest."""
    largest = float(np.abs(values).max(initial=0.0))
    if not largest:
        return values
    grid = 1.5 * 2.0 ** (np.ceil(np.log2(largest)) + 27)
    return np.asarray((values + grid) - grid)


def inverse_norm(factor: Factor, size: int, solves: int = 3) -> float:
    """‖H⁻¹‖ from below, by inverse iteration from a vector without any symmetry: within a small factor of it."""
    vector = np.mod(0.6180339887498949 * np.arange(1, size + 1), 1.0) - 0.5
    norm = 0.0
    for _ in range(solves):
        vector = factor.solve(vector / np.linalg.norm(vector))
        norm = float(np.linalg.norm(vector))
    return norm
