"""Stresses for lengths in given ratios by a fixed-point iteration, where every edge is stressed.

A critical configuration has lengths |L| ∝ ℓ if log σ = θ is a fixed point of θ → θ + f(θ), f = ω log(|L|/ℓ) without its
mean: an edge that is too long receives more stress.  Each step is one factorisation of P(σ), without gradients:

1. Solve P(σ) x = −gᵀ(σ ∘ b) for the lengths of σ = exp θ.
2. Find the c that minimises |f − Σ_j c_j Δf_j| over the differences of the last steps (Anderson, 1965).
3. θ ← θ + f − Σ_j c_j (Δθ_j + Δf_j).

The iteration converges linearly, three steps a digit, if lengths in these ratios exist with σ > 0; else f stays finite.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from scipy.linalg.lapack import dgelss

from critflow.critical.manifold import Balance, CriticalManifold
from critflow.linalg.vectors import norms
from critflow.networks.network import Array

# A stress changes the length of its own edge by −N_v/N_b of its relative change on average: 2/3 with three edges a
# vertex.  The inverse is the best step without acceleration.
STEP = 1.5
REMEMBERED = 8  # differences in the acceleration; 15 and 30 save no step down to deviations of 1e-9
LARGEST = 50.0  # |log σ| at which it ends: stresses of networks without slack edges span a few decades
PATIENCE = 6  # steps within which the largest deviation halves; networks with slack edges need more
NEAR = 0.1  # largest deviation of log(|L|/ℓ) from which Newton's method converges, also where one edge is short


def iterate_lengths(
    manifold: CriticalManifold, lengths: Array, deformed: Callable[[Array], Array] | None = None
) -> Iterator[tuple[Balance, float]]:
    """Balances, Σσ² = N_b, with the largest |log(|L|/ℓ) − mean| of each, from σ = 1; ends where it no longer halves.

    It also ends where an edge has no length, as one that hangs, or stresses become huge or vanish.

    lengths   ℓ up to a factor, (N_b,)
    deformed  bond vectors L (N_b, d) → F L: a network on a deformed boundary is in balance under the same stresses
    """
    n = manifold.network.n_edges
    theta, deviations = np.zeros(n), [np.inf] * PATIENCE
    thetas: list[Array] = []
    steps: list[Array] = []
    while True:
        # Sums over n are the bits of means, which take longer for small networks.
        theta = theta - theta.sum() / n
        if not np.abs(theta).max() < LARGEST:
            return
        sigma = np.exp(theta)
        balance = manifold.balance(sigma * np.sqrt(n / (sigma**2).sum()))
        ratios = norms(deformed(balance.bond_vectors) if deformed else balance.bond_vectors) / lengths
        if not (np.isfinite(ratios).all() and ratios.all()):
            return
        stretch = np.log(ratios)
        stretch -= stretch.sum() / n
        deviations.append(float(np.abs(stretch).max()))
        if not deviations[-1] < 0.5 * deviations[-1 - PATIENCE]:
            return
        yield balance, deviations[-1]
        f = STEP * stretch
        thetas, steps = [*thetas, theta][-REMEMBERED - 1 :], [*steps, f][-REMEMBERED - 1 :]
        theta = theta + f
        if len(steps) > 1:
            places, ahead = np.array(thetas), np.array(steps)
            changes = ahead[1:] - ahead[:-1]
            weights = dgelss(changes @ changes.T, changes @ f, cond=1e-14)[1]
            theta -= weights @ (places[1:] - places[:-1] + changes)
