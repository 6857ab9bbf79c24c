"""No network under tension softens more than the stiffest one: the gap by its formula, and without tension."""

import numpy as np
import pytest
import scipy.linalg
from problems import voronoi_3d, with_random_stiffness

from critflow import CriticalManifold, stiffening, upper_bound, voronoi_network


def turning_energy(critical):
    """(3c/V) Σ σ̂|L̇_⊥|² of a dilation, from a dense constrained minimisation of Σ σ̂|L̇|² at rates L·L̇ = c σ̂|L|²/k."""
    network, L, d = critical.network, critical.bond_vectors, critical.network.dimension
    s, k = critical.sigma / np.linalg.norm(critical.sigma), network.stiffness
    square = np.sum(L**2, axis=1)
    c = float(s @ square) / d / float(s**2 @ (square / k))
    g = np.kron(network.free_incidence.toarray(), np.eye(d))
    R = (g.reshape(len(s), d, -1) * L[:, :, None]).sum(axis=1)
    P = g.T @ (np.repeat(s, d)[:, None] * g)
    goal = c * s * square / k - square / d
    u = np.linalg.lstsq(R, goal, rcond=None)[0]
    zero_modes = scipy.linalg.null_space(R, rcond=1e-10)
    pull = g.T @ (np.repeat(s, d) * (L / d).ravel()) + P @ u
    u -= zero_modes @ np.linalg.solve(zero_modes.T @ P @ zero_modes, zero_modes.T @ pull)
    rate = L / d + (g @ u).reshape(L.shape)
    np.testing.assert_allclose(np.sum(L * rate, axis=1), c * s * square / k, rtol=0, atol=1e-9)
    turning = rate - (np.sum(L * rate, axis=1) / square)[:, None] * L
    return 3 * c * float(s @ np.sum(turning**2, axis=1)) / network.volume


@pytest.mark.parametrize("make", [lambda: with_random_stiffness(voronoi_network(24, seed=2), 3), voronoi_3d])
def test_no_positive_stress_softens_more_than_the_stiffest(make):
    network = make()
    manifold, least = CriticalManifold(network), 3 / network.dimension - 2
    bound = least * upper_bound(manifold, "B_0")
    stiffest = stiffening(manifold.configuration(network.stiffness)).value
    assert stiffest.C_B == pytest.approx(bound, rel=1e-9) == pytest.approx(least * stiffest.bulk_0, rel=1e-9)
    for spread in (0.1, 1.0):
        sigma = np.exp(spread * np.random.default_rng(7).normal(size=network.n_edges))
        critical = manifold.configuration(sigma)
        value = stiffening(critical).value
        gap = turning_energy(critical)
        assert gap > 0 and value.C_B - least * value.bulk_0 == pytest.approx(gap, rel=1e-7)
        assert value.C_G > -value.shear_0 / value.bulk_0 * gap / 3


def test_compressed_edges_soften_without_that_bound():
    network = voronoi_network(8, seed=0)
    sigma = np.ones(network.n_edges)
    sigma[9] = -0.5
    value = stiffening(CriticalManifold(network).configuration(sigma)).value
    assert value.C_B < -5 * value.bulk_0
