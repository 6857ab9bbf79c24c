"""Cone programs of lengths: optimality, multipliers, slack."""

import numpy as np
import pytest

from critflow import CriticalManifold, Network, voronoi_network
from critflow.cones import fit_lengths

NETWORK = voronoi_network(100, seed=1)


def lengths(spread: float, seed: int) -> np.ndarray:
    return 1 + spread * np.random.default_rng(seed).standard_normal(150)


def test_no_other_configuration_has_a_smaller_largest_ratio():
    # The cone program minimises max |L|/ℓ; neighbours of its answer on the manifold all have more.
    target = lengths(0.1, 4)
    cone = fit_lengths(NETWORK.free_incidence, NETWORK.boundary_vectors, target, tolerance=1e-12)
    assert cone.solved
    assert cone.stressed.all()
    rng = np.random.default_rng(1)
    manifold = CriticalManifold(NETWORK)
    for _ in range(20):
        other = manifold.configuration(cone.sigma * np.exp(0.1 * rng.standard_normal(150)))
        assert np.max(other.lengths / target) > cone.ratio * (1 - 1e-8)


def test_slack_edges_that_collapse_have_no_stress():
    # A taut chain 0-2-1 between pins; the slack bridge 3-4 between two equal longer chains closes by symmetry.
    network = Network([[0, 2], [2, 1], [0, 3], [3, 1], [0, 4], [4, 1], [3, 4]], pins={0: [0, 0], 1: [4, 0]})
    lengths = np.array([1.0, 1, 2, 2, 2, 2, 1])
    solution = fit_lengths(network.free_incidence, network.boundary_vectors, lengths, 1e-12)
    assert solution.ratio == pytest.approx(2.0, abs=1e-9)
    assert solution.stressed.tolist() == [True] * 2 + [False] * 5
    assert np.isfinite(solution.sigma).all()
