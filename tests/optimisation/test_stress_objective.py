"""Objectives as functions of log σ or σ: derivatives by differences, and points that own their state."""

import numpy as np
import pytest
from derivatives import assert_derivative
from problems import PERIODIC_KINDS, at, dense_bond_vectors, random_stress

from critflow import CriticalManifold, InputError, Quantity, Status, optimize, voronoi_network
from critflow.critical.variances import LengthVariance, TensionVariance
from critflow.optimisation.descent import SignedStressObjective, StressObjective
from critflow.optimisation.optimize import objective_of


@pytest.mark.parametrize(
    "chart, goal_name",
    [*((StressObjective, name) for name in ("V_L", "V_tau", "B_0", "G_0")), (SignedStressObjective, "G_0")],
)
@pytest.mark.parametrize("kind", PERIODIC_KINDS)
def test_derivatives_by_the_unknowns_are_those_of_differences(kind, chart, goal_name):
    network, signed = PERIODIC_KINDS[kind](), chart is SignedStressObjective
    goal = objective_of(network, goal_name, None if signed else 0.1)
    objective = chart(CriticalManifold(network), goal)
    # Not scaled to Σσ² = N_b, and with compressed edges where they are allowed.
    sigma = 3 * random_stress(network.n_edges, 5)
    sigma[::6] *= -0.3 if signed else 1.0
    x, direction = objective.unknowns(sigma), 0.1 * np.random.default_rng(17).standard_normal(network.n_edges)

    def function(y):
        sigma = y if signed else np.exp(y)
        value = goal.evaluate(at(network, sigma, dense_bond_vectors(network, sigma)))[0] / goal.unit(network)
        return -value if goal.maximise else value

    point = objective.at(x)
    size = 1e-6 * np.abs(point.gradient).max()
    assert point.value == pytest.approx(function(x), rel=1e-11)
    assert_derivative(function, point.gradient, x, [direction], 1e-2, 1e-7, 0.01 * size)
    product = lambda u: objective.hessian_product(point, u)  # noqa: E731
    assert_derivative(lambda y: objective.at(y).gradient, product, x, [direction], 1e-2, 1e-6, size)
    if signed:
        # The value does not depend on the scale, so the gradient is orthogonal to σ and ∝ 1/|σ|.
        assert point.gradient @ x == pytest.approx(0, abs=1e-13)
        np.testing.assert_allclose(product(x), -point.gradient, rtol=0, atol=1e-12)


def test_the_value_does_not_depend_on_the_scale():
    objective = StressObjective(CriticalManifold(voronoi_network(100, seed=1)), LengthVariance())
    x = np.log(np.abs(np.random.default_rng(1).standard_normal(150)))
    np.testing.assert_allclose(objective.sigma(x + 500), objective.sigma(x), rtol=1e-12)
    assert abs(objective.at(x).gradient.sum()) < 1e-14


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
