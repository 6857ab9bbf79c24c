"""Optima, designs and fronts in other units of stiffness and length: the same stresses, with values in these units."""

import numpy as np
import pytest

from critflow import CriticalManifold, design, foam_network, optimize, pareto, voronoi_network
from critflow.critical.vocabulary import quantity

# Units of stiffness and length: powers of two, so that products with them are exact.
UNITS = [(2.0**-40, 1.0), (2.0**30, 1.0), (1.0, 2.0**-21), (2.0**-18, 2.0**21)]
PLANAR = voronoi_network(40, seed=3)


def in_units(network, stiffness, length):
    scaled = network.deformed(length * np.eye(network.dimension))
    return scaled.with_stiffness(stiffness * network.stiffness)


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


@pytest.mark.parametrize(("stiffness", "length"), UNITS)
@pytest.mark.parametrize("prefer", ["least_change", "V_L", "coordinates"])
def test_designs_are_the_same(prefer, stiffness, length):
    found = []
    for k, unit in ((1.0, 1.0), (stiffness, length)):
        network = in_units(PLANAR, k, unit)
        place = unit * (PLANAR.positions + 0.1 * np.sin(np.arange(80)).reshape(-1, 2))
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


@pytest.mark.parametrize(("stiffness", "length"), UNITS)
def test_fronts_are_the_same(stiffness, length):
    goals = {"B_0": "largest", "V_tau": "smallest"}
    plain, scaled = (pareto(one, goals, 4) for one in (PLANAR, in_units(PLANAR, stiffness, length)))
    np.testing.assert_allclose(scaled.achieved, plain.achieved * [stiffness, 1.0], rtol=1e-10)
    np.testing.assert_allclose(scaled.weights, plain.weights, rtol=1e-6)


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
