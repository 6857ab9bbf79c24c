"""Systems without multipliers, for large networks: the equations themselves, and coefficients as without them."""

from dataclasses import astuple

import numpy as np
import pytest
from problems import grounded

from critflow import CriticalManifold, manifold, stiffening, voronoi_network
from critflow.saddles import Saddle
from critflow_extras import CondensedSaddle, local_response


@pytest.mark.parametrize("n_vertices", [40, 1000])
@pytest.mark.parametrize("spread", [0.0, 0.9])
def test_the_condensed_saddle_solves_the_saddle(n_vertices, spread):
    """P u + Rᵀ λ = f and R u = e by dense incidence; elongations along σ cannot be met and are left out."""
    network, rng = voronoi_network(n_vertices, seed=3), np.random.default_rng(5)
    sigma = rng.uniform(1 - spread, 1 + spread, network.n_edges)
    L = CriticalManifold(network).configuration(sigma).bond_vectors
    forces, given = rng.standard_normal((n_vertices - 1, 2)), rng.standard_normal(network.n_edges)
    u, multipliers, error = CondensedSaddle(network).factorize(sigma, L).solve(forces, given)
    assert error < 1e-13
    g, _ = grounded(network)
    met = given - (given @ sigma) / (sigma @ sigma) * sigma
    np.testing.assert_allclose(np.einsum("ad,ad->a", L, g @ u), met, rtol=0, atol=1e-11)
    balance = g.T @ (sigma[:, None] * (g @ u) + multipliers[:, None] * L)
    np.testing.assert_allclose(balance, forces, rtol=0, atol=1e-11)
    other, lagrange, _ = Saddle(network).factorize(sigma, L).solve(forces, given)
    np.testing.assert_allclose(u, other, rtol=0, atol=1e-9 * np.abs(other).max())
    # The multipliers are free by a multiple of the self-stress.
    apart = multipliers - lagrange
    apart -= (sigma @ apart) / (sigma @ sigma) * sigma
    np.testing.assert_allclose(apart, 0, rtol=0, atol=1e-9 * np.abs(multipliers).max())


def test_large_positive_stresses_use_the_condensed_system(monkeypatch):
    network = voronoi_network(40, seed=1)
    whole = CriticalManifold(network)
    positive = np.ones(network.n_edges)
    signed = np.where(np.arange(network.n_edges) == 7, -0.01, positive)
    critical = whole.configuration(positive)
    expected, response = stiffening(critical, manifold=whole), local_response(critical, (0, 9), [(3, 20)])
    monkeypatch.setattr(manifold, "CONDENSED_EDGES", 60)
    large = CriticalManifold(network)
    assert large.system(positive) is large.condensed and large.system(signed) is large.saddle
    found = stiffening(critical, manifold=large)
    errors = np.add(astuple(found.stats.error_bound), astuple(expected.stats.error_bound))
    assert (np.abs(np.subtract(astuple(found.value), astuple(expected.value))) <= errors).all()
    assert errors.max() < 1e-12
    again = local_response(large.configuration(positive), (0, 9), [(3, 20)])
    np.testing.assert_allclose(again.value.strains, response.value.strains, rtol=1e-10)
