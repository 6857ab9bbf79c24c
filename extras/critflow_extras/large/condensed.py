"""Systems of stresses and displacements of large networks without their multipliers, for σ > 0.

With a small compliance 1/w, R u − λ/w = e, the equations of `critflow.saddles` are
    (P ⊗ 1 + Rᵀ w R) u = f + Rᵀ w e,   λ = w (R u − e).
That matrix has the pattern of the elastic Hessian, d·n_free unknowns in place of d·n_free + N_b, and is positive
definite.  Iteration on the residuals of the saddle system removes the compliance: the method of multipliers (Hestenes;
Powell, 1969), of which each step gains 1/w times the least stiffness that the constraints add.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from critflow.networks import Array, Network
from critflow.numerics import dot
from critflow.saddles import CONTRACTION, MOST_REFINEMENTS, REFINED
from critflow.sparse import Factor, block_laplacian, edge_blocks

# w |L|² in units of ⟨|σ|⟩.  The gap of R closes as 1/N_v: 1e8 takes 3 refinements at 1,000 vertices and at 1,000,000.
WEIGHT = 1e8


class CondensedSaddle:
    """The condensed matrix of one network."""

    def __init__(self, network: Network, backend: str = "auto"):
        self._network, self.pattern = network, block_laplacian(network, backend)

    def factorize(self, sigma: Array, bond_vectors: Array) -> CondensedFactor:
        """The factor at stresses σ > 0 (N_b,) and bond vectors L (N_b, d)."""
        square = dot(bond_vectors, bond_vectors)
        # Relative to |L|²: directions count, or rounding would hide the equations of short edges.
        weight = WEIGHT * float(np.mean(np.abs(sigma))) / square
        factor = self.pattern.factorize(edge_blocks(weight, bond_vectors, sigma))
        return CondensedFactor(self._network, factor, sigma, bond_vectors, np.sqrt(square), weight)


@dataclass(frozen=True, eq=False)
class CondensedFactor:
    """A factorised condensed matrix at σ (N_b,) and L (N_b, d), with lengths |L| and weights w (N_b,)."""

    network: Network
    factor: Factor
    sigma: Array
    bond_vectors: Array
    lengths: Array
    weight: Array

    def solve(self, forces: Array, elongations: Array, tolerance: float = REFINED) -> tuple[Array, Array, float]:
        """u, λ of P u + Rᵀ λ = forces (n_free, d), R u = elongations (N_b,), and the relative residual.

        The component of the elongations along σ, which no displacement gives, is ignored.
        """
        L, w = self.bond_vectors, self.weight
        g, divergence = self.network.free_incidence, self.network.divergence
        # Residuals are relative to the size of the terms that cancel in them.
        force_scale, length_scale = float(np.mean(np.abs(self.sigma) * self.lengths)), float(np.mean(self.lengths))
        null = self.sigma / np.linalg.norm(self.sigma)
        elongations = elongations - (null @ elongations) * null
        u, multipliers, best = np.zeros_like(forces), np.zeros_like(elongations), np.inf
        force, elongation = forces, elongations
        for _ in range(MOST_REFINEMENTS):
            right = force + divergence @ ((w * elongation)[:, None] * L)
            step = self.factor.solve(right.ravel()).reshape(forces.shape)
            new_u, new_multipliers = u + step, multipliers + w * (dot(L, g @ step) - elongation)
            rates = g @ new_u
            elongation = elongations - dot(L, rates)
            force = forces - divergence @ (self.sigma[:, None] * rates + new_multipliers[:, None] * L)
            missing = float(np.abs(elongation / self.lengths).max())
            error = max(float(np.abs(force).max()) / force_scale, missing / length_scale)
            if not error < CONTRACTION * best:
                break
            u, multipliers, best = new_u, new_multipliers, error
            if error < tolerance:
                break
        return u, multipliers, best
