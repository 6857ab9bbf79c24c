"""Objectives as functions of log σ or σ: derivatives by Taylor remainders, and points that own their state."""

import numpy as np
import pytest
from problems import OBJECTIVES, ORDER, PERIODIC_KINDS, at, dense_bond_vectors, random_stress, taylor_orders

from critflow import CriticalManifold, InputError, Quantity, Status, optimize, voronoi_network
from critflow.critical.transition import pure_shear, transition_modulus
from critflow.critical.variances import LengthVariance, TensionVariance
from critflow.design.optimize import objective_of
from critflow.design.stress_objective import SignedStressObjective, StressObjective


@pytest.mark.parametrize("goal_name", OBJECTIVES)
@pytest.mark.parametrize("name", PERIODIC_KINDS)
def test_derivatives_in_log_stress_by_taylor_remainders(name, goal_name):
    network = PERIODIC_KINDS[name]()
    goal = objective_of(network, goal_name)
    objective = StressObjective(CriticalManifold(network), goal)
    x = np.log(random_stress(network.n_edges, 5))
    # So long that the smallest cubic remainder still stands a hundred times above the rounding of the value.
    size = 0.1 if goal_name == "G_0" else 0.4  # its barrier is steep
    direction = size * np.random.default_rng(17).standard_normal(network.n_edges)

    def function(theta):
        sigma = np.exp(theta)
        value = goal.evaluate(at(network, sigma, dense_bond_vectors(network, sigma)))[0]
        return -value if goal.maximise else value

    point = objective.at(x)
    product = objective.hessian_product(point, direction)
    assert point.value == pytest.approx(function(x), rel=1e-11)
    assert taylor_orders(function, x, direction, point.gradient, product) == pytest.approx([2, 3], abs=ORDER)


def test_the_value_does_not_depend_on_the_scale():
    objective = StressObjective(CriticalManifold(voronoi_network(100, seed=1)), LengthVariance())
    x = np.log(np.abs(np.random.default_rng(1).standard_normal(150)))
    np.testing.assert_allclose(objective.sigma(x + 500), objective.sigma(x), rtol=1e-12)
    assert abs(objective.at(x).gradient.sum()) < 1e-14


def test_derivatives_in_signed_stress_by_taylor_remainders():
    network = voronoi_network(40, seed=1)
    goal = transition_modulus(network, pure_shear(2))
    objective = SignedStressObjective(CriticalManifold(network), goal)
    rng = np.random.default_rng(8)
    # Not scaled to Σσ² = N_b, and with compressed edges; P stays far from singular.
    x = 3.0 * (0.5 + rng.random(network.n_edges))
    x[::9] *= -0.1
    x = objective.unknowns(x)
    direction = 0.5 * rng.standard_normal(network.n_edges)

    def function(sigma):
        return -goal.evaluate(at(network, sigma, dense_bond_vectors(network, sigma)))[0]

    point = objective.at(x)
    product = objective.hessian_product(point, direction)
    assert taylor_orders(function, x, direction, point.gradient, product) == pytest.approx([2, 3], abs=ORDER)
    # The value does not depend on the scale, so the gradient is orthogonal to σ and ∝ 1/|σ|.
    assert point.gradient @ x == pytest.approx(0, abs=1e-13)
    np.testing.assert_allclose(objective.hessian_product(objective.at(x), x), -point.gradient, rtol=0, atol=1e-12)


class FirstOrder(Quantity):
    """The tension variance, without its differential."""

    def evaluate(self, balance):
        return TensionVariance().evaluate(balance)


def test_without_a_differential_products_are_differences():
    manifold = CriticalManifold(voronoi_network(40, seed=1))
    x, direction = np.log(random_stress(60, 1)), np.random.default_rng(3).standard_normal(60)
    products = []
    for goal in (TensionVariance(), FirstOrder()):
        objective = StressObjective(manifold, goal)
        products.append(objective.hessian_product(objective.at(x), direction))
    np.testing.assert_allclose(products[1], products[0], rtol=0, atol=1e-8 * np.abs(products[0]).max())


def test_a_differential_is_optional_but_for_newtons_method():
    network = voronoi_network(40, seed=1)
    expected = optimize(network, "tension_variance", "lbfgs")
    for method in ("auto", "lbfgs"):
        found = optimize(network, FirstOrder(), method)
        assert found.status is Status.ok
        assert found.objective == expected.objective
    assert found.saddles == 0
    with pytest.raises(InputError, match=r"FirstOrder\.differential"):
        optimize(network, FirstOrder(), "newton")
