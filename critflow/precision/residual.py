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

from critflow.linalg.factor import Factor
from critflow.networks.network import Array, Network
from critflow.precision.double_double import Extended, add, multiply, two_product, two_sum

# Corrections that have not settled after so many will not.
_MOST_CORRECTIONS = 10


@dataclass(frozen=True)
class Distance:
    """What leads to the exact equilibrium: displacement D = x* − x (n_free, d), bond vectors L* (N_b, d).

    missing  bound on what D still misses, largest component; infinite where the corrections do not shrink
    last     the last of the corrections that D is the sum of
    """

    displacement: Array
    bond_vectors: Array
    missing: float
    last: Array


def distance(
    network: Network,
    coordinates: Array,
    stress: Callable[[Extended], Array],
    solve: Callable[[Array], Array],
    held: bool = False,
) -> Distance:
    """Correct by solves with H at or near the configuration until less than the rounding of coordinates is missing.

    stress  σ (N_b,) from extended bond vectors
    solve   displacements H⁻¹ f (n_free, d) of forces f (n_free, d)
    held    the solves are not with H alone but hold floppy modes in place: then corrections must shrink to the end,
            since soft modes that they hold as well would make small ones
    """
    rounding = float(np.finfo(float).eps * np.abs(coordinates).max())
    enough, noise = 0.05 * rounding, 0.0 if held else rounding
    D = np.zeros((len(network.free), network.dimension))
    before, missing = np.inf, np.inf
    for _ in range(_MOST_CORRECTIONS):
        L = exact_bond_vectors(network, coordinates, D)
        correction = solve(exact_forces(network, stress(L), L))
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
    return Distance(D, L.high + (L.low + network.free_incidence @ correction), missing, correction)


def exact_bond_vectors(network: Network, coordinates: Array, displacement: Array) -> Extended:
    """L = g (x + D) + b, (N_b, d), with displacements D (n_free, d) too small for the coordinates to hold."""
    x = coordinates
    if network.pins:
        # What a pin adds is in b; of a periodic network only differences count.
        x = coordinates.copy()
        x[list(network.pins)] = 0.0
    tail, head = network.edges.T
    difference, rest = two_sum(x[head], -x[tail])
    high, low = two_sum(difference, network.boundary_vectors)
    return Extended(*two_sum(high, low + rest + network.free_incidence @ displacement))


def square_lengths(vectors: Extended) -> Extended:
    """|v|², (n,), of vectors (n, d)."""
    squares = multiply(vectors, vectors)
    total = Extended(squares.high[:, 0], squares.low[:, 0])
    for axis in range(1, squares.high.shape[1]):
        total = add(total, Extended(squares.high[:, axis], squares.low[:, axis]))
    return total


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
    leading = _leading(vectors.high)
    small = matrix @ ((vectors.high - leading) + vectors.low)
    coarse = _leading(matrix.data)
    if not np.array_equal(coarse, matrix.data):
        small = small + sp.csr_array((matrix.data - coarse, matrix.indices, matrix.indptr), matrix.shape) @ leading
        matrix = sp.csr_array((coarse, matrix.indices, matrix.indptr), matrix.shape)
    return np.asarray((matrix @ leading - less) + small)


def _leading(values: Array) -> Array:
    """Values rounded to a grid common to all, 2⁻²⁶ of the largest."""
    largest = float(np.abs(values).max(initial=0.0))
    if not largest:
        return values
    grid = 1.5 * 2.0 ** (np.ceil(np.log2(largest)) + 27)
    return np.asarray((values + grid) - grid)


def inverse_norm(factor: Factor, vector: Array) -> float:
    """‖H⁻¹‖ from below, within a small factor where the vector is one that H⁻¹ has been applied to already."""
    vector = vector.ravel()
    size = float(np.linalg.norm(vector))
    if not size:
        vector = np.mod(0.6180339887498949 * np.arange(1, len(vector) + 1), 1.0) - 0.5
        size = float(np.linalg.norm(vector))
    return float(np.linalg.norm(factor.solve(vector / size)))
