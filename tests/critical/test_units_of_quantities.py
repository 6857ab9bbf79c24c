"""Values of quantities in other units of stiffness and length."""

import numpy as np
import pytest
from units import in_units

from critflow import CriticalManifold, foam_network, voronoi_network
from critflow.critical.vocabulary import quantity

PLANAR = voronoi_network(40, seed=3)


@pytest.mark.parametrize("name", ["B_0", "C_B", "S_xy", "C_xxyy", "length[0]", "area[1]", "V_L", "modulus[uniaxial]"])
@pytest.mark.parametrize("network", [PLANAR, foam_network(60, seed=1)], ids=["plane", "space"])
def test_values_scale_as_their_units(network, name):
    if name.startswith("area") and network.dimension == 3:
        name = "V_tau"
    scaled, sigma = in_units(network, 0.3, 7.0), np.linspace(1, 2, network.n_edges)
    there, here = (CriticalManifold(one).configuration(sigma) for one in (scaled, network))
    goal = quantity(network, name)
    ratio = goal.unit(scaled) / goal.unit(network)
    assert goal.evaluate(there)[0] == pytest.approx(ratio * goal.evaluate(here)[0], rel=1e-9)
