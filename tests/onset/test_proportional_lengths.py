"""Newton's method to lengths in given ratios."""

import numpy as np
import pytest

from critflow import critical_from_lengths, voronoi_network
from critflow.linalg.saddle import Saddle
from critflow.onset.proportional_lengths import newton_error, polish
from critflow.solvers.cone import fit_lengths

NETWORK = voronoi_network(100, seed=1)


def lengths(spread: float, seed: int = 0, n_edges: int = 150) -> np.ndarray:
    return 1 + spread * np.random.default_rng(seed).standard_normal(n_edges)


def test_polishing_converges_quadratically():
    target = lengths(0.1, 4)
    cone = fit_lengths(NETWORK.free_incidence, NETWORK.boundary_vectors, target, tolerance=1e-8)
    start = NETWORK.all_coordinates(cone.coordinates)
    x, sigma, error, steps = polish(Saddle(NETWORK), NETWORK, target, start, cone.sigma)
    assert error < 1e-13
    assert 1 <= steps <= 3
    np.testing.assert_allclose(np.linalg.norm(NETWORK.bond_vectors(x), axis=1) / target, cone.ratio, rtol=1e-6)
    assert (sigma > 0).all()


@pytest.mark.parametrize("spread", [0.0, 0.05, 0.1])
def test_newton_goes_on_where_the_cone_program_is_rough(spread):
    # Without the border the steps stall where R only nearly has a left null vector: in seven of eight such networks.
    for seed in range(3):
        network = voronoi_network(1000, seed=seed)
        target = np.exp(lengths(spread, seed, network.n_edges) - 1)
        cone = fit_lengths(network.free_incidence, network.boundary_vectors, target, tolerance=1e-6)
        start = network.all_coordinates(cone.coordinates)
        L = network.bond_vectors(start)
        assert np.ptp(np.linalg.norm(L, axis=1) / target) > 1e-4 * cone.ratio
        x, sigma, error, steps = polish(Saddle(network), network, target, start, cone.sigma)
        assert (sigma > 0).all()
        assert error < 1e-13
        assert steps <= 6
        exact = critical_from_lengths(network, target)
        apart = np.abs(network.bond_vectors(x) - exact.value.bond_vectors).max()
        assert apart < 5 * np.finfo(float).eps * np.abs(x).max() + exact.stats.error_bound


@pytest.mark.parametrize("size", [1e-6, 1e-9])
def test_the_newton_error_is_the_distance_from_the_solution(size):
    target = lengths(0.1, 4)
    exact = critical_from_lengths(NETWORK, target).value
    moved = exact.coordinates.copy()
    moved[1:] += size * np.random.default_rng(2).standard_normal((99, 2))
    error = newton_error(Saddle(NETWORK), NETWORK, target, moved, exact.sigma)
    # One step of Newton's method is exact to first order in the displacement.
    assert error == pytest.approx(np.abs(moved - exact.coordinates).max(), rel=1e3 * size + 1e-5)
