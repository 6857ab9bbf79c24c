"""Random regular networks: equal degrees, short edges, and nothing that carries no tension."""

import numpy as np
import pytest

from critflow_extras import pruned, regular_network
from critflow_extras.graphs.regular_networks import _Graph


@pytest.mark.parametrize(
    "z, dimension, degrees", [(3, 2, {3: 120}), (4, 2, {4: 120}), (3.5, 2, {3: 60, 4: 60}), (4.0, 3, {4: 120})]
)
def test_degrees(z, dimension, degrees):
    network = regular_network(120, z, seed=3, dimension=dimension)
    found = np.unique(np.bincount(network.edges.ravel()), return_counts=True)
    assert dict(zip(*found, strict=True)) == degrees
    assert "every edge" in pruned(network).network.note
    assert network.volume == pytest.approx(120)
    # No longer than the distance at which a point has 3 ⌈z⌉ neighbours.
    lengths = np.linalg.norm(network.bond_vectors(network.positions), axis=1)
    ball = np.pi if dimension == 2 else 4 / 3 * np.pi
    assert 0.7 <= lengths.min()
    assert lengths.max() <= (3 * np.ceil(z) / ball) ** (1 / dimension)
    rows = np.column_stack([network.edges, network.offsets])
    assert len(np.unique(rows, axis=0)) == network.n_edges
    np.testing.assert_array_equal(regular_network(120, z, seed=3, dimension=dimension).edges, network.edges)
    assert not np.array_equal(regular_network(120, z, seed=4, dimension=dimension).edges, network.edges)


def test_bridges_are_exchanged(monkeypatch):
    exchanged = []
    exchange = _Graph.exchange
    monkeypatch.setattr(_Graph, "exchange", lambda graph, *edges: exchanged.append(edges) or exchange(graph, *edges))
    network = regular_network(100, 3, seed=206)
    assert len(exchanged) == 2
    np.testing.assert_array_equal(np.bincount(network.edges.ravel()), np.full(100, 3))
    assert "every edge" in pruned(network).network.note
