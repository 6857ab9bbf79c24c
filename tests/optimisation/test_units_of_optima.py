"""Optima in other units of stiffness and length: the same stresses, with values in these units."""

import numpy as np
import pytest
from units import UNITS, in_units

from critflow import foam_network, optimize, voronoi_network

PLANAR = voronoi_network(40, seed=3)


@pytest.mark.parametrize(("stiffness", "length"), UNITS)
@pytest.mark.parametrize("name", ["G_0", "C_B", "V_tau", "modulus[uniaxial]"])
def test_optima_are_the_same_to_the_last_bit(name, stiffness, length):
    plain, scaled = (optimize(one, name, throw=False) for one in (PLANAR, in_units(PLANAR, stiffness, length)))
    assert scaled.status is plain.status
    assert scaled.stats.steps == plain.stats.steps
    assert scaled.objective == plain.objective * (1.0 if name == "V_tau" else stiffness)
    np.testing.assert_array_equal(scaled.value.sigma, plain.value.sigma)


@pytest.mark.parametrize("name", ["G_0", "C_B"])
def test_moduli_in_space_have_the_unit_of_stiffness_over_length(name):
    network = foam_network(60, seed=1)
    plain, scaled = (optimize(one, name) for one in (network, in_units(network, 2.0**-18, 2.0**21)))
    assert scaled.objective == pytest.approx(plain.objective * 2.0**-39, rel=1e-10)
