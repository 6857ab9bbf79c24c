"""Compliances of pairs of vertices under a finite stress tσ, Σσ² = N_b, in springs of stiffness k.

Their Hessian is that of P at the stress tσ and of edges that yield, in place of edges that keep their lengths:

    tP u + Rᵀ λ = a,   R u = y λ,   y = |L|²/(k − tσ)

so that the derivatives of `compliance` have the further term  Σ λ_t λ_s dy.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from critflow.manifold import Balance
from critflow.networks import Array
from critflow.numerics import EPS, dot
from critflow.quantities import Balanced
from critflow_extras.local.compliance import Compliances
from critflow_extras.local.pairs import Target


@dataclass(frozen=True, eq=False)
class StressedCompliances(Compliances):
    """Motions of pairs at the stress tσ, which is `sigma` (N_b,) here, by one factor."""

    def error(self, target: Target, source: Target) -> float:
        """Error (estimate) of G_ts: with the roundings of y."""
        return super().error(target, source) + 4 * EPS * float(np.abs(self._yielded(target, source)).sum())

    def derivatives(self, target: Target, source: Target) -> tuple[Array, Array]:
        """∂G_ts/∂(tσ) (N_b,) and ∂G_ts/∂L (N_b, d) at constant k and directions of the pairs."""
        by_sigma, by_L = super().derivatives(target, source)
        L, yielded = self.bond_vectors, self._yielded(target, source)
        square = dot(L, L)
        return by_sigma + yielded * self.yielding / square, by_L + 2 * (yielded / square)[:, None] * L

    def by_stiffness(self, target: Target, source: Target) -> Array:
        """∂G_ts/∂k (N_b,) at constant tσ and L."""
        return -self._yielded(target, source) * self.yielding / dot(self.bond_vectors, self.bond_vectors)

    def _yielded(self, target: Target, source: Target) -> Array:
        """λ_t y λ_s (N_b,)."""
        return self.motion(target).multipliers * self.yielding * self.motion(source).multipliers


def scaled(sigma: Array, stress: float) -> Array:
    """tσ (N_b,) with Σσ² = N_b, for a σ of any scale."""
    return stress * np.sqrt(len(sigma) / float(sigma @ sigma)) * sigma


def compliances_under(balance: Balanced, stress: float) -> StressedCompliances | None:
    """The compliances under the stress tσ; None where no springs have it, or where it is no minimum of their energy."""
    shared = balance.shared if isinstance(balance, Balance) else {}
    key = f"compliances of pairs under {stress!r}"
    if key not in shared:
        network, L, sigma = balance.manifold.network, balance.bond_vectors, scaled(balance.sigma, stress)
        stiffness = network.stiffness - sigma
        stable = bool((stiffness > 0).all())
        if stable:
            yielding = dot(L, L) / stiffness
            factor = balance.manifold.saddle.factorize(sigma, L, compliance=yielding)
            stable = factor.factor.n_negative == network.n_edges
        shared[key] = StressedCompliances(network, sigma, L, factor, yielding) if stable else None
    compliances: StressedCompliances | None = shared[key]
    return compliances
