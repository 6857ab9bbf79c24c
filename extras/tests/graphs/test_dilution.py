"""Diluted networks: the coordination is reached, nothing loose is left, and the seed decides."""

import numpy as np
import pytest
from problems import pinned_grid, random_stress

from critflow import CriticalManifold, lattice
from critflow_extras import diluted, pruned

PARENTS = {
    "triangular": (lambda: lattice("triangular", 12, 9), (3.0, 3.9, 5.5)),
    "kagome": (lambda: lattice("kagome", 6, 6), (2.8, 3.6)),
    "honeycomb": (lambda: lattice("honeycomb", 8, 8), (2.6, 2.95)),
    "diamond": (lambda: lattice("diamond", 4, 4, 4), (2.9, 3.8)),
}
CASES = [(name, z) for name, (_, values) in PARENTS.items() for z in values]


@pytest.mark.parametrize("name, z", CASES)
def test_coordination(name, z):
    whole = PARENTS[name][0]()
    network = diluted(whole, z, seed=2)
    assert abs(2 * network.n_edges / network.n_vertices - z) <= 1 / network.n_vertices
    assert "every edge" in pruned(network).network.note
    np.testing.assert_allclose(np.linalg.norm(network.bond_vectors(network.positions), axis=1), 1, rtol=1e-12)
    found = CriticalManifold(network).configuration(random_stress(network.n_edges, 1))
    assert found.lengths.min() > 1e-6


def test_the_seed_decides():
    whole = lattice("triangular", 8, 8)
    first, again, other = (diluted(whole, 4.0, seed) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first.edges, again.edges)
    assert first.n_vertices != other.n_vertices or not np.array_equal(first.edges, other.edges)


def test_the_coordination_of_the_whole_keeps_the_whole():
    whole = lattice("kagome", 3, 3)
    assert diluted(whole, 4.0).n_edges == whole.n_edges


def test_pins_stay():
    whole = pinned_grid()
    network = diluted(whole, 2 * whole.n_edges / whole.n_vertices - 0.2, seed=1)
    assert set(map(tuple, network.pins.values())) <= set(map(tuple, whole.pins.values()))
    assert network.n_edges < whole.n_edges
