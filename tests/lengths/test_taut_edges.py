"""Newton's method on taut edges: lengths in given ratios, released edges, and the distance from the solution."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp
from problems import dense_free, random_stress

from critflow import CriticalConfiguration, CriticalManifold, Network, critical_from_lengths, voronoi_network
from critflow.cones import fit_lengths
from critflow.lengths import newton_error
from critflow.numerics import norms
from critflow.saddles import Saddle
from critflow.sparse import balanced_part, block_laplacian
from critflow.taut_edges import Boundary, OnsetState, _shortening, newton_taut, placed, polish_taut, taut_part

NETWORK = voronoi_network(40, seed=1)
CRITICAL = CriticalManifold(NETWORK).configuration(random_stress(60, 1))


def scaling(network):
    """The path of a common factor of all lengths."""
    return Boundary(CriticalManifold(network))


def all_taut(network, coordinates, sigma):
    return OnsetState(0.0, np.zeros(0), coordinates[network.free], sigma, np.ones(network.n_edges, bool))


@pytest.mark.parametrize(
    "n_vertices, spread, tolerance, most", [(100, 0.1, 1e-8, 4), (1000, 0, 1e-6, 7), (1000, 0.1, 1e-6, 7)]
)
def test_newton_converges_quadratically_from_a_cone_program(n_vertices, spread, tolerance, most):
    # Without the border the steps stall where R only nearly has a left null vector: in seven of eight such networks.
    network = voronoi_network(n_vertices, seed=1)
    target = np.exp(spread * np.random.default_rng(1).standard_normal(network.n_edges))
    cone = fit_lengths(network.free_incidence, network.boundary_vectors, target, tolerance)
    target *= cone.ratio
    start, path = all_taut(network, network.all_coordinates(cone.coordinates), cone.sigma), scaling(network)
    assert np.abs(np.linalg.norm(start.bond_vectors(path), axis=1) / target - 1).max() > 1e3 * tolerance**2
    end = newton_taut(path, target, start)
    assert end.error < 1e-13 and end.steps <= most and (end.sigma > 0).all()
    exact = critical_from_lengths(network, target)
    apart = np.abs(end.bond_vectors(path) / (1 + end.strain) - exact.value.bond_vectors).max()
    assert apart < 10 * np.finfo(float).eps * np.abs(end.coordinates).max() + exact.stats.error_bound


@pytest.mark.parametrize("size", [1e-6, 1e-9])
def test_the_newton_error_is_the_distance_from_the_solution(size):
    target = 1 + 0.1 * np.random.default_rng(4).standard_normal(60)
    exact = critical_from_lengths(NETWORK, target).value
    path, moved = scaling(NETWORK), exact.coordinates.copy()
    moved[1:] += size * np.random.default_rng(2).standard_normal((39, 2))
    near = CriticalConfiguration(NETWORK, exact.sigma, moved, NETWORK.bond_vectors(moved))
    # The method at another scale of the coordinates and of the stress.
    begin = replace(all_taut(NETWORK, exact.coordinates, 7 * exact.sigma), strain=0.125)
    begin = replace(begin, coordinates=1.125 * begin.coordinates)
    end = newton_taut(path, 1.125 * exact.lengths, begin)
    error = newton_error(path.manifold, target, near, end)
    # One step of Newton's method is exact to first order in the displacement.
    assert error == pytest.approx(np.abs(moved - exact.coordinates).max(), rel=1e3 * size + 1e-5)


@pytest.mark.parametrize("edge", [3, 20])
def test_an_edge_that_cannot_be_stressed_is_released(edge):
    # Without one edge the others still have a self-stress; its target length is half as long again as its distance.
    kept = np.arange(60) != edge
    part, vertices = NETWORK.part(kept)
    critical = CriticalManifold(part).configuration(random_stress(59, 2))
    sigma, coordinates = np.full(60, 1e-8), np.zeros((40, 2))
    sigma[kept], coordinates[vertices] = critical.sigma, critical.coordinates
    lengths = np.linalg.norm(NETWORK.bond_vectors(coordinates), axis=1)
    lengths[edge] *= 1.5
    found = polish_taut(scaling(NETWORK), lengths, all_taut(NETWORK, coordinates, sigma))
    assert found.error < 1e-12
    np.testing.assert_array_equal(found.taut, kept)
    np.testing.assert_allclose(found.sigma[kept] / found.sigma[kept].mean(), critical.sigma / critical.sigma.mean())


def test_the_balanced_part_of_a_stress_is_the_self_stress():
    L = CRITICAL.bond_vectors
    g, _ = dense_free(NETWORK)
    # The self-stress and the projection on it, by dense algebra.
    null = np.linalg.svd(np.concatenate([g.T @ np.diag(L[:, axis]) for axis in range(2)]))[2][-1]
    sigma = CRITICAL.sigma + 1e-3 * np.random.default_rng(1).standard_normal(60)
    found = balanced_part(NETWORK, L, sigma, block_laplacian(NETWORK))
    np.testing.assert_allclose(found, (sigma @ null) * null, rtol=0, atol=1e-9)
    assert np.abs(g.T @ (found[:, None] * L)).max() < 1e-12


def test_slack_vertices_are_placed_where_no_edge_is_long(units):
    # A slack chain of three edges beside a taut one between pins: straight, all edges have 4/9 of their lengths.
    chain = Network([[0, 1], [0, 2], [2, 3], [3, 1]], pins={0: [0, 0], 1: [4 * units.length, 0]})
    lengths, taut = units.length * np.array([4.0, 2, 3, 4]), np.array([True, False, False, False])
    x = units.length * np.array([[0, 10.0], [4, 10]])
    found = placed(chain, taut, lengths, chain.bond_vectors(chain.all_coordinates(x)), x, 1e-9)
    ratios = np.linalg.norm(chain.bond_vectors(chain.all_coordinates(found)), axis=1) / lengths
    assert (ratios[1:] <= 0.5 * (1 + 4 / 9) * (1 + 1e-9)).all()


@pytest.mark.parametrize("ratio, length", [(1.5, 1.5), (0.5, 0.75)])
def test_edges_that_are_too_long_are_shortened_by_the_least_motion(ratio, length):
    # The end of an edge moves along it, half the way to a ratio of one, or to a ratio above; short edges do not count.
    one = _shortening(sp.csr_array([[1.0]]), np.array([[3.0, 0]]), np.ones(1), ratio)
    np.testing.assert_allclose(one, [[length - 3, 0]], rtol=1e-12, atol=1e-15)
    two = _shortening(sp.csr_array([[1.0], [1.0]]), np.array([[0, -0.1], [0, 3.0]]), np.array([9.0, 1]), ratio)
    np.testing.assert_allclose(two, [[0, length - 3]], rtol=1e-12, atol=1e-15)


def test_a_pin_outside_the_stressed_part_leaves_it_in_place():
    # Two cables, twice as long as needed, from a pin far from the origin to a network that is periodic.
    inner = voronoi_network(12, seed=1)
    edges = np.concatenate([inner.edges, [[12, 2], [12, 7]]])
    offsets = np.concatenate([inner.offsets, np.zeros((2, 2), int)])
    network = Network(edges, offsets, inner.cell, pins={12: (300.0, 400.0)})
    rest = np.append(np.ones(inner.n_edges), [6.0, 6.0])
    found = critical_from_lengths(network, rest, throw=False)
    np.testing.assert_array_equal(found.slack_edges, [18, 19])
    strain = found.value.lengths / rest
    assert strain[18:].max() < strain[:18].max()


def test_the_error_of_a_state_does_not_depend_on_the_unit_of_its_stress_or_lengths():
    rng, found = np.random.default_rng(2), []
    moved = CRITICAL.coordinates + 1e-3 * rng.standard_normal(CRITICAL.coordinates.shape)
    moved[0] = CRITICAL.coordinates[0]
    right = np.linalg.norm(NETWORK.bond_vectors(moved), axis=1)
    for length, stress in ((1.0, 1.0), (2.0**-30, 1.0), (2.0**30, 1.0), (1.0, 2.0**-40), (1.0, 2.0**40)):
        path = scaling(NETWORK.deformed(length * np.eye(2)))
        state = all_taut(path.network, length * moved, stress * CRITICAL.sigma)
        part = taut_part(path, state.taut)
        found.append([part.equations(path, length * lengths, state)[0] for lengths in (CRITICAL.lengths, right)])
    # With wrong lengths, and with the right ones, where only forces are left.
    np.testing.assert_allclose(found, [found[0]] * 5, rtol=1e-9)
    force = NETWORK.divergence @ (CRITICAL.sigma[:, None] * NETWORK.bond_vectors(moved))
    assert found[0][1] == pytest.approx(np.abs(force).max() / np.mean(CRITICAL.sigma * right), rel=1e-9)


def test_the_newton_error_is_unknown_far_from_the_end():
    target = 1 + 0.1 * np.random.default_rng(4).standard_normal(60)
    path, exact = scaling(NETWORK), critical_from_lengths(NETWORK, target)
    end = newton_taut(path, exact.value.lengths, all_taut(NETWORK, exact.value.coordinates, exact.value.sigma))
    rough = replace(end, factor_error=1e-2)
    assert newton_error(path.manifold, target, exact.value, end) < exact.stats.error_bound
    assert np.isnan(newton_error(path.manifold, target, exact.value, rough))


@pytest.mark.parametrize("size, seed, power", [(12, 3, 6), (16, 0, 6), (16, 0, 8), (24, 6, 7)])
def test_the_error_is_known_where_one_edge_is_far_shorter_than_the_others(size, seed, power):
    """The short edge turns in the last step, so that the matrix of that step does not give the error."""
    network = voronoi_network(size, seed=seed)
    target = np.where(np.arange(network.n_edges) == 7 * seed % network.n_edges, 10.0**-power, 1.0)
    found = critical_from_lengths(network, target)
    lengths = norms(found.value.bond_vectors) / target
    assert 0 < found.stats.error_bound < 1e-14
    assert np.ptp(lengths) * 10.0**-power < 1e-14 * lengths.mean()


def test_a_factor_serves_again_where_a_step_reaches_rounding(monkeypatch):
    made, factorize = [], Saddle.factorize
    monkeypatch.setattr(Saddle, "factorize", lambda *args: made.append(1) or factorize(*args))
    network = voronoi_network(200, seed=1)
    cone = fit_lengths(network.free_incidence, network.boundary_vectors, np.ones(300), 1e-6)
    start = all_taut(network, network.all_coordinates(cone.coordinates), cone.sigma)
    end = newton_taut(scaling(network), np.full(300, cone.ratio), start)
    assert end.error < 1e-13 and len(made) < end.steps
