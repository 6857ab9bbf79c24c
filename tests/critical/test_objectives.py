"""Objectives: values against their formulas, gradients and Hessians by Taylor remainders through the manifold."""

import numpy as np
import pytest
from problems import (
    HONEYCOMB_BULK_MODULUS,
    NETWORKS,
    ORDER,
    PERIODIC_KINDS,
    dense_bond_vectors,
    modulus_by_formula,
    random_stress,
    taylor_orders,
    with_random_stiffness,
)

from critflow import CriticalManifold, InputError, elasticity, honeycomb_network, voronoi_network
from critflow.critical.derivatives import evaluate
from critflow.critical.quantity import (
    OBJECTIVES,
    ConstrainedModulus,
    TransitionModulus,
    dilation,
    named_objective,
    pure_shear,
    transition_modulus,
)

STRESSES = {"positive": 1.0, "signed": -0.3}


def stress(network, sign):
    sigma = random_stress(network.n_edges, 5)
    sigma[::6] *= sign
    return sigma


@pytest.mark.parametrize("sign", STRESSES.values(), ids=STRESSES)
@pytest.mark.parametrize("objective", OBJECTIVES)
@pytest.mark.parametrize("name", PERIODIC_KINDS)
def test_gradient_and_hessian_by_taylor_remainders(name, objective, sign):
    network = PERIODIC_KINDS[name]()
    goal = named_objective(network, objective)
    sigma = stress(network, sign)
    direction = 0.1 * np.random.default_rng(6).standard_normal(network.n_edges)

    def function(s):
        return goal.evaluate(s, dense_bond_vectors(network, s))[0]

    found = evaluate(CriticalManifold(network), goal, sigma)
    assert found.value == pytest.approx(function(sigma), rel=1e-11)
    orders = taylor_orders(function, sigma, direction, found.gradient, found.hessian_product(direction))
    assert orders == pytest.approx([2, 3], abs=ORDER)


@pytest.mark.parametrize("objective", OBJECTIVES)
def test_wrong_gradient_fails_the_taylor_test(objective):
    network = PERIODIC_KINDS["random stiffness"]()
    goal = named_objective(network, objective)
    sigma = stress(network, 1.0)
    direction = 0.1 * np.random.default_rng(6).standard_normal(network.n_edges)
    found = evaluate(CriticalManifold(network), goal, sigma)
    gradient, product = found.gradient, found.hessian_product(direction)

    def function(s):
        return goal.evaluate(s, dense_bond_vectors(network, s))[0]

    wrong = gradient.copy()
    wrong[int(np.argmax(np.abs(gradient * direction)))] *= 1.1
    assert taylor_orders(function, sigma, direction, wrong, product)[0] < 2 - ORDER
    assert taylor_orders(function, sigma, direction, gradient, 1.1 * product)[1] < 3 - ORDER


@pytest.mark.parametrize("objective", OBJECTIVES)
@pytest.mark.parametrize("name", PERIODIC_KINDS)
def test_hessians_are_symmetric_and_objectives_scale_free(name, objective):
    network = PERIODIC_KINDS[name]()
    goal = named_objective(network, objective)
    sigma = stress(network, 1.0)
    manifold = CriticalManifold(network)
    found = evaluate(manifold, goal, sigma)
    gradient = found.gradient
    scale = np.abs(gradient).max() * sigma.max()
    assert abs(gradient @ sigma) < 1e-12 * scale * len(sigma)
    assert evaluate(manifold, goal, 7 * sigma).value == pytest.approx(found.value, rel=1e-11)
    # Scale invariance: H σ = −∇O.
    np.testing.assert_allclose(found.hessian_product(sigma), -gradient, rtol=0, atol=1e-10 * np.abs(gradient).max())
    rng = np.random.default_rng(8)
    u, v = rng.standard_normal((2, network.n_edges))
    Hu, Hv = found.hessian_product(u), found.hessian_product(v)
    assert u @ Hv == pytest.approx(v @ Hu, rel=1e-10, abs=1e-10 * np.linalg.norm(Hu) * np.linalg.norm(v))


@pytest.mark.parametrize("name", PERIODIC_KINDS)
def test_values_by_their_formulas(name):
    network = PERIODIC_KINDS[name]()
    d = network.dimension
    sigma = stress(network, 1.0)
    L = dense_bond_vectors(network, sigma)
    length = np.sqrt(np.sum(L**2, axis=1))
    tension = sigma * length
    expected = {
        "length_variance": np.mean(length**2) / np.mean(length) ** 2 - 1,
        "tension_variance": np.mean(tension**2) / np.mean(tension) ** 2 - 1,
        "bulk_modulus": modulus_by_formula(network, sigma, L, np.eye(d) / d),
    }
    A = np.zeros((d, d))
    A[0, 1] = 0.7
    A[1, 0] = 0.3
    scaled = sigma * np.sqrt(len(sigma) / np.sum(sigma**2))
    expected["shear_modulus"] = modulus_by_formula(network, sigma, L, A) - np.mean((scaled / 0.2) ** -10)
    for objective, value in expected.items():
        found = named_objective(network, objective, threshold=0.2).evaluate(sigma, L)[0]
        assert found == pytest.approx(value, rel=1e-12)


def test_bulk_and_shear_by_the_papers_formulas():
    network = with_random_stiffness(voronoi_network(60, seed=1), 3)
    configuration = CriticalManifold(network).configuration(random_stress(90, 2))
    s, L, k = configuration.sigma, configuration.bond_vectors, network.stiffness
    square = np.sum(L**2, axis=1)
    cost = np.sum(s**2 * square / k)
    moduli = elasticity(configuration).value
    assert moduli.bulk == pytest.approx(np.sum(s * square) ** 2 / cost / (4 * 60), rel=1e-13)
    assert moduli.shear == pytest.approx(np.sum(s * L[:, 0] * L[:, 1]) ** 2 / cost / 60, rel=1e-12)
    # At the transition the stress is zero, and the two conventions agree.
    assert moduli.shear_stress_corrected == moduli.shear


def test_honeycomb_moduli():
    for k in (1.0, 2.5):
        network = honeycomb_network(3, 4, edge_length=0.7).with_stiffness(k)
        moduli = elasticity(CriticalManifold(network).configuration(np.ones(36))).value
        # In two dimensions B has the unit of k, at any edge length.
        assert moduli.bulk == pytest.approx(k * HONEYCOMB_BULK_MODULUS, rel=1e-13)
        assert moduli.shear == pytest.approx(0.0, abs=1e-25)


def test_modulus_depends_on_the_symmetric_part_of_the_strain():
    network = PERIODIC_KINDS["3D"]()
    A = np.random.default_rng(1).standard_normal((3, 3))
    L, sigma = dense_bond_vectors(network, np.ones(network.n_edges)), np.ones(network.n_edges)
    one = transition_modulus(network, A).evaluate(sigma, L)[0]
    assert transition_modulus(network, 0.5 * (A + A.T)).evaluate(sigma, L)[0] == pytest.approx(one, rel=1e-13)
    assert modulus_by_formula(network, sigma, L, A) == pytest.approx(one, rel=1e-12)
    np.testing.assert_array_equal(dilation(3), np.eye(3) / 3)
    np.testing.assert_array_equal(pure_shear(2), [[0, 0.5], [0.5, 0]])


def test_barrier_rises_as_the_tenth_power():
    goal = ConstrainedModulus(TransitionModulus(pure_shear(2), np.ones(4), 1.0), threshold=0.1)
    # Stresses of mean square one, so that s = σ.
    sigma = np.array([0.05, 0.1, 1.0, 1.0])
    sigma[2:] = np.sqrt((4 - np.sum(sigma[:2] ** 2)) / 2)
    L = np.array([[1.0, 0.0]] * 4)
    expected = -(2.0**10 + 1.0 + 2 * (sigma[2] / 0.1) ** -10) / 4
    assert goal.evaluate(sigma, L)[0] == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("objective", tuple(OBJECTIVES)[:2])
def test_variances_need_no_cell(objective):
    network = NETWORKS["pinned grid"]()
    found = evaluate(CriticalManifold(network), named_objective(network, objective), np.ones(network.n_edges))
    assert found.value > 0
    assert np.isfinite(found.gradient).all()


def test_bad_objectives_raise():
    network = honeycomb_network(2, 2)
    with pytest.raises(InputError, match="length_variance"):
        named_objective(network, "bulk")
    with pytest.raises(InputError, match="threshold"):
        named_objective(network, "shear_modulus", threshold=-1.0)
    with pytest.raises(InputError, match="dimensions"):
        transition_modulus(network, np.eye(3))
