"""Derivatives of quantities by stiffness against differences of their values."""

import numpy as np
from derivatives import assert_derivative
from problems import at
from quantity_checks import KINDS, MANIFOLDS, stress

from critflow import Quantity
from critflow_extras.sensitivities.gradients import by_stiffness


class Unknown(Quantity):
    """A quantity without a formula of its own for these derivatives."""

    def __init__(self, goal):
        self.goal = goal

    def evaluate(self, balance):
        return self.goal.evaluate(balance)


def assert_derivatives_by_stiffness(kind, goal):
    network = KINDS[kind]
    sigma = stress(network)
    L = MANIFOLDS[kind].balance(sigma).bond_vectors
    direction = np.random.default_rng(7).standard_normal(network.n_edges)

    def value(k):
        return goal.evaluate(at(network.with_stiffness(k), sigma, L))[0]

    found = by_stiffness(goal, at(network, sigma, L))
    assert_derivative(value, found, network.stiffness, [direction], 1e-3, 1e-7, 1e-9 * np.abs(found).max() + 1e-12)
    if kind != "oblique":
        return
    # Without a formula of its own, by differences.
    general = by_stiffness(Unknown(goal), at(network, sigma, L))
    np.testing.assert_allclose(general, found, rtol=1e-6, atol=1e-8 * np.abs(found).max() + 1e-10)
