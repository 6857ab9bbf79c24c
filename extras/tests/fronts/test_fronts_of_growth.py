"""Fronts of B_0 against its growth C_B and against C_G: every point is certified, and none dominates another."""

import pytest

from critflow import Status, voronoi_network
from critflow_extras import pareto

FRONTS = {
    "stiff, stiffening": ({"B_0": "largest", "C_B": "largest"}, 12),
    "soft, softening": ({"B_0": "smallest", "C_B": "smallest"}, 12),
    "stiff, shear stiffening": ({"B_0": "largest", "C_G": "largest"}, 18),
    "stiff, shear softening": ({"B_0": "largest", "C_G": "smallest"}, 12),
}


@pytest.mark.parametrize(("objectives", "n_vertices"), FRONTS.values(), ids=FRONTS)
def test_every_point_is_certified_and_none_dominates_another(objectives, n_vertices):
    seed = {12: 0, 18: 1}[n_vertices]
    network = voronoi_network(n_vertices, seed)
    front = pareto(network, objectives, 5, within={"force_densities": (0.2, None)}, throw=False)
    assert front.statuses == (Status.ok,) * 5
    assert front.weights[:, 0].min() >= -1e-5 and front.residuals.max() < 1e-5
    assert not front.dominated.any()
