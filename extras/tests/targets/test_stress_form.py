"""Quantities that are functions of S/√D, and which of them are the same."""

import numpy as np
import pytest

from critflow import InputError, quantity, voronoi_network
from critflow.quantities import PenalisedModulus, pure_shear
from critflow_extras.targets.stress_form import same, stress_form, tensor_weights

NETWORK = voronoi_network(20, seed=1)


def of(name):
    return quantity(NETWORK, name)


def test_the_same_quantity_by_two_names():
    assert same(of("modulus[dilation]"), of("B_0"))
    assert same(of("V_L"), of("length_variance"))
    assert not same(of("S_xx"), of("C_xxxx")) and not same(of("B_0"), of("G_0")) and not same(of("V_L"), of("S_xy"))


def test_forms_of_the_stress():
    np.testing.assert_array_equal(stress_form(of("G_0")).strain, pure_shear(2))
    assert stress_form(of("G_0")).squared and not stress_form(of("S_xy")).squared
    assert stress_form(PenalisedModulus(of("G_0"))) is None and stress_form(of("C_xxyy")) is None


def test_weights_of_the_tensor():
    C = np.array([[3.0, 1.0, 0.2], [1.0, 4.0, 0.3], [0.2, 0.3, 1.5]])
    expected = {"C_xxyy": 1.0, "C_xyxy": 1.5, "B_0": (3 + 4 + 2 * 1) / 4, "G_0": 1.5}
    assert {name: np.sum(tensor_weights(of(name), 2) * C) for name in expected} == pytest.approx(expected)
    with pytest.raises(InputError, match="not linear in the elasticity tensor"):
        tensor_weights(of("V_L"), 2)
