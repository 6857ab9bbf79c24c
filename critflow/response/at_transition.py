"""Elasticity at the transition by the only self-stress, and its errors.

With stresses s of springs, their rates ḣ_a under the strains E_a and their flexibility f,
    V C_ab = (s·ḣ_a)(s·ḣ_b)/D,   D = Σ s² f   (`GenericModulus`),
of edges s = σ, ḣ = L·E_a L, f = |L|²/k.

Errors δL of the bond vectors and the rounding of σ change a modulus by its partial derivatives, to first order, and by
a second order that is bounded in closed form; the rounding of its sums is measured in extended precision.  The errors
are proved for bond vectors whose `bond_errors` are; where those are estimates (stresses of both signs) so are they.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from critflow.critical.manifold import CriticalConfiguration
from critflow.critical.transition import TransitionModulus, dilation, pure_shear
from critflow.linalg.tolerances import EPS
from critflow.linalg.vectors import dot
from critflow.networks.deformation import strain_basis
from critflow.networks.network import Array
from critflow.precision.double_double import Extended, add, divide, extended, multiply, total, two_product
from critflow.response.tensor import Elasticity, Errors


def elasticity_at_transition(critical: CriticalConfiguration, volume: float, roundings: int = 1) -> Elasticity:
    """Of a critical configuration with one self-stress and no slack edge.

    roundings  how often σ was scaled
    """
    L = critical.bond_vectors
    flexibility = dot(L, L) / critical.network.stiffness
    error = partial(transition_modulus_error, critical=critical, volume=volume, roundings=roundings)
    shear = partial(error, pure_shear(L.shape[1])) if L.shape[1] > 1 else np.nan
    errors = Errors(
        partial(_tensor_errors, error, critical, volume), partial(error, dilation(L.shape[1])), shear, shear
    )
    return tensor_of_self_stress(critical.sigma, strain_rates(L), flexibility, L.shape[1], volume, errors)


def strain_rates(L: Array) -> Array:
    """ḣ = L·A L of the dilation and of all strains of `strain_basis`, (1 + m, N_b)."""
    d = L.shape[1]
    return np.array([dot(L, L @ A) for A in (dilation(d), *strain_basis(d)[1])])


def tensor_of_self_stress(
    stress: Array, rates: Array, flexibility: Array, dimension: int, volume: float, errors: Errors | None = None
) -> Elasticity:
    """C_ab by the stresses s (n,), flexibilities f (n,), and rates ḣ (1 + m, n) of the dilation and of all strains."""
    works = np.array([stress @ rate for rate in rates])
    tensor = np.outer(works, works / (stress**2 @ flexibility)) / volume
    affine, nothing = (rates[1:] / flexibility) @ rates[1:].T / volume, np.zeros((dimension, dimension))
    return Elasticity(tensor[1:, 1:], affine, nothing, volume, errors, float(tensor[0, 0]))  # type: ignore[arg-type]


def _tensor_errors(error: Callable[[Array], float], critical: CriticalConfiguration, volume: float) -> Array:
    basis = strain_basis(critical.network.dimension)[1]
    single = np.array([error(strain) for strain in basis])
    errors = np.diag(single)
    # Products of two components are half the differences of squares of their sums.
    for a, b in zip(*np.tril_indices(len(basis), -1), strict=True):
        errors[a, b] = errors[b, a] = 0.5 * (error(basis[a] + basis[b]) + single[a] + single[b])
    return errors + 8 * EPS * np.abs(elasticity_at_transition(critical, volume).tensor)


def transition_modulus_error(
    A: Array, critical: CriticalConfiguration, volume: float | None = None, roundings: int = 1
) -> float:
    """Error of one modulus μ_A = w²/(Vc), w = Σσḣ, c = Σσ²|L|²/k, at a configuration, for a symmetric strain A.

    roundings  how often σ was scaled
    """
    sigma, L, dL = critical.sigma, critical.bond_vectors, critical.bond_errors
    k, V = critical.network.stiffness, critical.network.volume if volume is None else volume
    size, AL = np.abs(sigma), L @ A
    length, stretch = critical.lengths, np.linalg.norm(AL, axis=1)
    hdot = np.abs(dot(L, AL))
    work, cost = sigma @ dot(L, AL), sigma**2 @ (length**2 / k)
    ratio = float(work / cost)

    value, (dO_dsigma, dO_dL) = TransitionModulus(A).evaluate(critical)
    scale = critical.network.volume / V
    value, dO_dsigma, dO_dL = value * scale, dO_dsigma * scale, dO_dL * scale
    # σ is rounded from the stress that was solved for.
    first = np.linalg.norm(dO_dL, axis=1) @ dL + 0.5 * roundings * EPS * (np.abs(dO_dsigma) @ size)
    # f = w²/c changes by its first order and, exactly, (δw − f_w δc/2)²/(c + δc) more; w and c are quadratic in L.
    second_work = float(np.linalg.norm(A, 2) * (size @ dL**2))
    second_cost = float((sigma**2 / k) @ dL**2)
    dwork = 2 * (size * stretch) @ dL + 0.5 * EPS * (size @ hdot) + second_work
    dcost = 2 * (sigma**2 * length / k) @ dL + EPS * cost + second_cost
    if dcost >= cost:
        return np.inf
    curved = 2 * abs(ratio) * second_work + ratio**2 * second_cost + (dwork + abs(ratio) * dcost) ** 2 / (cost - dcost)
    return float(first + curved / V + _sum_rounding(A, critical, V, value) + _input_rounding(critical, value))


def _sum_rounding(A: Array, critical: CriticalConfiguration, volume: float, value: float) -> float:
    """|μ − w²/(Vc)| with w and c of the same σ and L in extended precision."""
    sigma, L, k = critical.sigma, critical.bond_vectors, critical.network.stiffness
    stress, components = extended(sigma), [np.ascontiguousarray(axis) for axis in L.T]
    hdot, square = (Extended(np.zeros_like(sigma), np.zeros_like(sigma)) for _ in range(2))
    for i, j in np.ndindex(A.shape):
        product = two_product(components[i], components[j])
        if A[i, j]:
            hdot = add(hdot, multiply(extended(np.full_like(sigma, A[i, j])), product))
        if i == j:
            square = add(square, product)
    tension = multiply(multiply(stress, stress), square)
    work = total(multiply(stress, hdot))
    cost = total(divide(tension, extended(k)))
    exact = divide(multiply(work, work), multiply(cost, extended(np.array([volume]))))
    return float(abs((value - exact.high[0]) - exact.low[0]))


def _input_rounding(critical: CriticalConfiguration, value: float) -> float:
    """Error of a modulus by the rounding of the volume, a determinant, and of the strain, 1/d."""
    cell = critical.network.cell
    if cell is None:
        return 2 * EPS * abs(value)
    skew = float(np.prod(np.linalg.norm(cell, axis=1))) / critical.network.volume
    return EPS * abs(value) * (2 + 2 * len(cell) * skew)
