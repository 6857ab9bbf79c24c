"""C_B and C_G as objectives: their values, and gradients against differences."""

import numpy as np
import pytest
from problems import random_stress, with_random_stiffness

from critflow import CriticalManifold, foam_network, optimize, stiffening, voronoi_network
from critflow.critical.derivatives import evaluate
from critflow.mechanics.stiffening_objective import StiffeningCoefficient

NETWORKS = {
    "plane": with_random_stiffness(voronoi_network(n_vertices=30, seed=1), seed=2),
    "sheared": voronoi_network(n_vertices=30, seed=3).deformed([[1.0, 0.6], [0.0, 1.1]]),
    "space": foam_network(n_vertices=60, seed=1),
}


@pytest.mark.parametrize("network", NETWORKS.values(), ids=NETWORKS)
@pytest.mark.parametrize("of_shear", [False, True], ids=["C_B", "C_G"])
def test_values_and_gradients(network, of_shear):
    manifold = CriticalManifold(network)
    objective, sigma = StiffeningCoefficient(manifold, of_shear), random_stress(network.n_edges, seed=5)
    found = evaluate(manifold, objective, sigma)
    exact = stiffening(manifold, manifold.configuration(sigma)).value
    assert found.value == pytest.approx(exact.C_G if of_shear else exact.C_B, rel=1e-11)
    direction, h = np.random.default_rng(7).normal(size=network.n_edges), 1e-4
    # Differences of fourth order, with errors of about 1e-10.
    there = [evaluate(manifold, objective, sigma + n * h * direction).value for n in (-2, -1, 1, 2)]
    difference = (there[0] - 8 * there[1] + 8 * there[2] - there[3]) / (12 * h)
    assert found.gradient @ direction == pytest.approx(difference, rel=3e-8)
    # The coefficient does not depend on the scale of σ.
    assert abs(found.gradient @ sigma) < 1e-12


def test_softening_can_be_optimised():
    manifold = CriticalManifold(voronoi_network(n_vertices=20, seed=2))
    least = optimize(manifold, StiffeningCoefficient(manifold), "lbfgs", throw=False, max_steps=150, tolerance=1e-6)
    stiffest = optimize(manifold, "bulk_modulus")
    # No network was found to soften more than the stiffest one, C_B = −B_0/2.
    assert -0.5 * stiffest.objective - 1e-6 < least.objective < -0.45 * stiffest.objective
