"""The iteration for lengths in given ratios: balance, limit and end."""

import numpy as np
import pytest
from problems import pinned_grid, voronoi_3d

from critflow import CriticalManifold, Network, voronoi_network
from critflow.onset.length_iteration import iterate_lengths


def deviations(network, lengths):
    return [deviation for _, deviation in iterate_lengths(CriticalManifold(network), lengths)]


@pytest.mark.parametrize("network", [voronoi_network(60, seed=1), voronoi_3d(), pinned_grid(4)], ids=str)
def test_it_converges_where_every_edge_is_stressed(network):
    # Lengths that some positive stress has
    sigma = np.exp(0.3 * np.random.default_rng(0).standard_normal(network.n_edges))
    wanted = CriticalManifold(network).configuration(sigma).lengths
    steps = 0
    for balance, deviation in iterate_lengths(CriticalManifold(network), 7 * wanted):
        steps += 1
        ratios = np.log(np.linalg.norm(balance.bond_vectors, axis=1) / wanted)
        assert deviation == pytest.approx(np.abs(ratios - ratios.mean()).max(), rel=1e-9)
        force = network.divergence @ (balance.sigma[:, None] * balance.bond_vectors)
        assert np.abs(force).max() < 1e-12 and np.sum(balance.sigma**2) == pytest.approx(network.n_edges)
        if deviation < 1e-8:
            break
    assert deviation < 1e-8 and steps <= 60
    np.testing.assert_allclose(ratios - ratios.mean(), 0, atol=1e-8)


def test_it_ends_where_edges_fall_slack_or_have_no_length():
    network = voronoi_network(100, seed=0)
    wide = np.exp(0.3 * np.random.default_rng(0).standard_normal(network.n_edges))
    assert 6 < len(deviations(network, wide)) < 60 and min(deviations(network, wide)) > 1e-3
    # Two vertices between the same pins coincide, and the edge between them has no length.
    twins = Network([[0, 1], [0, 2], [0, 3], [1, 2], [1, 3]], pins={2: [0.0, 0.0], 3: [1.0, 0.0]})
    assert deviations(twins, np.ones(5)) == []
