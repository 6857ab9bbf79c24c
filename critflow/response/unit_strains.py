"""Strains whose responses give all moduli: dilation, deviators and shears, and their relation to `strain_basis`.

Each has a separate relaxation, so that the bulk modulus is not a difference of larger numbers.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from critflow.networks.deformation import strain_basis
from critflow.networks.network import Array
from critflow.response.tensor import strain_components


@cache
def unit_strains(dimension: int) -> Array:
    """Strains (m, d, d): dilation 1/d, deviators e_i e_iᵀ − 1/d of all axes but the last, shears in Voigt's order."""
    basis, unit = strain_basis(dimension)[1], np.eye(dimension) / dimension
    return np.concatenate([unit[None], basis[: dimension - 1] - unit, basis[dimension:]])


@cache
def basis_change(dimension: int) -> Array:
    """T (m, m): the strain a of `strain_basis` is Σ_n T_na `unit_strains`_n."""
    d = dimension
    T = np.eye(d * (d + 1) // 2)
    normal = np.zeros((d, d))
    normal[0] = 1.0
    normal[1:, :-1] = np.eye(d - 1)
    normal[1:, -1] = -1.0
    T[:d, :d] = normal
    return T


def strains_of(rates: Array) -> tuple[int, ...]:
    """Rows of `unit_strains` for the moduli, dilation and the last shear, and for rates A (n, d, d) of a cell."""
    d = rates.shape[1]
    parts = np.array([basis_change(d) @ strain_components(0.5 * (A + A.T)) for A in rates])
    last = parts.shape[1] - 1
    return tuple(n for n in range(last + 1) if n in (0, last) or parts[:, n].any())


@cache
def stress_products(dimension: int) -> Array:
    """Sums of the entries of |E_a||E_b|, (m, m): the effect of an error of the stress on its terms."""
    basis = np.abs(strain_basis(dimension)[1])
    return np.einsum("aij,bjk->ab", basis, basis)
