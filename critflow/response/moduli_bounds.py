"""Error bounds of the moduli at the transition, from those of the configuration and of the arithmetic.

Errors δL of the bond vectors and the rounding of σ change a modulus by its partial derivatives, to first order, and by
a second order that is bounded in closed form; the rounding of its sums is measured in extended precision.

Error bound (proof): both functions here, given bond vectors whose `bond_errors` are proven bounds; where those are
estimates (stresses of both signs) the result is an estimate.
"""

from __future__ import annotations

import numpy as np

from critflow.arguments import checked
from critflow.critical.backbone import taut_configurations
from critflow.critical.manifold import CriticalConfiguration
from critflow.critical.transition import TransitionModulus, dilation, pure_shear, transition_modulus
from critflow.linalg.tolerances import EPS
from critflow.networks.network import Array
from critflow.precision.double_double import Extended, add, divide, extended, multiply, total, two_product
from critflow.response.elasticity import Moduli


@checked
def transition_bounds(critical: CriticalConfiguration) -> Moduli:
    """Error bounds of `transition_moduli`, against the exact moduli of the stress of the configuration.

    NaN where the configuration has no bounds, and infinite where the bounds exceed the lengths.

    >>> import critflow as cf
    >>> cf.transition_bounds(cf.optimize(cf.honeycomb_network(2, 2), 'bulk_modulus')).bulk < 1e-14
    True
    """
    d, parts = critical.network.dimension, taut_configurations(critical)
    # The stress of a taut part was scaled with the whole and for itself.
    roundings = 1 if parts[0] is critical else 2
    bulk, shear = (
        sum(transition_modulus_bound(transition_modulus(part.network, A), part, roundings) for part in parts)
        for A in (dilation(d), pure_shear(d))
    )
    return Moduli(bulk, shear, shear)


def transition_modulus_bound(goal: TransitionModulus, critical: CriticalConfiguration, roundings: int = 1) -> float:
    """Error bound of one modulus μ_A = w²/(Vc), w = Σσḣ, c = Σσ²|L|²/k, at a configuration.

    roundings  how often σ was scaled
    """
    sigma, L, dL = critical.sigma, critical.bond_vectors, critical.bond_errors
    size, AL = np.abs(sigma), L @ goal.symmetric
    length, stretch = critical.lengths, np.linalg.norm(AL, axis=1)
    hdot = np.abs(np.einsum("ad,ad->a", L, AL))
    work, cost = sigma @ np.einsum("ad,ad->a", L, AL), sigma**2 @ (length**2 / critical.network.stiffness)
    ratio = float(work / cost)

    value, (dO_dsigma, dO_dL) = goal.evaluate(critical)
    # σ is rounded from the stress that was solved for.
    first = np.linalg.norm(dO_dL, axis=1) @ dL + 0.5 * roundings * EPS * (np.abs(dO_dsigma) @ size)
    # f = w²/c changes by its first order and, exactly, (δw − f_w δc/2)²/(c + δc) more; w and c are quadratic in L.
    second_work = float(np.linalg.norm(goal.symmetric, 2) * (size @ dL**2))
    second_cost = float((sigma**2 / critical.network.stiffness) @ dL**2)
    dwork = 2 * (size * stretch) @ dL + 0.5 * EPS * (size @ hdot) + second_work
    dcost = 2 * (sigma**2 * length / critical.network.stiffness) @ dL + EPS * cost + second_cost
    if dcost >= cost:
        return np.inf
    curved = 2 * abs(ratio) * second_work + ratio**2 * second_cost + (dwork + abs(ratio) * dcost) ** 2 / (cost - dcost)
    return float(
        first
        + curved / critical.network.volume
        + _sum_rounding(critical, goal.symmetric, value)
        + _input_rounding(critical, value)
    )


def _sum_rounding(critical: CriticalConfiguration, A: Array, value: float) -> float:
    """|μ − w²/(Vc)| with w and c of the same σ and L in extended precision."""
    sigma, L, network = critical.sigma, critical.bond_vectors, critical.network
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
    cost = total(divide(tension, extended(network.stiffness)))
    exact = divide(multiply(work, work), multiply(cost, extended(np.array([network.volume]))))
    return float(abs((value - exact.high[0]) - exact.low[0]))


def _input_rounding(critical: CriticalConfiguration, value: float) -> float:
    """Error of a modulus by the rounding of the volume, a determinant, and of the strain, 1/d."""
    cell = critical.network.cell
    if cell is None:
        return 2 * EPS * abs(value)
    skew = float(np.prod(np.linalg.norm(cell, axis=1))) / critical.network.volume
    return EPS * abs(value) * (2 + 2 * len(cell) * skew)
