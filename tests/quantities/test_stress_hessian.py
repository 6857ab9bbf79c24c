"""The Hessian of objectives over stress, and the flat directions at the largest bulk modulus."""

import numpy as np
import pytest
from problems import NETWORKS, modulus_by_formula, random_stress, with_random_stiffness

from critflow import (
    CriticalManifold,
    InputError,
    flat_directions,
    honeycomb_network,
    isogonal_modes,
    stress_hessian,
    voronoi_network,
)
from critflow.critical.derivatives import evaluate
from critflow.critical.quantity import named_objective


@pytest.mark.parametrize("objective", ["bulk_modulus", "shear_modulus", "length_variance", "tension_variance"])
@pytest.mark.parametrize("name", ["voronoi, random stiffness", "voronoi 3D", "own images"])
def test_hessian_is_the_derivative_of_the_gradient(name, objective):
    network = NETWORKS[name]()
    manifold = CriticalManifold(network)
    goal = named_objective(network, objective, threshold=0.3)
    critical = manifold.configuration(random_stress(network.n_edges, 1))

    def gradient(sigma):
        return evaluate(manifold, goal, sigma).gradient

    operator = stress_hessian(critical, goal)
    direction, h = np.random.default_rng(2).standard_normal(network.n_edges), 1e-5
    slope = (gradient(critical.sigma + h * direction) - gradient(critical.sigma - h * direction)) / (2 * h)
    np.testing.assert_allclose(operator @ direction, slope, rtol=0, atol=1e-7 * max(1.0, np.abs(slope).max()))
    H = operator @ np.eye(network.n_edges)
    np.testing.assert_allclose(H, H.T, rtol=0, atol=1e-13 * np.abs(H).max())
    # Objectives do not depend on the scale of σ, so their gradients scale as 1/σ (Euler).
    np.testing.assert_allclose(
        operator @ critical.sigma, -gradient(critical.sigma), rtol=0, atol=1e-12 * np.abs(H).max()
    )


def test_hessian_is_the_second_derivative_of_the_value():
    network = NETWORKS["voronoi, random stiffness"]()
    manifold = CriticalManifold(network)
    critical = manifold.configuration(random_stress(60, 1))
    direction = 0.1 * np.random.default_rng(2).standard_normal(60)

    def value(t):
        there = manifold.configuration(critical.sigma + t * direction)
        return modulus_by_formula(network, there.sigma, there.bond_vectors, np.eye(2) / 2)

    curvature = direction @ (stress_hessian(critical) @ direction)
    h = 1e-2
    assert (value(h) - 2 * value(0) + value(-h)) / h**2 == pytest.approx(curvature, rel=1e-3)


@pytest.mark.parametrize(("n_vertices", "seed"), [(60, 1), (80, 2), (100, 3)])
def test_flat_directions_of_the_largest_bulk_modulus(n_vertices, seed):
    network = with_random_stiffness(voronoi_network(n_vertices, seed=seed), seed)
    best = CriticalManifold(network).configuration(network.stiffness)
    modes = isogonal_modes(best)
    # The same at another maximiser, displaced by a random isogonal mode.
    step = np.random.default_rng(seed).standard_normal(len(modes.elongations))
    shrink = (-(step @ modes.elongations) / best.lengths).max()
    for critical in (best, modes.walk(0.5 / shrink * step)):
        flat = flat_directions(critical)
        assert flat.n_flat == n_vertices // 2
        assert flat.gap[0] < 1e-12 and flat.gap[1] > 1e-3
        # No positive curvature at a maximum.
        assert flat.eigenvalues[-1] < 1e-12 * abs(flat.eigenvalues[0])
        # At constant tension σ|L| an elongation e changes σ by −σ e/|L|.
        elongations = isogonal_modes(critical).elongations
        expected = np.concatenate([critical.sigma[None], -critical.sigma * elongations / critical.lengths])
        assert np.linalg.matrix_rank(expected) == n_vertices // 2
        outside = expected - (expected @ flat.directions.T) @ flat.directions
        assert np.abs(outside).max() < 1e-10 * np.abs(expected).max()


def test_flat_directions_of_a_honeycomb():
    network = honeycomb_network(4, 3)
    flat = flat_directions(CriticalManifold(network).configuration(network.stiffness))
    assert flat.n_flat == network.n_vertices // 2


def test_no_flat_directions_below_the_maximum():
    network = voronoi_network(60, seed=1)
    flat = flat_directions(CriticalManifold(network).configuration(random_stress(90, 1)))
    assert flat.n_flat == 0
    assert flat.eigenvalues[0] < 0 < flat.eigenvalues[-1]


def test_large_networks_raise():
    network = honeycomb_network(30, 24)
    critical = CriticalManifold(network).configuration(np.ones(network.n_edges))
    with pytest.raises(InputError, match="2000"):
        flat_directions(critical)
    # Products with vectors have no limit of size.
    assert np.abs(stress_hessian(critical) @ critical.sigma).max() < 1e-12
