"""Evaluations of objectives: each belongs to its stress, for any later evaluation."""

import numpy as np
from problems import dense_bond_vectors, random_stress

from critflow import CriticalManifold, voronoi_network
from critflow.critical.derivatives import evaluate
from critflow.critical.quantity import named_objective

NETWORK = voronoi_network(40, seed=1)
GOAL = named_objective(NETWORK, "bulk_modulus")
SIGMAS = [random_stress(NETWORK.n_edges, seed) for seed in range(3)]
DIRECTION = np.random.default_rng(4).standard_normal(NETWORK.n_edges)


def test_an_evaluation_is_that_of_its_stress():
    found = evaluate(CriticalManifold(NETWORK), GOAL, SIGMAS[0])
    L = dense_bond_vectors(NETWORK, SIGMAS[0])
    np.testing.assert_allclose(found.balance.bond_vectors, L, rtol=0, atol=1e-11)
    assert abs(found.value - GOAL.evaluate(SIGMAS[0], L)[0]) < 1e-12
    # The objective does not change with the scale of the stress.
    assert abs(found.gradient @ SIGMAS[0]) < 1e-12


def test_products_do_not_depend_on_what_was_evaluated_last():
    manifold = CriticalManifold(NETWORK)
    found = [evaluate(manifold, GOAL, sigma) for sigma in SIGMAS]
    for sigma, evaluation in zip(SIGMAS, found, strict=True):
        alone = evaluate(CriticalManifold(NETWORK), GOAL, sigma)
        np.testing.assert_array_equal(evaluation.hessian_product(DIRECTION), alone.hessian_product(DIRECTION))


def test_operators_of_one_manifold_stay_valid_together():
    manifold = CriticalManifold(NETWORK)
    configurations = [manifold.configuration(sigma) for sigma in SIGMAS]
    operators = [manifold.response(configuration) for configuration in configurations]
    for configuration, operator in zip(configurations, operators, strict=True):
        alone = CriticalManifold(NETWORK).response(configuration)
        np.testing.assert_array_equal(operator @ DIRECTION, alone @ DIRECTION)
