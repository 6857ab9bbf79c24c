"""Elasticity at the transition by the only self-stress, and its errors.

With stresses s of springs, their rates ḣ_a under the strains E_a and their flexibility f,
    V C_ab = (s·ḣ_a)(s·ḣ_b)/D,   D = Σ s² f   (`GenericModulus`),
of edges s = σ, ḣ = L·E_a L, f = |L|²/k.

Errors are those of `critflow.critical.modulus_error`.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from critflow.critical.manifold import CriticalConfiguration
from critflow.critical.modulus_error import transition_modulus_error
from critflow.critical.transition import dilation, pure_shear
from critflow.linalg.tolerances import EPS
from critflow.linalg.vectors import dot
from critflow.networks.deformation import strain_basis
from critflow.networks.network import Array
from critflow.response.tensor import Elasticity, Errors, LateErrors


def elasticity_at_transition(critical: CriticalConfiguration, volume: float, roundings: int = 1) -> Elasticity:
    """Of a critical configuration with one self-stress and no slack edge.

    roundings  how often σ was scaled
    """
    L = critical.bond_vectors
    flexibility = dot(L, L) / critical.network.stiffness
    error = partial(transition_modulus_error, critical=critical, volume=volume, roundings=roundings)
    shear = partial(error, pure_shear(L.shape[1])) if L.shape[1] > 1 else partial(float, np.nan)
    errors = LateErrors(
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
