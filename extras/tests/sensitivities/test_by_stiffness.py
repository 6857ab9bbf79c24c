"""Derivatives by stiffness of the quantities of the scene, and of classes of users."""

import numpy as np
import pytest
from quantity_checks import KINDS, MANIFOLDS
from stiffness_checks import Unknown, assert_derivatives_by_stiffness

from critflow import quantity
from critflow.quantities import PenalisedModulus, TransitionModulus, pure_shear
from critflow_extras import properties
from critflow_extras.sensitivities.gradients import by_stiffness

NAMES = ("B_0", "G_0", "V_L", "V_tau", "modulus[uniaxial]")


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("kind", KINDS)
def test_derivatives_by_stiffness(kind, name):
    assert_derivatives_by_stiffness(kind, quantity(KINDS[kind], name))


def test_derivatives_of_the_penalty():
    assert_derivatives_by_stiffness("oblique", PenalisedModulus(TransitionModulus(pure_shear(2), "G_0"), 0.2))


class Known(Unknown):
    """A quantity of a user with a formula of its own."""

    def by_stiffness(self, balance):
        return np.full(len(balance.sigma), 7.0)


def test_a_class_of_a_user_may_have_a_formula_of_its_own():
    network, critical = KINDS["oblique"], MANIFOLDS["oblique"].configuration(np.ones(KINDS["oblique"].n_edges))
    modulus = quantity(network, "B_0")
    assert (properties(critical, Known(modulus)).by_stiffness["Known"] == 7).all()
    by_differences, exact = by_stiffness(Unknown(modulus), critical), by_stiffness(modulus, critical)
    np.testing.assert_allclose(by_differences, exact, rtol=0, atol=1e-8 * np.abs(exact).max())
