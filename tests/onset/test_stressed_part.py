"""The stressed part of a network: released edges, and the component of a stress that balances."""

import numpy as np
import pytest
from problems import dense_free, random_stress

from critflow import CriticalManifold, Network, critical_from_lengths, voronoi_network
from critflow.linalg.matrices import balanced_part
from critflow.onset.stressed_part import polish_stressed, unknown_configuration

NETWORK = voronoi_network(40, seed=1)
MANIFOLD = CriticalManifold(NETWORK)
CRITICAL = MANIFOLD.configuration(random_stress(60, 1))


def test_all_edges_stressed_is_the_configuration_itself():
    found = polish_stressed(
        MANIFOLD, CRITICAL.lengths, np.ones(60, bool), CRITICAL.coordinates, CRITICAL.sigma, rounds=1
    )
    assert found.stressed.all()
    assert found.error < 1e-13
    np.testing.assert_allclose(found.value.sigma, CRITICAL.sigma, rtol=1e-10)
    np.testing.assert_allclose(found.value.bond_vectors, CRITICAL.bond_vectors, rtol=0, atol=1e-11)


@pytest.mark.parametrize("edge", [3, 20])
def test_an_edge_that_cannot_be_stressed_is_released(edge):
    # Without one edge the others still have a self-stress; its target length is half as long again as its distance.
    kept = np.ones(60, bool)
    kept[edge] = False
    part, vertices = NETWORK.part(kept)
    critical = CriticalManifold(part).configuration(random_stress(59, 2))
    sigma, coordinates = np.full(60, 1e-8), np.zeros((40, 2))
    sigma[kept], coordinates[vertices] = critical.sigma, critical.coordinates
    lengths = np.linalg.norm(NETWORK.bond_vectors(coordinates), axis=1)
    lengths[edge] *= 1.5
    found = polish_stressed(MANIFOLD, lengths, np.ones(60, bool), coordinates, sigma, rounds=8)
    assert found.error < 1e-12
    np.testing.assert_array_equal(found.stressed, kept)
    assert found.value.sigma[edge] == 0
    assert found.value.residual < 1e-12


def test_no_attempt_is_an_infinite_error():
    found = polish_stressed(
        MANIFOLD, CRITICAL.lengths, np.ones(60, bool), CRITICAL.coordinates, CRITICAL.sigma, rounds=0
    )
    assert found.error == np.inf
    assert np.isnan(found.value.coordinates).all()
    assert np.isnan(unknown_configuration(NETWORK).lengths).all()


def test_the_balanced_part_of_a_stress_is_the_self_stress():
    L = CRITICAL.bond_vectors
    g, _ = dense_free(NETWORK)
    # The self-stress and the projection on it, by dense algebra.
    equilibrium = np.concatenate([g.T @ np.diag(L[:, axis]) for axis in range(2)])
    null = np.linalg.svd(equilibrium)[2][-1]
    sigma = CRITICAL.sigma + 1e-3 * np.random.default_rng(1).standard_normal(60)
    found = balanced_part(NETWORK, L, sigma, MANIFOLD.hessian)
    np.testing.assert_allclose(found, (sigma @ null) * null, rtol=0, atol=1e-9)
    force = g.T @ (found[:, None] * L)
    assert np.abs(force).max() < 1e-12


@pytest.mark.parametrize("method", ["conic", "auto"])
def test_a_pin_outside_the_stressed_part_leaves_it_in_place(method):
    # Two cables, twice as long as needed, from a pin far from the origin to a network that is periodic.
    inner = voronoi_network(12, seed=1)
    network = Network(
        np.concatenate([inner.edges, [[12, 2], [12, 7]]]),
        np.concatenate([inner.offsets, np.zeros((2, 2), int)]),
        inner.cell,
        pins={12: (300.0, 400.0)},
    )
    rest = np.append(np.ones(inner.n_edges), [6.0, 6.0])
    found = critical_from_lengths(network, rest, method, throw=False)
    np.testing.assert_array_equal(found.slack_edges, [18, 19])
    strain = found.value.lengths / rest
    assert strain[18:].max() < strain[:18].max()
