"""References for networks of any size in the plane: double-double arithmetic with sparse factors in working precision.

Each correction of a solution gains about 13 digits; 30 are correct in configurations, 25 in stresses from lengths.
Dense mpmath (`benchmarks/reference.py`) takes minutes from some hundred vertices; the tests compare the two on small
networks.

Strains of volume leave the cell unchanged and shorten the springs instead: at strain γ lengths in units of √(1 + γ)
obey the same equations with rest lengths ℓ/√(1 + γ), and moduli of springs in the plane have no unit of length.  So the
boundary is the same doubles at every strain.
"""

from dataclasses import dataclass

import numpy as np

from critflow import CriticalManifold, Network, critical_from_lengths
from critflow.linalg.factor import Factor, FixedPattern
from critflow.linalg.matrices import edge_blocks
from critflow.networks.network import Array
from critflow.precision.double_double import (
    Extended,
    add,
    divide,
    dot,
    extended,
    lengths,
    multiply,
    part,
    scaled,
    square_root,
    subtract,
    total,
)
from critflow.precision.geometry import ExtendedGeometry

# Relative correction at which an iteration ends, and its most steps.
_REFINED, _MOST = 1e-28, 30
# Corrections of the stress of rest lengths, and of responses.
_LENGTH_STEPS, _RESPONSE_STEPS = 4, 3


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


def configuration(manifold: CriticalManifold, sigma: Array) -> tuple[Extended, Extended, Factor]:
    """Free coordinates (n_free, 2) and bond vectors (N_b, 2) of a stress, and the factor of P."""
    network, geometry = manifold.network, ExtendedGeometry(manifold.network)
    factor, stress = manifold.prestress.factorize(sigma), extended(sigma)
    x = extended(np.zeros((len(network.free), network.dimension)))
    for _ in range(_MOST):
        L = geometry.bond_vectors(x, network.boundary_vectors)
        correction = -factor.solve(geometry.divergence(scaled(stress, L)).high)
        x = add(x, extended(correction))
        if np.abs(correction).max() < _REFINED * np.abs(x.high).max():
            return x, geometry.bond_vectors(x, network.boundary_vectors), factor
    raise ArithmeticError("the refinement of the configuration does not converge")


def bulk_modulus_gradient(manifold: CriticalManifold, sigma: Array) -> tuple[Extended, Extended]:
    """Bond vectors L (N_b, 2) and dB_0/dσ (N_b,) for k = 1.

    With q = Σσ|L|²/Σσ²|L|²: ∂B_0/∂σ = (q/2V)(1 − qσ)|L|² and ∂B_0/∂L = (q/2V)(2 − qσ)σL.
    """
    _, L, factor = configuration(manifold, sigma)
    network, geometry, stress = manifold.network, ExtendedGeometry(manifold.network), extended(sigma)
    square = dot(L, L)
    work = multiply(stress, square)
    q = divide(total(work), total(multiply(stress, work)))
    scale, share = divide(q, constant(2 * network.volume)), multiply(q, stress)
    by_sigma = multiply(multiply(scale, subtract(constant(1.0), share)), square)
    by_L = scaled(multiply(multiply(scale, subtract(constant(2.0), share)), stress), L)
    # y = P⁻¹ gᵀ ∂B_0/∂L
    load, none = geometry.divergence(by_L), np.zeros_like(network.boundary_vectors)
    y = extended(np.zeros((len(network.free), 2)))
    for _ in range(_RESPONSE_STEPS + 2):
        residual = subtract(load, geometry.divergence(scaled(stress, geometry.bond_vectors(y, none))))
        y = add(y, extended(factor.solve(residual.high)))
    return L, subtract(by_sigma, dot(L, geometry.bond_vectors(y, none)))


def stress_of_lengths(manifold: CriticalManifold, rest_lengths: Array) -> Extended | None:
    """σ (N_b,) with Σσ² = N_b of the critical configuration with lengths ∝ ℓ, or None with slack edges.

    Newton's method on gᵀ(σ ∘ L) = 0 and |L|² = t ℓ², with these residuals in double-double arithmetic.
    """
    solution = critical_from_lengths(manifold, rest_lengths, throw=False)
    if not solution.ok:
        return None
    network, geometry = manifold.network, ExtendedGeometry(manifold.network)
    x, sigma = extended(solution.value.coordinates[network.free]), extended(solution.value.sigma)
    target = multiply(extended(rest_lengths), extended(0.5 * rest_lengths))
    for _ in range(_LENGTH_STEPS):
        L = geometry.bond_vectors(x, network.boundary_vectors)
        h = times(dot(L, L), 0.5)
        ratio = divide(total(multiply(sigma, h)), total(multiply(sigma, target)))
        force = geometry.divergence(scaled(sigma, L))
        short = subtract(multiply(ratio, target), h)
        u, change, _ = manifold.saddle.factorize(sigma.high, L.high).solve(-force.high, short.high)
        x = add(x, extended(u))
        sigma = add(sigma, extended(change - (change @ sigma.high) / (sigma.high @ sigma.high) * sigma.high))
    return multiply(sigma, constant(np.sqrt(len(rest_lengths) / (sigma.high @ sigma.high))))


def transition_moduli(manifold: CriticalManifold, sigma: Array) -> list[Extended]:
    """B_0 and G_0, (Σσḣ)²/(V Σσ²|L|²/k), of the configuration of a stress."""
    network, stress = manifold.network, extended(sigma)
    L = configuration(manifold, sigma)[1]
    square = dot(L, L)
    cost = total(divide(multiply(multiply(stress, stress), square), extended(network.stiffness)))
    values = []
    for hdot in (times(square, 0.5), multiply(part(L, (..., 0)), part(L, (..., 1)))):
        work = total(multiply(stress, hdot))
        values.append(divide(multiply(work, work), multiply(cost, constant(network.volume))))
    return values


# Past the transition


def strained_rest_lengths(rest_lengths: Extended, strain: float) -> Extended:
    """ℓ/√(1 + γ): rest lengths in units in which the cell is unchanged."""
    return divide(rest_lengths, square_root(add(constant(1.0), constant(strain))))


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


def stiffening(manifold: CriticalManifold, sigma: Array, reach: float = 4e-3, n_strains: int = 12) -> list[Extended]:
    """C_B and C_G: derivatives at γ = 0 of the polynomial through B and G at 0 and at strains up to `reach`.

    At Chebyshev points the polynomial's error falls as (reach/ρ)ⁿ with the strain ρ of the nearest singularity; the
    derivative magnifies rounding of 1e-28 by n²/reach.  No formula of the library's coefficients enters.
    """
    x, L, _ = configuration(manifold, sigma)
    rest, start = lengths(L), x.high
    gamma = 0.5 * reach * (1 - np.cos(np.pi * (np.arange(n_strains) + 0.5) / n_strains))
    table = [transition_moduli(manifold, sigma)]
    for strain in gamma:
        springs, factor = equilibrium(manifold.network, strained_rest_lengths(rest, strain), start, manifold.hessian)
        table.append(moduli(springs, factor))
        start = springs.x.high
    points = np.concatenate([[0.0], gamma])
    return [initial_derivative(points, list(values)) for values in zip(*table, strict=True)]


def initial_derivative(points: Array, values: list[Extended]) -> Extended:
    """p'(t_0) of the polynomial p through values at points t: Σ_n [t_0 … t_n] Π_{0<m<n} (t_0 − t_m)."""
    nodes = [constant(t) for t in points]
    table, derivative, product = list(values), constant(0.0), constant(1.0)
    for n in range(1, len(points)):
        table = [
            divide(subtract(table[m + 1], table[m]), subtract(nodes[m + n], nodes[m])) for m in range(len(table) - 1)
        ]
        derivative = add(derivative, multiply(table[0], product))
        product = multiply(product, subtract(nodes[0], nodes[n]))
    return derivative
