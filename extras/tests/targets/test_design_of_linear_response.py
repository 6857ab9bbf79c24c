"""S/√D on demand: that of anisotropic stresses is reached, and what exceeds its bound in one direction is refused.

At the transition C = S⊗S/(V D), so that S/√D is all of linear elasticity.  (S:A)² ≤ V D sup μ_A for every strain A
bounds S/√D by an ellipsoid, here in the closed form of the configuration at σ = k.
"""

import numpy as np
import pytest

from critflow import CriticalManifold, Status, voronoi_network
from critflow_extras import design

NAMES = ("S_xx", "S_yy", "S_xy")


def scaled_stress(critical):
    """S_xx, S_yy, S_xy over √D."""
    S = np.einsum("a,ai,aj->ij", critical.sigma, critical.bond_vectors, critical.bond_vectors)
    S /= np.sqrt(np.sum(critical.sigma**2 * critical.lengths**2 / critical.network.stiffness))
    return np.array([S[0, 0], S[1, 1], S[0, 1]])


def of_random_stress(manifold, rng):
    """S/√D of a log-normal stress that is stronger in a random direction."""
    reference = manifold.balance(np.ones(manifold.network.n_edges)).bond_vectors
    angle = 2 * (np.arctan2(reference[:, 1], reference[:, 0]) - np.pi * rng.random())
    spread, anisotropy = rng.random(2)
    sigma = np.exp(spread * rng.standard_normal(len(angle)) + anisotropy * np.cos(angle))
    return scaled_stress(manifold.configuration(sigma))


def part_of_bound(manifold, S):
    """|S/√D| over its bound in the same direction."""
    k = manifold.network.stiffness
    L = manifold.balance(k).bond_vectors
    values, vectors = np.linalg.eigh(np.einsum("a,ai,aj->ij", k, L, L))
    # V sup μ_A = min_W tr (A + W) M (A + W)ᵀ is diagonal in the frame of M: A_ii² M_i, and 4 A_ij²/(1/M_i + 1/M_j).
    matrix = vectors.T @ np.array([[S[0], S[2]], [S[2], S[1]]]) @ vectors
    square = np.sum(np.diag(matrix) ** 2 / values) + matrix[0, 1] ** 2 * np.sum(1 / values)
    return np.sqrt(square)


@pytest.mark.parametrize("seed", range(3))
def test_a_linear_response_is_reached_inside_its_bound_and_refused_beyond(seed):
    manifold, rng = CriticalManifold(voronoi_network(200, seed)), np.random.default_rng([seed, 1])
    for _ in range(3):
        S = of_random_stress(manifold, rng)
        reached = design(manifold, dict(zip(NAMES, S, strict=True)))
        assert np.abs(scaled_stress(reached.value) - S).max() <= 1e-9 * np.linalg.norm(S)
        factor = (1.001 + 0.3 * rng.random()) / part_of_bound(manifold, S)
        beyond = design(manifold, dict(zip(NAMES, factor * S, strict=True)), throw=False)
        assert beyond.status is Status.infeasible and "bound" in beyond.note
