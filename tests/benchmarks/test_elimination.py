"""Elimination without subtraction against the high-precision reference."""

import numpy as np
import pytest
from problems import NETWORKS

from critflow import CriticalManifold, Status, voronoi_network
from workflows.benchmarks import reference
from workflows.benchmarks.elimination import subtraction_free_solve

NETWORK = voronoi_network(12, seed=1)


@pytest.mark.parametrize("p", [0, 2, 8, 14, 20, 60])
def test_no_spread_of_stresses_costs_digits(p):
    for seed in range(3):
        sigma = 10 ** (p * np.random.default_rng(seed).uniform(-1, 1, NETWORK.n_edges))
        x = subtraction_free_solve(NETWORK, sigma)
        exact = reference.configuration(NETWORK, sigma, digits=reference.digits_for(sigma))
        # A mean of means, a rounding or two for each of 11 vertices and of an offset of some units.
        assert reference.largest_error(x, exact.coordinates) < 1e-14


@pytest.mark.parametrize("name", ["honeycomb", "own images", "pinned star", "pinned grid", "sheared", "voronoi 3D"])
def test_it_is_the_configuration(name):
    network = NETWORKS[name]()
    sigma = 1 + np.random.default_rng(2).random(network.n_edges)
    solution = CriticalManifold(network).solve(sigma)
    assert solution.status is Status.ok
    np.testing.assert_allclose(subtraction_free_solve(network, sigma), solution.value.coordinates, rtol=0, atol=5e-14)
