"""The least C_B over positive stresses is that of the largest B_0, known without a descent."""

import numpy as np
import pytest
from problems import with_random_stiffness

from critflow import CriticalManifold, InputError, foam_network, optimize, quantity, voronoi_network

NETWORKS = {
    "plane": lambda: voronoi_network(60, seed=1),
    "plane, other springs": lambda: with_random_stiffness(voronoi_network(40, seed=2), 3),
    "plane, stretched": lambda: voronoi_network(40, seed=2).deformed([[1.0, 0.6], [0.0, 3.0]]),
    "space": lambda: foam_network(52, seed=1),
}


@pytest.mark.parametrize("name", NETWORKS)
def test_the_least_growth_is_at_the_stiffest_from_every_start(name):
    manifold, random = CriticalManifold(NETWORKS[name]()), np.random.default_rng(0)
    network, d = manifold.network, manifold.network.dimension
    stiffest = optimize(manifold, "B_0")
    least = (3 / d - 2) * stiffest.objective
    for options in ({}, {"start": 0.1 + random.random(network.n_edges)}, {"starts": 3, "rng": random}):
        found = optimize(manifold, "C_B", **options)
        assert found.ok and found.stats.method == "closed_form"
        assert found.objective == pytest.approx(least, rel=1e-11)
        assert found.objective_error < 1e-11 * abs(least) and found.stats.residual < 1e-11
        np.testing.assert_allclose(found.value.sigma, stiffest.value.sigma, rtol=1e-13)
    assert optimize(manifold, "C_B", "closed_form").objective == found.objective
    for _ in range(5):
        sigma = network.stiffness * np.exp(random.uniform(0, 2) * random.standard_normal(network.n_edges))
        assert quantity(network, "C_B").evaluate(manifold.configuration(sigma))[0] > least


def test_other_extremes_of_growth_have_no_closed_form():
    network = voronoi_network(20, seed=1)
    for objective in ("C_G", "stiffening[dilation]"):
        with pytest.raises(InputError, match="closed form"):
            optimize(network, objective, "closed_form")
    assert optimize(network, "C_B", "lbfgs", max_steps=5, throw=False).stats.method == "lbfgs"
