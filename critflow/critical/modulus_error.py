"""Error of a modulus at the transition: of its bond vectors, of the rounding of σ, and of its sums.

Errors δL of the bond vectors and the rounding of σ change a modulus by its partial derivatives, to first order, and by
a second order that is bounded in closed form; the rounding of its sums is measured in extended precision.  The errors
are proved for bond vectors whose `bond_errors` are; where those are estimates (stresses of both signs) so are they.
"""

from __future__ import annotations

import numpy as np

from critflow.critical.manifold import CriticalConfiguration
from critflow.critical.transition import TransitionModulus
from critflow.linalg.tolerances import EPS
from critflow.linalg.vectors import dot
from critflow.networks.network import Array
from critflow.precision.double_double import Extended, add, divide, extended, multiply, total, two_product


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
    change = dwork + abs(ratio) * dcost
    curved = 2 * abs(ratio) * second_work + ratio * ratio * second_cost + change * change / (cost - dcost)
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
