"""Pruning: an edge is kept exactly when positive stresses give it a length."""

import numpy as np
import pytest
from fuzzing import answers_or_explains
from problems import pinned_grid, square_octagon
from random_graphs import random_graph
from random_problems import numbers
from refusals import refused

from critflow import CriticalManifold, lattice
from critflow.checks import blocks, opened_edges
from critflow.result import NetworkError
from critflow_extras import pruned
from critflow_extras.pruning.pruning import carrying_part

CELL = square_octagon().cell


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


@pytest.mark.parametrize("image, carries", [(0, True), (-1, False)])
def test_a_chain_between_pins_that_are_one_place_of_the_cell_carries_nothing(image, carries):
    pins = {0: [0.2, 0.2], 1: [1.2, 0.2]}
    chain = {"edges": [[0, 2], [2, 1]], "offsets": [[0, 0], [image, 0]], "cell": np.eye(2), "pins": pins}
    if carries:
        assert pruned(chain.pop("edges"), **chain).network.n_edges == 2
    else:
        with pytest.raises(NetworkError, match="no edge can carry"):
            pruned(chain.pop("edges"), **chain)


def test_the_edges_of_no_block_that_collapses_are_kept():
    rng = np.random.default_rng(3)
    for _ in range(150):
        graph = edges, offsets, cell, pins, n_vertices = random_graph(rng)
        collapsed = ~opened_edges(*blocks(*graph))
        part = carrying_part(edges, offsets, pins, n_vertices, cell)
        assert not collapsed[part.edges].any()
        assert len(part.edges) + part.separate == (~collapsed).sum()
        assert part.bridges + part.closed == collapsed.sum()


CASES = {
    "arguments of another": (lambda: pruned(lattice("honeycomb", 2, 2), cell=np.eye(2)), "cell"),
    "numbers": (lambda: pruned(square_octagon(), np.arange(6)), "mask"),
    "nothing": (lambda: pruned(square_octagon(), np.zeros(6, bool)), "tension"),
    "a tree": (lambda: pruned([[0, 1], [1, 2]], cell=CELL), "tension"),
    "edges not whole": (lambda: pruned([[0, 0.5]], cell=CELL), "whole"),
    "no boundary": (lambda: pruned([[0, 1]]), "cell"),
}

test_bad_input_raises_one_sentence = refused(CASES)

test_answers_or_explains = answers_or_explains(
    {"pruned": lambda p, r: pruned(p.network, numbers(r, len(p.sigma)) < 0.5)}
)
