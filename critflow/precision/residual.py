"""The displacement from a configuration to the exact equilibrium of its springs, x* − x = H⁻¹ f.

Forces of springs are differences of nearly equal lengths, and past the transition the stiffness of soft modes is of the
order of the strain: a small force is not a small error.  Forces f from bond vectors in extended precision keep their
digits; the correction, repeated at x + δ with the same factor, shrinks by a constant, which bounds the remainder.

Sums of forces consist of sparse products here, which serve any matrix; their rounding is 2⁻⁷⁷ of the largest of all
terms, which is enough for the forces of springs.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from critflow.linalg.factor import Factor
from critflow.linalg.tolerances import EPS
from critflow.linalg.vectors import largest, product, quasi_random
from critflow.networks.network import Array, Network
from critflow.precision.double_double import Extended, edge_differences, two_product, two_sum
from critflow.precision.refinement import UNSEEN

MOST_CORRECTIONS = 10  # corrections of an equilibrium after which it counts as not convergent
ROUNDED_FORCE = 8 * EPS  # largest force, relative to the largest tension, that the roundings of σ leave at a vertex
CONTRACTION = 0.5  # each correction must shrink by this factor


@dataclass(frozen=True, eq=False)
class Displacement:
    """Displacement D = x* − x (n_free, d) to the exact equilibrium, and its bond vectors L* (N_b, d).

    remainder  bound on the error of D, largest component; infinite where the corrections do not shrink
    last       the last of the corrections whose sum is D
    """

    displacement: Array
    bond_vectors: Array
    remainder: float
    last: Array


def exact_displacement(
    network: Network,
    coordinates: Array,
    stress: Callable[[Extended], Array],
    solve: Callable[[Array], Array],
    regularised: bool = False,
) -> Displacement:
    """Sum corrections H⁻¹ f until the remainder is below the rounding of the coordinates (N_v, d).

    stress       σ (N_b,) from extended bond vectors
    solve        displacements H⁻¹ f (n_free, d) of forces f (n_free, d), with H at or near the configuration
    regularised  the solves are with H + shift, which resists floppy modes: corrections must then shrink to the end,
                 since soft modes would give small corrections too

    Error bound (estimate): the remainder continues the last observed contraction, of at least a half, as a geometric
    series, and adds the effect of the rounded σ: a rounding of the largest tension, times the largest displacement per
    force that a correction had.
    """
    rounding = EPS * largest(coordinates)
    enough, noise = UNSEEN * rounding, 0.0 if regularised else rounding
    D = np.zeros((len(network.free), network.dimension))
    L, change = exact_bond_vectors(network, coordinates, D), np.zeros_like(D)
    before, remainder, compliance = np.inf, np.inf, 0.0
    for _ in range(MOST_CORRECTIONS):
        # The change is far below L, so its rounding is far below the last digit of L.low.
        L = L if before == np.inf else two_sum(L.high, L.low + change)
        sigma = stress(L)
        forces = exact_forces(network, sigma, L)
        correction = solve(forces)
        change = product(network.free_incidence, correction)
        size, force = largest(correction), largest(forces)
        if size == 0.0:
            remainder = 0.0
            break
        compliance = max(compliance, size / force)
        if not size / before < CONTRACTION:
            # Corrections of the size of rounding do not shrink; those of soft modes are small by the shift alone.
            rounded = force <= ROUNDED_FORCE * largest(sigma * L.high.T)
            remainder = 2 * size if size <= max(noise, enough) and (rounded or not regularised) else np.inf
            break
        D = D + correction
        # A first correction may shrink faster than those after it, so the remainder is never below half of it.
        remainder = 0.5 * size
        if before < np.inf and remainder <= enough:
            break
        before = size
    else:
        remainder = np.inf
    remainder += EPS * compliance * largest(sigma * L.high.T)
    return Displacement(D, L.high + (L.low + change), remainder, correction)


def inverse_norm(factor: Factor, vector: Array) -> float:
    """A lower bound of ‖H⁻¹‖, by one solve; sharp up to a small factor where the vector is a product with H⁻¹."""
    vector = vector.ravel()
    size = float(np.linalg.norm(vector))
    if not size:
        vector = quasi_random(len(vector)) - 0.5
        size = float(np.linalg.norm(vector))
    return float(np.linalg.norm(factor.solve(vector / size)))


def exact_bond_vectors(network: Network, coordinates: Array, displacement: Array) -> Extended:
    """L = g (x + D) + b, (N_b, d), with displacements D (n_free, d) below the rounding of the coordinates (N_v, d)."""
    x, D = coordinates, np.zeros_like(coordinates)
    D[network.free_rows] = displacement
    if network.pins:
        # Pins are part of b; of a periodic network only differences count.
        x = coordinates.copy()
        x[list(network.pins)] = 0.0
    tail, head = np.ascontiguousarray(network.edges.T)
    return edge_differences(tail, head, Extended(x, D), network.boundary_vectors)


def exact_forces(network: Network, sigma: Array, bond_vectors: Extended) -> Array:
    """−gᵀ(σ ∘ L), (n_free, d), with the rounding of σ and of the result alone."""
    # One stress for each component: NumPy is several times slower where it repeats them in every product.
    stress = np.repeat(sigma, bond_vectors.high.shape[1]).reshape(bond_vectors.high.shape)
    pull = two_product(stress, bond_vectors.high)
    leading = leading_half(pull.high)
    # The incidence is of ones, on any grid.
    small = product(network.divergence, (pull.high - leading) + (pull.low + stress * bond_vectors.low))
    return -(product(network.divergence, leading) + small)


def leading_half(values: Array) -> Array:
    """Values rounded to a grid common to all, 2⁻²⁶ of the largest."""
    size = largest(values)
    if not size:
        return values
    grid = 1.5 * 2.0 ** (np.ceil(np.log2(size)) + 27)
    return np.asarray((values + grid) - grid)
