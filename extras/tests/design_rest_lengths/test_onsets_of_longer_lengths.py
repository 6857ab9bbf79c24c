"""Onsets of equal rest lengths, 5 % above the transition, moved to a smaller, a larger and an opposite shear."""

import numpy as np
import pytest

from critflow import critical_from_lengths, spring_state, voronoi_network
from critflow_extras import critical_strain, design


@pytest.mark.parametrize("factor", [0.6, 1.3, -1.0])
@pytest.mark.parametrize("seed", range(2))
def test_a_prescribed_critical_shear_is_reached(seed, factor):
    network = voronoi_network(n_vertices=60, seed=seed)
    equal = np.ones(network.n_edges)
    lengths = 1.05 * critical_from_lengths(network, equal, throw=False).ratio * equal
    target = factor * critical_strain(network, lengths, "simple_shear").value.strain
    start = spring_state(network, lengths, network.positions)
    rest_lengths = design(start, {"onset[simple_shear]": target}, change="rest_lengths").value.rest_lengths
    again = critical_strain(network, rest_lengths, "simple_shear", direction=int(np.sign(target))).value
    assert again.strain == pytest.approx(target, abs=1e-9)
