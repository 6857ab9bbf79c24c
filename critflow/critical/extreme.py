"""The largest modulus at the transition over all stresses of any sign, in closed form.

Virtual work gives Σσ L·A L = Σσ L·A L* with L* the configuration at σ = k, so by the inequality of Cauchy and Schwarz
    μ_A ≤ (1/V) Σ k|F L*|²,   F = A + W,  Wᵀ = −W,  FM symmetric for the moments M = Σ k L*L*ᵀ,
with equality for the forces T = kFL*.
"""

from __future__ import annotations

import numpy as np
import scipy.linalg

from critflow.critical.manifold import CriticalManifold
from critflow.networks.network import Array, Network

ISOTROPIC = 1e-14  # anisotropy of a strain that is a dilation up to rounding


def is_dilation(A: Array) -> bool:
    """Whether a strain A (d, d) is a dilation up to rounding."""
    return bool(np.abs(A - A[0, 0] * np.eye(len(A))).max() <= ISOTROPIC * np.abs(A).max())


def largest_value(manifold: CriticalManifold, A: Array) -> float:
    """The largest modulus for the symmetric strain A (d, d), over all stresses of any sign."""
    F, moment = force_map(manifold.network, manifold.balance(manifold.network.stiffness).bond_vectors, A)
    return float(np.trace(F @ moment @ F.T)) / manifold.network.volume


def force_map(network: Network, L_star: Array, A: Array) -> tuple[Array, Array]:
    """F = A + W of the best force network T = kFL*, and the moments M = Σ k L*L*ᵀ: F M is symmetric."""
    M = (network.stiffness[:, None] * L_star).T @ L_star
    if is_dilation(A):
        return A, M
    W = scipy.linalg.solve_sylvester(M, M, M @ A - A @ M)
    return A + 0.5 * (W - W.T), M


def modulus_form(manifold: CriticalManifold, strains: Array) -> Array:
    """The largest μ_A as a quadratic form of the strain A in a basis (m, d, d), from sums of two strains: (m, m)."""
    m = len(strains)
    form = np.empty((m, m))
    for a in range(m):
        for b in range(a + 1):
            form[a, b] = form[b, a] = largest_value(manifold, strains[a] + strains[b])
    single = np.diag(form) / 4
    return np.asarray(0.5 * (form - single[:, None] - single[None]))


def vanishes(F: Array, moment: Array, A: Array) -> bool:
    """Whether the bound Σk|FL*|² is zero up to rounding: the strain A (d, d) changes no length to first order."""
    return bool(np.trace(F @ moment @ F.T) <= ISOTROPIC**2 * np.sum(A**2) * np.trace(moment))
