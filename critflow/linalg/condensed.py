"""Stresses and displacements together, with the multipliers eliminated: a matrix of the size of the elastic Hessian.

The systems are those of `Saddle`,  P u + Rᵀ λ = f,  R u = e.  With a small compliance 1/w of the multipliers,
R u − λ/w = e, they go:  (P ⊗ 1 + Rᵀ w R) u = f + Rᵀ w e,  λ = w (R u − e).  That matrix has the pattern of the elastic
Hessian, d·n_free unknowns in place of d·n_free + N_b, and is positive definite where P is.  Iterating on the residuals
of the system itself takes the compliance out again (the method of multipliers: Hestenes, Powell, 1969), by a factor
that is 1/w times the least stiffness which the constraints add, so a large w leaves few steps.
"""

from __future__ import annotations

import numpy as np

from critflow.linalg.factor import Factor
from critflow.linalg.matrices import block_laplacian, edge_blocks
from critflow.networks.network import Array, Network

# w |L|² in units of ⟨|σ|⟩: directions count, or rounding would hide what short edges ask for.  The gap of R closes as
# 1/N_v: 1e8 takes 3 steps at 1,000 vertices and at 1,000,000.
_WEIGHT = 1e8


def positive(sigma: Array, margin: float = 1e-7) -> bool:
    """Whether every stress is positive, by `margin` times the mean."""
    return bool((sigma > margin * np.mean(np.abs(sigma))).all())


class CondensedSaddle:
    """[[P ⊗ 1, Rᵀ], [R, 0]] as `Saddle` solves it, for σ > 0, through the matrix P ⊗ 1 + Rᵀ w R."""

    def __init__(self, network: Network, backend: str = "auto"):
        self._network = network
        self._pattern = block_laplacian(network, backend)

    @property
    def backend(self) -> str:
        """The sparse solver that was chosen."""
        return self._pattern.backend

    def stable(self, sigma: Array, bond_vectors: Array, margin: float = 1e-7) -> bool:
        """Whether every stress is positive, by `margin` times the mean: the only case that is served here."""
        return positive(sigma, margin)

    def factorize(self, sigma: Array, bond_vectors: Array) -> CondensedSaddle:
        """Factorise at stresses σ (N_b,) and bond vectors L (N_b, d); the last factorisation is the one that solves."""
        square = np.einsum("ad,ad->a", bond_vectors, bond_vectors)
        self._sigma, self._L, self._null = sigma, bond_vectors, sigma / np.linalg.norm(sigma)
        self._length = np.sqrt(square)
        self._weight = _WEIGHT * float(np.mean(np.abs(sigma))) / square
        # Residuals are judged by the size of the terms that cancel in them.
        self._scales = float(np.mean(np.abs(sigma) * self._length)), float(np.mean(self._length))
        self._factor: Factor = self._pattern.factorize(edge_blocks(self._weight, bond_vectors, sigma))
        return self

    def solve(
        self, forces: Array, elongations: Array, tolerance: float = 1e-15, max_refinements: int = 30
    ) -> tuple[Array, Array, float]:
        """Solve P u + Rᵀ λ = forces (n_free, d), R u = elongations (N_b,); also the relative residual.

        What the elongations have along σ, which no displacement can give, is left out.
        """
        network, L, w = self._network, self._L, self._weight
        g, divergence = network.free_incidence, network.divergence
        elongations = elongations - (self._null @ elongations) * self._null
        u, multipliers, best = np.zeros_like(forces), np.zeros_like(elongations), np.inf
        force, elongation = forces, elongations
        for _ in range(max_refinements):
            right = force + divergence @ ((w * elongation)[:, None] * L)
            step = self._factor.solve(right.ravel()).reshape(forces.shape)
            new_u = u + step
            new_multipliers = multipliers + w * (np.einsum("ad,ad->a", L, g @ step) - elongation)
            rates = g @ new_u
            elongation = elongations - np.einsum("ad,ad->a", L, rates)
            force = forces - divergence @ (self._sigma[:, None] * rates + new_multipliers[:, None] * L)
            missing = float(np.abs(elongation / self._length).max())
            error = max(float(np.abs(force).max()) / self._scales[0], missing / self._scales[1])
            if not error < 0.9 * best:
                break
            u, multipliers, best = new_u, new_multipliers, error
            if error < tolerance:
                break
        return u, multipliers, best
