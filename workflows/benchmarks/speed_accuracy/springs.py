"""References for springs: equilibria, moduli and their slopes in extended precision, for contests in the plane.

Strains of volume leave the cell as it is and shrink the springs instead: at strain γ lengths in units of √(1 + γ) obey
the same equations with rest lengths ℓ/√(1 + γ), and the moduli of springs in the plane have no length in their unit.
So the boundary is the same doubles for every strain, and all else is known to 31 digits.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from critflow import CriticalConfiguration, CriticalManifold, Network
from critflow.linalg.matrices import Factor, FixedPattern, edge_blocks, laplacian
from critflow.networks.network import Array
from critflow.precision.double_double import (
    Extended,
    ExtendedGeometry,
    add,
    divide,
    extended,
    lengths,
    multiply,
    square_root,
    subtract,
)

# Corrections are below this part of the largest coordinate when refinement has ended, and it may take this many.
_REFINED, _MOST = 1e-28, 30


@dataclass(frozen=True, eq=False)
class ExtendedState:
    """Springs in equilibrium: free coordinates x (n_free, 2), bond vectors L (N_b, 2), |L| and σ (N_b,)."""

    network: Network
    x: Extended
    bond_vectors: Extended
    lengths: Extended
    sigma: Extended


@dataclass(frozen=True)
class ExtendedModuli:
    """B and G (energy convention) as high + low, by linear response."""

    bulk: Extended
    shear: Extended


def total(values: Extended) -> Extended:
    """Σ values (n,), in pairs; shape () as numbers of shape (1,)."""
    while len(values.high) > 1:
        half = len(values.high) // 2
        odd = _part(values, slice(2 * half, None))
        values = add(_part(values, slice(half)), _part(values, slice(half, 2 * half)))
        values = Extended(np.append(values.high, odd.high), np.append(values.low, odd.low))
    return values


def dot(a: Extended, b: Extended) -> Extended:
    """a·b for each row, (n,), of (n, 2)."""
    product = multiply(a, b)
    return add(_part(product, (..., 0)), _part(product, (..., 1)))


def scaled(factors: Extended, vectors: Extended) -> Extended:
    """Each row of vectors (n, 2) times its factor (n,)."""
    return multiply(Extended(factors.high[:, None], factors.low[:, None]), vectors)


def times(values: Extended, power_of_two: float) -> Extended:
    """Values times ±2ⁿ, exactly."""
    return Extended(power_of_two * values.high, power_of_two * values.low)


def _part(values: Extended, index: object) -> Extended:
    return Extended(values.high[index], values.low[index])  # type: ignore[index]


def rest_lengths_at(rest_lengths: Extended, strain: float) -> Extended:
    """ℓ/√(1 + γ): what rest lengths ℓ are, in units in which the cell stays as it is."""
    return divide(rest_lengths, square_root(add(extended(np.ones(1)), extended(np.full(1, strain)))))


def extended_critical(configuration: CriticalConfiguration) -> tuple[Extended, Extended]:
    """Free coordinates and bond vectors of the configuration whose stress is that of another, the same doubles."""
    network, sigma = configuration.network, extended(configuration.sigma)
    geometry, factor = ExtendedGeometry(network), laplacian(network).factorize(configuration.sigma)
    x = extended(configuration.coordinates[network.free])
    for _ in range(_MOST):
        L = geometry.bond_vectors(x, network.boundary_vectors)
        correction = -factor.solve(geometry.divergence(scaled(sigma, L)).high)
        x = add(x, extended(correction))
        if np.abs(correction).max() < _REFINED * np.abs(x.high).max():
            return x, geometry.bond_vectors(x, network.boundary_vectors)
    raise ArithmeticError("the refinement of the configuration did not end")


def extended_equilibrium(
    network: Network, rest_lengths: Extended, start: Array, pattern: FixedPattern
) -> tuple[ExtendedState, Factor]:
    """Hookean springs relaxed from free coordinates near the equilibrium, and the Hessian's factor.

    Newton with forces in extended precision and factors in working precision; the last factor serves until the
    corrections end, each about 1e-13 of the one before.
    """
    geometry, k = ExtendedGeometry(network), extended(network.stiffness)
    x, factor, last = extended(start), None, np.inf
    for _ in range(_MOST):
        state = _state(network, geometry, k, rest_lengths, x)
        if factor is None or last > 1e-8:
            L, length, sigma = state.bond_vectors.high, state.lengths.high, state.sigma.high
            blocks = edge_blocks((network.stiffness - sigma) / length**2, L, sigma)
            factor = pattern.factorize(blocks)
        force = geometry.divergence(scaled(state.sigma, state.bond_vectors)).high
        correction = -factor.solve(force.ravel()).reshape(force.shape)
        x, last = add(x, extended(correction)), float(np.abs(correction).max())
        if last < _REFINED * np.abs(x.high).max():
            return _state(network, geometry, k, rest_lengths, x), factor
    raise ArithmeticError("the refinement of the equilibrium did not end")


def _state(
    network: Network, geometry: ExtendedGeometry, k: Extended, rest_lengths: Extended, x: Extended
) -> ExtendedState:
    L = geometry.bond_vectors(x, network.boundary_vectors)
    length = lengths(L)
    sigma = multiply(k, divide(subtract(length, rest_lengths), length))
    return ExtendedState(network, x, L, length, sigma)


def extended_moduli(state: ExtendedState, factor: Factor) -> ExtendedModuli:
    """B and G: the least of Σ K ḣ² + σ(|L̇|² + L·b̈) over the displacements, ḣ = L·L̇ and L̇ = A L + g u.

    Near its least it is flat, so u may carry the square root of the error of the moduli; two refinements leave less.
    """
    network, L, sigma = state.network, state.bond_vectors, state.sigma
    geometry, V = ExtendedGeometry(network), extended(np.full(1, network.volume))
    stiffness = divide(subtract(extended(network.stiffness), sigma), multiply(state.lengths, state.lengths))
    # b̈ = −¼ b of dilation takes away what |A L|² = ¼|L|² adds; a shear has none.
    bending = times(total(multiply(sigma, dot(L, L))), -0.25)
    values = []
    for affine, of_boundary in (
        (times(L, 0.5), bending),
        (times(Extended(L.high[:, ::-1], L.low[:, ::-1]), 0.5), extended(np.zeros(1))),
    ):
        u = extended(np.zeros_like(state.x.high))
        for _ in range(3):
            rate = add(affine, geometry.bond_vectors(u, np.zeros_like(L.high)))
            hdot = dot(L, rate)
            force = geometry.divergence(add(scaled(multiply(stiffness, hdot), L), scaled(sigma, rate))).high
            u = add(u, extended(-factor.solve(force.ravel()).reshape(force.shape)))
        rate = add(affine, geometry.bond_vectors(u, np.zeros_like(L.high)))
        hdot = dot(L, rate)
        work = total(add(multiply(stiffness, multiply(hdot, hdot)), multiply(sigma, dot(rate, rate))))
        values.append(divide(add(work, of_boundary), V))
    return ExtendedModuli(*values)


def extended_transition_moduli(configuration: CriticalConfiguration) -> ExtendedModuli:
    """B_0 and G_0, (Σσḣ)²/(V Σσ²|L|²/k), of the configuration of a stress."""
    network, sigma = configuration.network, extended(configuration.sigma)
    L = extended_critical(configuration)[1]
    square = dot(L, L)
    cost = total(divide(multiply(multiply(sigma, sigma), square), extended(network.stiffness)))
    values = []
    for hdot in (times(square, 0.5), multiply(_part(L, (..., 0)), _part(L, (..., 1)))):
        work = total(multiply(sigma, hdot))
        values.append(divide(multiply(work, work), multiply(cost, extended(np.full(1, network.volume)))))
    return ExtendedModuli(*values)


def extended_slopes(
    configuration: CriticalConfiguration, manifold: CriticalManifold, reach: float = 4e-3, n_strains: int = 12
) -> tuple[Extended, Extended]:
    """C_B and C_G as the slopes at γ = 0 of the polynomial through B and G at 0 and at strains up to `reach`.

    The strains are Chebyshev points, so that the polynomial's error falls as (reach/ρ)ⁿ with the strain ρ of the
    nearest singularity; what is rounded at 1e-28 the slope magnifies by n²/reach.
    """
    network = configuration.network
    x, L = extended_critical(configuration)
    rest, start = lengths(L), x.high
    at = extended_transition_moduli(configuration)
    gamma = 0.5 * reach * (1 - np.cos(np.pi * (np.arange(n_strains) + 0.5) / n_strains))
    gamma = np.concatenate([[0.0], gamma])
    bulk, shear = [at.bulk], [at.shear]
    for strain in gamma[1:]:
        state, factor = extended_equilibrium(network, rest_lengths_at(rest, strain), start, manifold.hessian)
        moduli = extended_moduli(state, factor)
        bulk.append(moduli.bulk)
        shear.append(moduli.shear)
        start = state.x.high
    return slope_at_start(gamma, bulk), slope_at_start(gamma, shear)


def slope_at_start(points: Array, values: list[Extended]) -> Extended:
    """p'(t_0) of the polynomial p through values at points t, by Newton's divided differences."""
    nodes = [extended(np.full(1, t)) for t in points]
    table, slope = list(values), extended(np.zeros(1))
    # p'(t_0) = Σ_n [t_0 … t_n] Π_{0<m<n} (t_0 − t_m)
    product = extended(np.ones(1))
    for n in range(1, len(points)):
        table = [
            divide(subtract(table[m + 1], table[m]), subtract(nodes[m + n], nodes[m])) for m in range(len(table) - 1)
        ]
        slope = add(slope, multiply(table[0], product))
        product = multiply(product, subtract(nodes[0], nodes[n]))
    return slope


def apart(value: float, reference: Extended) -> float:
    """|value − reference| over the size of the reference."""
    return float(abs((value - reference.high[0]) - reference.low[0]) / abs(reference.high[0]))
