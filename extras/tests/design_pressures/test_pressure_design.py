"""Design of stresses and pressures: areas and tensions reached, gradients against differences, refusals."""

import numpy as np
import pytest
from derivatives import assert_derivative

from critflow import InputError, quantity, voronoi_network
from critflow_extras import design
from critflow_extras.design_pressures.stresses_and_pressures import StressesAndPressures


def test_design_reaches_areas_and_tensions_by_pressures():
    network = voronoi_network(20, seed=1)
    targets = {"area[3]": 3.0, "area[4]": 2.0, "V_tau": (0, 1e-3)}
    found = design(network, targets, change="pressures")
    assert found.reached
    for name, value in (("area[3]", 3.0), ("area[4]", 2.0)):
        assert found.targets[name].value == pytest.approx(value, abs=1e-10)
        assert quantity(network, name).evaluate(found.value)[0] == pytest.approx(value, abs=1e-10)
    assert np.var(found.value.tensions) / np.mean(found.value.tensions) ** 2 < 1e-3 + 1e-9


def test_responses_of_springs_are_refused():
    with pytest.raises(InputError, match="pressures change"):
        design(voronoi_network(20, seed=1), {"B_0": 0.2}, change="pressures")


def test_gradients_of_a_design_by_stress_and_pressure():
    network, rng = voronoi_network(8, 1), np.random.default_rng(1)
    sigma, pressures = np.exp(0.3 * rng.standard_normal(12)), 0.1 * rng.standard_normal(4)
    variables = StressesAndPressures(network, sigma, pressures)
    quantities = [quantity(network, name) for name in ("V_L", "V_tau", "length[2]", "area[1]")]
    rows = variables.values(variables.at(variables.origin), quantities)[1]
    step = np.random.default_rng(1).standard_normal(len(variables.origin))
    values = lambda z: variables.values(variables.at(z), quantities)[0]  # noqa: E731
    assert_derivative(values, lambda u: rows @ u, variables.origin, [step], 1e-3, 1e-7)
