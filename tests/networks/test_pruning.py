"""Pruning: an edge is kept exactly when positive stresses give it a length."""

import numpy as np
import pytest
from problems import dense_bond_vectors, pinned_grid, random_stress, square_octagon

from critflow import CriticalManifold, lattice, pruned
from critflow.networks.pruning import _Loose, carrying_part
from critflow.result import NetworkError


def random_graph(seed, pins=False):
    """Up to 20 edges between up to 12 vertices, some of them across the boundary; parallel edges and parts occur."""
    rng = np.random.default_rng(seed)
    edges = rng.integers(0, rng.integers(2, 13), (rng.integers(1, 21), 2))
    offsets = rng.integers(-1, 2, (len(edges), 2)) * (rng.random((len(edges), 1)) < (0.1 if pins else 0.3))
    valid = (edges[:, 0] != edges[:, 1]) | offsets.any(axis=1)
    # Two of the pins lie at the same place.
    where = {0: [0.0, 0.1], 1: [1.3, 0.2], 2: [0.0, 0.1]} if pins else {}
    edges = np.concatenate([edges[valid], [[0, 3], [1, 4], [2, 4]] if pins else [[0, 1]]])
    offsets = np.concatenate([offsets[valid], np.zeros((len(edges) - valid.sum(), 2), int)])
    edges = np.unique(edges, return_inverse=True)[1].reshape(edges.shape) if not pins else edges
    return _Loose(edges, offsets, [[2.1, 0.0], [0.4, 1.7]], pins=where)


@pytest.mark.parametrize("pins", [False, True])
def test_edges_kept_are_those_with_a_length(pins):
    removed = 0
    for seed in range(150):
        network = random_graph(seed, pins)
        L = dense_bond_vectors(network, random_stress(network.n_edges, seed))
        has_length = np.linalg.norm(L, axis=1) > 1e-9
        part = carrying_part(network.edges, network.offsets, network.pins, network.n_vertices, network.cell)
        assert has_length[part.edges].all()
        assert len(part.edges) + part.separate == has_length.sum()
        assert part.bridges + part.closed == (~has_length).sum()
        removed += part.closed
    assert removed > 50


def test_hanging_parts_are_removed():
    whole = square_octagon()
    # A path of two edges, and a triangle on a bridge.
    more = [[0, 4], [4, 5], [1, 6], [6, 7], [7, 8], [8, 6]]
    edges = np.concatenate([more, whole.edges])
    offsets = np.concatenate([np.zeros((6, 2), int), whole.offsets])
    network, kept, vertices = pruned(edges, offsets=offsets, cell=whole.cell, stiffness=np.arange(1.0, 13.0))
    np.testing.assert_array_equal(kept, np.arange(6, 12))
    np.testing.assert_array_equal(vertices, np.arange(4))
    np.testing.assert_array_equal(network.stiffness, np.arange(7.0, 13.0))
    assert "removed 6 of 12 edges" in network.note
    assert "3 on bridges" in network.note
    assert "3 in closed pieces" in network.note
    CriticalManifold(network).configuration(np.ones(6))


def test_the_largest_part_is_kept():
    small, large = square_octagon(), lattice("honeycomb", 2, 2)
    edges = np.concatenate([small.edges, large.edges + 4, [[0, 4]]])
    offsets = np.concatenate([small.offsets, large.offsets, [[0, 0]]])
    network, kept, _ = pruned(edges, offsets=offsets, cell=large.cell)
    np.testing.assert_array_equal(kept, 6 + np.arange(large.n_edges))
    assert "6 in separate pieces" in network.note


def test_a_network_without_loose_edges_stays():
    for whole in (lattice("honeycomb", 3, 2), pinned_grid()):
        network, kept, _ = pruned(whole)
        np.testing.assert_array_equal(network.edges, whole.edges)
        np.testing.assert_array_equal(network.offsets, whole.offsets)
        assert len(kept) == whole.n_edges
        assert set(network.pins) == set(whole.pins)
        assert "every edge" in network.note


def test_edges_of_a_mask_and_the_faces_of_the_part():
    whole = lattice("honeycomb", 3, 3)
    kept = np.ones(whole.n_edges, bool)
    kept[4] = False
    network, edges, _ = pruned(whole, kept)
    assert network.n_edges == whole.n_edges - 1
    assert 4 not in edges
    # Two hexagons become one face of ten sides.
    assert sorted(network.faces.sizes) == [6] * 7 + [10]
    assert network.with_stiffness(2.0).note == network.note


def test_nothing_that_winds_around_the_cell_raises():
    with pytest.raises(NetworkError, match="tension"):
        pruned([[0, 1], [1, 2], [2, 0], [2, 3]], cell=np.eye(2))


def test_a_network_takes_no_arguments_of_another():
    with pytest.raises(NetworkError, match="cell"):
        pruned(lattice("honeycomb", 2, 2), cell=np.eye(2))
