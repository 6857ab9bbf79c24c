"""Designs in other units of stiffness and length: the same stresses, with values in these units."""

import numpy as np
import pytest
from units import UNITS, in_units

from critflow import voronoi_network
from critflow_extras import design

PLANAR = voronoi_network(40, seed=3)


@pytest.mark.parametrize(("stiffness", "length"), UNITS)
@pytest.mark.parametrize("prefer", ["least_change", "V_L", "coordinates"])
def test_designs_are_the_same(prefer, stiffness, length):
    found = []
    for k, unit in ((1.0, 1.0), (stiffness, length)):
        network = in_units(PLANAR, k, unit)
        place = unit * (PLANAR.positions + 0.05 * np.sin(np.arange(80)).reshape(-1, 2))
        wanted = {"B_0": 0.2 * k, "C_B": 0.1 * k, "length[3]": 0.6 * unit}
        one = design(network, wanted, prefer=place if prefer == "coordinates" else prefer)
        assert one.reached
        np.testing.assert_allclose([each.value for each in one.targets.values()], list(wanted.values()), rtol=1e-10)
        found.append((one.distance, one.value.sigma, one.preference / (unit**2 if prefer == "coordinates" else 1.0)))
    for plain, scaled in zip(*found, strict=True):
        np.testing.assert_allclose(scaled, plain, rtol=1e-6)


def test_targets_far_below_one_are_reached_to_their_own_digits():
    """Errors below a hundredth of the unit are absolute: a hundredth of k, not of one."""
    target = 0.2 * 2.0**-40
    found = design(PLANAR.with_stiffness(2.0**-40 * PLANAR.stiffness), {"B_0": target})
    assert found.targets["B_0"].value == pytest.approx(target, rel=1e-10)
