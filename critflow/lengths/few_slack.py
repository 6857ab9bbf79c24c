"""A guess of the slack edges where they are few, by the iteration of `length_iteration` without acceleration.

With f = log(|L|/ℓ) less its mean weighted by tension, each step multiplies σ by exp(ω f): taut edges approach f = 0
from both sides, and slack ones keep f < 0 while their stress decays.  Once no edge is much too long, those that are
shorter by more than that count as slack, and Newton's method decides (`taut_set`).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from critflow.critical.manifold import Balance, CriticalManifold
from critflow.lengths.length_iteration import STEP
from critflow.linalg.vectors import dot
from critflow.networks.network import Array

CLOSE = 0.02  # largest f at which edges are guessed
MARGIN = 3.0  # guessed as slack: f below −MARGIN times the largest f
FEW = 0.01  # part of the edges up to which Newton's method finds the slack ones from such a guess
MOST_STEPS = 20  # networks with more slack edges need more
_LARGEST_CHANGE = 1.0  # of f in a step


def few_slack(
    manifold: CriticalManifold, lengths: Array, balance: Balance
) -> tuple[Balance, float, NDArray[np.bool_], int] | None:
    """A balance near the solution, its ratio t, the edges (N_b,) that seem slack, and the steps; None where many do.

    balance  from which the iteration begins
    """
    n, theta = manifold.network.n_edges, np.log(balance.sigma)
    for steps in range(MOST_STEPS):
        sigma = np.exp(theta)
        balance = manifold.balance(sigma * np.sqrt(n / (sigma @ sigma)))
        square = dot(balance.bond_vectors, balance.bond_vectors)
        if not (np.isfinite(square).all() and square.all()):
            return None
        stretch, work = 0.5 * np.log(square / lengths**2), balance.sigma * square
        mean = float(work @ stretch / work.sum())
        f = stretch - mean
        if f.max() < CLOSE:
            slack = f < -MARGIN * f.max()
            return (balance, float(np.exp(mean)), slack, steps + 1) if slack.mean() <= FEW else None
        theta = theta + STEP * np.clip(f, -_LARGEST_CHANGE, _LARGEST_CHANGE)
    return None
