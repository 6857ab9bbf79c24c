"""References for networks of any size in the plane: double-double arithmetic with sparse factors in working precision.

Each correction of a solution gains about 13 digits; 30 are correct in configurations.
Dense mpmath (`benchmarks/reference.py`) takes minutes from some hundred vertices; the tests compare the two on small
networks.

Strains of volume leave the cell unchanged and shorten the springs instead: at strain γ lengths in units of √(1 + γ)
obey the same equations with rest lengths ℓ/√(1 + γ), and moduli of springs in the plane have no unit of length.  So the
boundary is the same doubles at every strain.
"""

from dataclasses import dataclass

import numpy as np

from critflow import CriticalManifold, Network
from critflow.double_double import (
    Extended,
    add,
    divide,
    dot,
    extended,
    lengths,
    multiply,
    scaled,
    subtract,
    total,
)
from critflow.networks import Array
from critflow.refinement import ExtendedGeometry
from critflow.sparse import Factor, FixedPattern, edge_blocks

# Relative correction at which an iteration ends, and its most steps.
_REFINED, _MOST = 1e-28, 30
# Corrections of responses.
_RESPONSE_STEPS = 3


@dataclass(frozen=True, eq=False)
class Springs:
    """Springs in equilibrium: free coordinates x (n_free, 2), bond vectors L (N_b, 2), |L| and σ (N_b,)."""

    network: Network
    x: Extended
    bond_vectors: Extended
    lengths: Extended
    sigma: Extended


# Arithmetic


def times(values: Extended, power_of_two: float) -> Extended:
    """Values times ±2ⁿ, without rounding."""
    return Extended(power_of_two * values.high, power_of_two * values.low)


def constant(value: float) -> Extended:
    """A double as an array (1,)."""
    return extended(np.full(1, value))


def relative_error(value: float, reference: Extended) -> float:
    """|value − reference|/|reference|."""
    return float(abs((value - reference.high[0]) - reference.low[0]) / abs(reference.high[0]))


# At the transition


def configuration(manifold: CriticalManifold, sigma: Array) -> tuple[Extended, Extended]:
    """Free coordinates (n_free, 2) and bond vectors (N_b, 2) of a stress."""
    network, geometry = manifold.network, ExtendedGeometry(manifold.network)
    factor, stress = manifold.prestress.factorize(sigma), extended(sigma)
    x = extended(np.zeros((len(network.free), network.dimension)))
    for _ in range(_MOST):
        L = geometry.bond_vectors(x, network.boundary_vectors)
        correction = -factor.solve(geometry.divergence(scaled(stress, L)).high)
        x = add(x, extended(correction))
        if np.abs(correction).max() < _REFINED * np.abs(x.high).max():
            return x, geometry.bond_vectors(x, network.boundary_vectors)
    raise ArithmeticError("the refinement of the configuration does not converge")


# Past the transition


def equilibrium(
    network: Network, rest_lengths: Extended, start: Array, pattern: FixedPattern
) -> tuple[Springs, Factor]:
    """Hookean springs in equilibrium, from free coordinates near it, and the factor of the Hessian.

    Newton's method with forces in double-double arithmetic and factors in working precision; the last factor serves
    until the corrections end, each about 1e-13 of the one before.
    """
    geometry, k = ExtendedGeometry(network), extended(network.stiffness)
    x, factor, last = extended(start), None, np.inf
    for _ in range(_MOST):
        springs = _springs(network, geometry, k, rest_lengths, x)
        if factor is None or last > 1e-8:
            L, length, sigma = springs.bond_vectors.high, springs.lengths.high, springs.sigma.high
            factor = pattern.factorize(edge_blocks((network.stiffness - sigma) / length**2, L, sigma))
        force = geometry.divergence(scaled(springs.sigma, springs.bond_vectors)).high
        correction = -factor.solve(force.ravel()).reshape(force.shape)
        x, last = add(x, extended(correction)), float(np.abs(correction).max())
        if last < _REFINED * np.abs(x.high).max():
            return _springs(network, geometry, k, rest_lengths, x), factor
    raise ArithmeticError("the refinement of the equilibrium does not converge")


def _springs(network: Network, geometry: ExtendedGeometry, k: Extended, rest_lengths: Extended, x: Extended) -> Springs:
    L = geometry.bond_vectors(x, network.boundary_vectors)
    length = lengths(L)
    return Springs(network, x, L, length, multiply(k, divide(subtract(length, rest_lengths), length)))


def moduli(springs: Springs, factor: Factor) -> list[Extended]:
    """B and G (energy convention): the minimum of Σ Kḣ² + σ(|L̇|² + L·b̈) over u, with ḣ = L·L̇ and L̇ = A L + g u.

    An error of u changes the minimum to second order, so that few corrections of u suffice.
    """
    network, L, sigma = springs.network, springs.bond_vectors, springs.sigma
    geometry, V, none = ExtendedGeometry(network), constant(network.volume), np.zeros_like(L.high)
    stiffness = divide(subtract(extended(network.stiffness), sigma), multiply(springs.lengths, springs.lengths))
    # b̈ maps L to −¼L for a dilation, and to 0 for a shear.
    boundary = times(total(multiply(sigma, dot(L, L))), -0.25), constant(0.0)
    strained = times(L, 0.5), times(Extended(L.high[:, ::-1], L.low[:, ::-1]), 0.5)
    values = []
    for affine, of_boundary in zip(strained, boundary, strict=True):
        u = extended(np.zeros_like(springs.x.high))
        for _ in range(_RESPONSE_STEPS):
            rate = add(affine, geometry.bond_vectors(u, none))
            tension = add(scaled(multiply(stiffness, dot(L, rate)), L), scaled(sigma, rate))
            force = geometry.divergence(tension).high
            u = add(u, extended(-factor.solve(force.ravel()).reshape(force.shape)))
        rate = add(affine, geometry.bond_vectors(u, none))
        hdot = dot(L, rate)
        work = total(add(multiply(stiffness, multiply(hdot, hdot)), multiply(sigma, dot(rate, rate))))
        values.append(divide(add(work, of_boundary), V))
    return values
