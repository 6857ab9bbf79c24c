"""Stresses for lengths in given ratios by a fixed-point iteration, where every edge is stressed.

A critical configuration has lengths |L| ∝ ℓ if log σ = θ is a fixed point of θ → θ + f(θ), f = ω log(|L|/ℓ) without its
mean: an edge that is too long receives more stress.  Each step is one factorisation of P(σ), without gradients:

1. Solve P(σ) x = −gᵀ(σ ∘ b) for the lengths of σ = exp θ.
2. Find the c that minimises |f − Σ_j c_j Δf_j| over the differences of the last steps (Anderson, 1965).
3. θ ← θ + f − Σ_j c_j (Δθ_j + Δf_j).

The iteration converges linearly, three steps a digit, if lengths in these ratios exist with σ > 0; else f stays finite.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from critflow.critical.manifold import Balance, CriticalManifold
from critflow.networks.network import Array

# A stress changes the length of its own edge by −N_v/N_b of its relative change on average: 2/3 with three edges a
# vertex.  The inverse is the best step without acceleration.
STEP = 1.5
REMEMBERED = 8  # differences in the acceleration; 15 and 30 save no step down to deviations of 1e-9
PATIENCE = 6  # steps within which the largest deviation halves; networks with slack edges need more


def iterate_lengths(manifold: CriticalManifold, lengths: Array) -> Iterator[tuple[Balance, float]]:
    """Balances, Σσ² = N_b, with the largest |log(|L|/ℓ) − mean| of each, from σ = 1; ends where it no longer halves.

    It also ends where an edge has no length, as one that hangs.

    lengths  ℓ up to a factor, (N_b,)
    """
    theta, deviations = np.zeros(manifold.network.n_edges), [np.inf] * PATIENCE
    thetas: list[Array] = []
    steps: list[Array] = []
    while True:
        sigma = np.exp(theta - theta.mean())
        balance = manifold.balance(sigma * np.sqrt(len(sigma) / np.sum(sigma**2)))
        ratios = np.linalg.norm(balance.bond_vectors, axis=1) / lengths
        if not (np.isfinite(ratios).all() and ratios.all()):
            return
        stretch = np.log(ratios)
        stretch -= stretch.mean()
        deviations.append(float(np.abs(stretch).max()))
        if not deviations[-1] < 0.5 * deviations[-1 - PATIENCE]:
            return
        yield balance, deviations[-1]
        f = STEP * stretch
        thetas, steps = [*thetas, theta][-REMEMBERED - 1 :], [*steps, f][-REMEMBERED - 1 :]
        theta = theta + f
        if len(steps) > 1:
            changes = np.diff(steps, axis=0)
            weights = np.linalg.lstsq(changes @ changes.T, changes @ f, rcond=1e-14)[0]
            theta -= weights @ (np.diff(thetas, axis=0) + changes)
