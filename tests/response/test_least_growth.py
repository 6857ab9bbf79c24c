"""Least growth: C_B ≥ −B_0/2 of positive stresses, equal at the largest B_0; C_G ≥ −(G_0/3B_0)(C_B + B_0/2)."""

import numpy as np
import pytest

from critflow import CriticalManifold, stiffening, upper_bound, voronoi_network

ERROR = 1e-9  # in units of B_0


@pytest.mark.parametrize(("n_vertices", "seed"), [(12, 0), (18, 1), (24, 2)])
@pytest.mark.parametrize("spread", [0.1, 0.3, 1.0])
def test_no_positive_stress_softens_more_than_the_stiffest(n_vertices, seed, spread):
    manifold, rng = CriticalManifold(voronoi_network(n_vertices, seed)), np.random.default_rng([seed, 1])
    for _ in range(10):
        sigma = np.exp(spread * rng.normal(size=manifold.network.n_edges))
        growth = stiffening(manifold.configuration(sigma)).value
        assert growth.C_B / growth.bulk_0 > -0.5 - ERROR
        assert growth.C_G > -growth.shear_0 / (3 * growth.bulk_0) * (growth.C_B + growth.bulk_0 / 2)


@pytest.mark.parametrize(("n_vertices", "seed"), [(12, 0), (18, 1), (24, 2)])
def test_the_stiffest_softens_most(n_vertices, seed):
    manifold = CriticalManifold(voronoi_network(n_vertices, seed))
    growth = stiffening(manifold.configuration(manifold.network.stiffness)).value
    assert growth.C_B / upper_bound(manifold, "B_0") == pytest.approx(-0.5, abs=ERROR)
