"""Networks of fibres: straight lines, two at a vertex, with the requested coordination."""

import numpy as np
import pytest

from critflow import CriticalManifold, mikado_network, phantom_network, prune

MAKE = {
    "phantom": lambda z=3.4, seed=1: phantom_network(12, 10, z=z, seed=seed),
    "mikado": lambda z=3.4, seed=1: mikado_network(120, z=z, seed=seed),
}


@pytest.mark.parametrize("make", MAKE.values(), ids=MAKE)
@pytest.mark.parametrize("z", [3.3, 3.6])
def test_coordination(make, z):
    network = make(z)
    assert abs(2 * network.n_edges / network.n_vertices - z) <= 1 / network.n_vertices + 1e-12
    assert np.bincount(network.edges.ravel()).max() <= 4
    assert "every edge" in prune(network).network.note
    assert f"z = {2 * network.n_edges / network.n_vertices:.6g}" in network.note
    again, other = make(z), make(z, seed=2)
    np.testing.assert_array_equal(network.edges, again.edges)
    assert network.edges.shape != other.edges.shape or not np.array_equal(network.edges, other.edges)
    L = network.bond_vectors(network.positions)
    np.testing.assert_allclose(network.stiffness, 1 / np.linalg.norm(L, axis=1), rtol=1e-13)


def straight_pairs(network):
    """Number of pairs of edges at a vertex that leave it in opposite directions."""
    L = network.bond_vectors(network.positions)
    L /= np.linalg.norm(L, axis=1)[:, None]
    vertex = network.edges.ravel()
    out = np.stack([L, -L], axis=1).reshape(-1, 2)
    opposite = np.linalg.norm(out[:, None] + out[None], axis=2) < 1e-9
    return int(np.sum(opposite & (vertex[:, None] == vertex[None])) // 2)


def test_fibres_are_straight():
    # At a vertex with n edges, n − 2 pairs of edges continue each other, or more where one fibre ends.
    for make in MAKE.values():
        network = make()
        degree = np.bincount(network.edges.ravel())
        assert np.sum(np.maximum(degree - 2, 0)) <= straight_pairs(network) <= np.sum(degree // 2)


def test_phantom_lattice():
    network = phantom_network(9, 8, z=4.0, seed=3)
    np.testing.assert_array_equal(np.bincount(network.edges.ravel()), np.full(72, 4))
    assert straight_pairs(network) == 2 * 72
    # Straight fibres balance at equal tension, which is a stress of 1/length.
    L = network.bond_vectors(network.positions)
    lengths = np.linalg.norm(L, axis=1)
    np.testing.assert_allclose(lengths, np.round(lengths), atol=1e-12)
    assert lengths.max() > 1.5
    critical = CriticalManifold(network).configuration(1 / lengths)
    np.testing.assert_allclose(critical.bond_vectors, L, atol=1e-12)
    # Every fibre is as long as its closed line in the lattice: all lines together have three edges a vertex.
    assert lengths.sum() == pytest.approx(3 * 72)


def test_mikado_edges_meet_at_vertices_only():
    network = mikado_network(60, z=3.2, seed=5)
    assert network.volume == pytest.approx(network.n_vertices)
    # Faces of edges that cross are refused.  Euler's formula on the torus holds for faces that are discs.
    assert network.n_vertices - network.n_edges + network.faces.n_faces == 0
