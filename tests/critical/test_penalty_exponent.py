"""The exponent and the threshold of the penalty of small stresses are stated once."""

from inspect import signature

import numpy as np
import pytest
from derivatives import assert_derivative
from problems import random_stress

from critflow import CriticalManifold, optimize, voronoi_network
from critflow import quantities as transition
from critflow.optima import objective_of
from critflow.quantities import PENALTY_THRESHOLD, PenalisedModulus, TransitionModulus, evaluate, pure_shear

NETWORK = voronoi_network(20, seed=1)


@pytest.mark.parametrize("exponent", [2, 6, 8, 10, 12])
def test_value_gradient_and_first_matrix_follow_one_exponent(exponent, monkeypatch):
    monkeypatch.setattr(transition, "PENALTY_EXPONENT", exponent)
    modulus = TransitionModulus(pure_shear(2), "G_0")
    penalised, manifold = PenalisedModulus(modulus, 0.5), CriticalManifold(NETWORK)
    sigma = random_stress(NETWORK.n_edges, 2)

    def value(s):
        return penalised.evaluate(manifold.balance(s))[0]

    here, random = evaluate(manifold.balance(sigma), penalised), np.random.default_rng(0)
    assert_derivative(value, here.gradient, sigma, random.standard_normal((2, len(sigma))), 1e-3, 1e-6)
    s = sigma * np.sqrt(len(sigma) / np.sum(sigma**2))
    powers = penalised.unit(NETWORK) * np.sum((s / 0.5) ** -float(exponent)) / len(s)
    assert modulus.evaluate(here.balance)[0] - here.value == pytest.approx(powers, rel=1e-12)
    # The second derivative by log σ at constant scale.
    first = penalised.unit(NETWORK) * exponent**2 * (s / 0.5) ** -float(exponent) / len(s)
    np.testing.assert_allclose(penalised.preconditioner(here.balance), first, rtol=1e-12)


def test_the_threshold_is_the_same_by_every_call():
    assert PenalisedModulus(TransitionModulus(pure_shear(2))).threshold == PENALTY_THRESHOLD
    for function in (optimize, objective_of):
        assert signature(function).parameters["threshold"].default == PENALTY_THRESHOLD
