"""Newton's method for critical configurations with lengths proportional to given ones, |L_α| ∝ ℓ_α."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from critflow.linalg.saddle import Saddle
from critflow.networks.network import Array, Network
from critflow.precision.double_double import divide, dot, extended, multiply, scaled, subtract, total, two_product
from critflow.precision.geometry import ExtendedGeometry

SOLVED = 1e-6  # relative residual of a Newton step that determines the error of its start


class Polished(NamedTuple):
    """Coordinates (N_v, d), σ (N_b,), largest relative error of lengths and forces, and the steps taken."""

    coordinates: Array
    sigma: Array
    error: float
    steps: int


def polish(
    saddle: Saddle, network: Network, lengths: Array, coordinates: Array, sigma: Array, max_steps: int = 12
) -> Polished:
    """Newton on the optimality conditions gᵀ(σ ∘ L) = 0, |L|² = λ ℓ²: from solver accuracy to rounding.

    All edges are stressed.
    """
    target = 0.5 * lengths**2
    x = coordinates.copy()
    best = Polished(x, sigma, np.inf, 0)
    for step in range(max_steps + 1):
        L = network.bond_vectors(x)
        h = 0.5 * np.sum(L**2, axis=1)
        scale = float(sigma @ h / (sigma @ target))
        # Residuals: forces relative to tensions, and lengths relative to their targets.
        force = network.divergence @ (sigma[:, None] * L)
        error = max(
            float(np.abs(h / (scale * target) - 1).max()) / 2,
            float(np.abs(force).max() / np.mean(np.abs(sigma) * np.sqrt(2 * h))),
        )
        last = not error < 0.5 * best.error
        # Of two iterates whose residuals are rounding the later is closer: soft modes hardly change residuals.
        if error < 2 * best.error:
            best = Polished(x, sigma, error, step)
        if last:
            break
        u, change, _ = saddle.factorize(sigma, L).solve_bordered(-force, scale * target - h, -target[None])
        x, sigma = x.copy(), sigma + change
        x[network.free] += u
    return best


def newton_error(saddle: Saddle, network: Network, lengths: Array, coordinates: Array, sigma: Array) -> float:
    """Largest component of the difference from the coordinates in exact balance with lengths ∝ ℓ.

    Error bound (estimate): one more step of Newton's method, from residuals in extended precision.  All edges are
    stressed.  NaN where the step is not determined.
    """
    geometry, stress = ExtendedGeometry(network), extended(sigma)
    L = geometry.bond_vectors(extended(coordinates[network.free]), network.boundary_vectors)
    twice_h = dot(L, L)
    target = two_product(lengths, lengths)
    # The second equation is consistent for one ratio only, which needs the same number of digits.
    virial, wanted = (total(multiply(stress, sizes)) for sizes in (twice_h, target))
    left = 0.5 * subtract(multiply(divide(virial, wanted), target), twice_h).high
    force = geometry.divergence(scaled(stress, L)).high
    # The solver expects residuals of order one: divide by their own scale, that of rounding.
    size = float(max(np.abs(left).max(), np.abs(force).max()))
    if size == 0.0:
        return 0.0
    u, _, residual = saddle.factorize(sigma, L.high).solve(-force / size, left / size)
    return size * float(np.abs(u).max()) if residual < SOLVED else np.nan
