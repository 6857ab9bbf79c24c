"""Edges that cross in the plane: found in all images, and joined by vertices."""

import numpy as np
import pytest

from critflow import CriticalManifold, fibre_network, network_from
from critflow.extras.files.crossings import crossings_of, split
from critflow.extras.files.data import NetworkData, bond_vectors_of
from critflow.result import NetworkError

CELL = np.array([[1.5, 0.2], [0.4, 1.3]])


def random_data(seed, cell):
    rng = np.random.default_rng(seed)
    edges = rng.integers(0, 8, (6 + 6 * seed, 2))
    edges = edges[edges[:, 0] != edges[:, 1]]
    offsets = None if cell is None else rng.integers(-1, 2, edges.shape)
    numbers = {"edge_numbers": np.arange(len(edges)), "vertex_numbers": np.arange(8)}
    return NetworkData(edges, rng.random((8, 2)) * 3 - 1, cell, offsets, stiffness=np.ones(len(edges)), **numbers)


def by_pairs(data):
    """All crossings by comparison of every pair in every image."""
    L, start = bond_vectors_of(data), data.positions[data.edges[:, 0]]
    reach = range(-7, 8) if data.cell is not None else [0]
    images = np.array([[a, b] for a in reach for b in reach]) @ (np.eye(2) if data.cell is None else data.cell)
    found = []
    for i in range(len(L)):
        for j in range(i + 1, len(L)):
            system = np.stack([L[i], -L[j]], axis=1)
            if abs(np.linalg.det(system)) > 1e-12:
                parts = np.linalg.solve(system, (start[j] + images - start[i]).T)
                count = ((parts > 1e-9) & (parts < 1 - 1e-9)).all(axis=0).sum()
                found += [(i, j)] * int(count)
    return sorted(found)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("cell", [None, CELL], ids=["free", "periodic"])
def test_crossings_are_those_of_all_pairs(seed, cell):
    data = random_data(seed, cell)
    pairs, parts = crossings_of(data)
    assert sorted(map(tuple, pairs.tolist())) == by_pairs(data)
    divided = split(data, pairs, parts)
    owner = divided.edge_numbers
    assert not len(crossings_of(divided)[0])
    # Parts add up to their edge, and their springs in series to its spring.
    total = np.zeros((data.n_edges, 2))
    np.add.at(total, owner, bond_vectors_of(divided))
    np.testing.assert_allclose(total, bond_vectors_of(data), atol=1e-14)
    np.testing.assert_allclose(np.bincount(owner, 1 / divided.stiffness), 1.0)


def test_crossings_are_reported_and_joined_on_request():
    # Two diagonals of a square, through one point with a third line.
    x = [[0.0, 0.0], [2, 2], [0, 2], [2, 0], [1, 0], [1, 2]]
    source = {"edges": [[0, 1], [2, 3], [4, 5]], "positions": x, "pins": [0, 1, 2, 3, 4, 5]}
    with pytest.raises(NetworkError, match="tension"):
        network_from(**source)
    read = network_from(**source, join_crossings=True, volume="hull")
    assert "3 crossings of two edges" in str(read) and read.repaired
    assert (read.network.n_vertices, read.network.n_edges) == (7, 6)
    assert read.data.vertex_numbers.tolist() == [0, 1, 2, 3, 4, 5, -1]
    assert read.data.edge_numbers.tolist() == [0, 0, 1, 1, 2, 2]
    np.testing.assert_allclose(read.network.stiffness, 2.0)
    assert read.network.volume == 4 and "V = 4" in str(read)
    np.testing.assert_allclose(CriticalManifold(read).configuration(np.ones(6)).coordinates[6], [1, 1])
    with pytest.raises(NetworkError, match="strict"):
        network_from(**source, join_crossings=True, strict=True)


def test_fibres_cross_at_vertices_until_they_are_moved():
    fibres = fibre_network("mikado", 40, seed=1)
    L = fibres.bond_vectors(fibres.positions)
    again = network_from(fibres)
    assert "crossing" not in str(again)
    moved = fibres.positions + 0.4 * np.abs(L).mean() * np.random.default_rng(0).normal(size=fibres.positions.shape)
    assert "without a vertex" in str(network_from(fibres, positions=moved))
