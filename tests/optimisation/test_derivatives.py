"""Objectives as functions of log σ or σ: derivatives by differences, and points that own their state."""

import warnings

import numpy as np
import pytest
from derivatives import assert_derivative
from problems import PERIODIC_KINDS, at, dense_bond_vectors, random_stress

from critflow import CriticalManifold, InputError, Quantity, Status, optimize, voronoi_network
from critflow.descent import Descent, SignedDescent
from critflow.optima import objective_of
from critflow.quantities import LengthVariance, TensionVariance


@pytest.mark.parametrize(
    "chart, goal_name",
    [*((Descent, name) for name in ("V_L", "V_tau", "B_0", "G_0")), (SignedDescent, "G_0")],
)
@pytest.mark.parametrize("kind", PERIODIC_KINDS)
def test_derivatives_by_the_unknowns_are_those_of_differences(kind, chart, goal_name):
    network, signed = PERIODIC_KINDS[kind](), chart is SignedDescent
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
    objective = Descent(CriticalManifold(voronoi_network(100, seed=1)), LengthVariance())
    x = np.log(np.abs(np.random.default_rng(1).standard_normal(150)))
    np.testing.assert_allclose(objective.sigma(x + 500), objective.sigma(x), rtol=1e-12)
    assert abs(objective.at(x).gradient.sum()) < 1e-14


class Own(Quantity):
    """The tension variance of a user, by `evaluate` alone."""

    def tensions(self, sigma, L):
        return sigma * np.sqrt((L * L).sum(axis=1))

    def evaluate(self, balance):
        sigma, L = balance.sigma, balance.bond_vectors
        tension = self.tensions(sigma, L)
        mean = tension.mean()
        deviation = tension - mean
        variance = (deviation**2).mean() / mean**2
        by_tension = 2 / (len(sigma) * mean**2) * (deviation - variance * mean)
        return variance, (by_tension * tension / sigma, (by_tension * sigma**2 / tension)[:, None] * L)


class Norm(Own):
    """Takes complex numbers, without their derivative."""

    def tensions(self, sigma, L):
        return sigma * np.linalg.norm(L, axis=1)


class Hidden(Own):
    """Loses a derivative in a term that vanishes at equal stresses."""

    def tensions(self, sigma, L):
        exact = super().tensions(sigma, L)
        return exact + (sigma - 1) * (np.linalg.norm(L, axis=1) - exact / sigma)


class Cast(Own):
    """Casts to floats, with a warning of NumPy."""

    def tensions(self, sigma, L):
        return super().tensions(sigma, L).astype(float)


class Filled(Own):
    """Fills an array of floats, which refuses complex numbers."""

    def tensions(self, sigma, L):
        return np.array([float(tension) for tension in super().tensions(sigma, L).tolist()])


def products(goal):
    manifold = CriticalManifold(voronoi_network(40, seed=1))
    x, direction = np.log(random_stress(60, 1)), np.random.default_rng(3).standard_normal(60)
    objective = Descent(manifold, goal)
    return objective.hessian_product(objective.at(x), direction)


def test_a_quantity_by_evaluate_alone_has_newtons_method():
    expected = products(TensionVariance())
    np.testing.assert_allclose(products(Own()), expected, rtol=0, atol=1e-13 * np.abs(expected).max())
    network = voronoi_network(40, seed=1)
    found = optimize(network, Own(), "newton")
    assert found.objective == pytest.approx(optimize(network, "V_tau", "newton").objective, rel=1e-13)


@pytest.mark.parametrize("action", ["error", "ignore"])
@pytest.mark.parametrize("goal", [Norm(), Hidden(), Cast(), Filled()], ids=lambda goal: goal.name)
def test_a_quantity_that_is_not_analytic_has_differences(goal, action):
    network = voronoi_network(40, seed=1)
    with warnings.catch_warnings(action=action):
        expected = products(TensionVariance())
        np.testing.assert_allclose(products(goal), expected, rtol=0, atol=1e-8 * np.abs(expected).max())
        with pytest.raises(InputError, match=r"write np\.sqrt\(\(L\*L\)\.sum\(axis=1\)\)"):
            optimize(network, goal, "newton")
        found = [optimize(network, goal, method) for method in ("auto", "lbfgs")]
    assert [one.status for one in found] == [Status.ok] * 2 and found[1].saddles == 0
    assert found[0].objective == pytest.approx(optimize(network, "V_tau").objective, rel=1e-13)


class Wrong(Own):
    """The tension variance with something wrong in `evaluate`."""

    def __init__(self, changed):
        self.changed = changed

    def evaluate(self, balance):
        return self.changed(balance.sigma, *super().evaluate(balance))


def one_more(by_sigma):
    by_sigma[17] *= 1.3
    return by_sigma


WRONG = {
    "without ∂O/∂σ": lambda sigma, value, by: (value, (0 * by[0], by[1])),
    "∂O/∂L of half the size": lambda sigma, value, by: (value, (by[0], 0.5 * by[1])),
    "one edge": lambda sigma, value, by: (value, (one_more(by[0]), by[1])),
    "the scale of σ": lambda sigma, value, by: (
        value * sigma.mean(),
        (by[0] * sigma.mean() + value / len(sigma), by[1] * sigma.mean()),
    ),
}
WORDS = {"one edge": "of edge 17 is", "the scale of σ": "at 2σ"}


@pytest.mark.parametrize("wrong", WRONG)
def test_wrong_derivatives_and_values_are_refused(wrong):
    with pytest.raises(InputError, match=f"^Wrong.evaluate .*{WORDS.get(wrong, 'dO/dσ of edge')}"):
        optimize(voronoi_network(40, seed=1), Wrong(WRONG[wrong]))


def test_a_value_with_a_jump_or_noise_is_not_refused_for_its_derivatives():
    """Differences that do not agree with each other decide nothing."""
    rng = np.random.default_rng(1)
    noisy = Wrong(lambda sigma, value, by: (value * (1 + 1e-7 * rng.random()), by))
    assert optimize(voronoi_network(40, seed=1), noisy, max_steps=1, throw=False).status is Status.step_limit


@pytest.mark.parametrize("method, hint", [("lbfgs", True), ("auto", False)])
def test_no_reason_suggests_the_method_that_was_used(method, hint):
    ended = optimize(voronoi_network(40, seed=1), "V_tau", method, max_steps=1, throw=False)
    assert ended.status is Status.step_limit and ("choose method='auto'" in ended.reason) is hint
