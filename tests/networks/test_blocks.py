"""Edges that no positive stress can open, against dense solutions of force balance."""

import numpy as np
import pytest
from random_graphs import CELL, random_graph

from critflow import CriticalManifold, Network
from critflow.checks import blocks, opened_edges
from critflow.result import NetworkError


def opened_lengths(edges, offsets, cell, pins, n, rng):
    """The largest length of every edge under three random stresses."""
    g, x = np.zeros((len(edges), n)), np.zeros((n, 2))
    np.add.at(g, (np.arange(len(edges)), edges[:, 1]), 1)
    np.add.at(g, (np.arange(len(edges)), edges[:, 0]), -1)
    x[list(pins)] = np.reshape(list(pins.values()), (-1, 2))
    b = g @ x + (0 if cell is None else offsets @ cell)
    free = np.delete(np.arange(n), list(pins) or 0)
    g, longest = g[:, free], np.zeros(len(edges))
    for sigma in rng.uniform(0.5, 2, (3, len(edges), 1)):
        L = b - g @ np.linalg.solve(g.T @ (sigma * g), g.T @ (sigma * b))
        longest = np.maximum(longest, np.linalg.norm(L, axis=1))
    return longest


def test_collapsing_edges_have_no_length_and_the_others_do():
    rng, mixed = np.random.default_rng(3), 0
    for _ in range(150):
        graph = random_graph(rng)
        collapsed = ~opened_edges(*blocks(*graph))
        np.testing.assert_array_equal(collapsed, opened_lengths(*graph, rng) < 1e-9)
        mixed += collapsed.any() and not collapsed.all()
    assert mixed > 30


def test_a_large_network_collapses_nowhere_and_a_long_branch_does():
    n = 20_000
    chain = np.stack([np.arange(n), (np.arange(n) + 1) % n], axis=1)
    offsets = np.zeros((n, 2), int)
    offsets[-1] = 1, 0
    assert opened_edges(*blocks(chain, offsets, CELL, {}, n)).all()
    # The chain of every second edge doubled, closed on itself: nothing wraps.
    doubled = np.concatenate([chain, chain[::2]])
    assert not opened_edges(*blocks(doubled, np.zeros_like(doubled), CELL, {}, n)).any()


@pytest.mark.parametrize("pins", [{0: [0.0, 0.0]}, {0: [0.5, 0.5], 1: [0.5, 0.5]}], ids=["one pin", "one place"])
def test_a_free_body_is_a_network_but_no_positive_stress_opens_it(pins):
    square = Network([[1, 2], [2, 3], [3, 0], [0, 2], [1, 3]], pins=pins)
    with pytest.raises(NetworkError, match="signed_stress"):
        CriticalManifold(square)
