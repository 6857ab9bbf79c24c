"""Networks of fibres: straight lines, two at a vertex, with the requested coordination."""

import numpy as np
import pytest

from critflow import elasticity
from critflow_extras import critical_strain, fibre_network, pruned

networkx = pytest.importorskip("networkx")

MAKE = {
    "phantom": lambda z=3.4, seed=1: fibre_network("phantom", 18, 15, z=z, seed=seed),
    "mikado": lambda z=3.4, seed=1: fibre_network("mikado", 120, z=z, seed=seed),
}


@pytest.mark.parametrize("make", MAKE.values(), ids=MAKE)
@pytest.mark.parametrize("z", [3.3, 3.6])
def test_coordination(make, z):
    network = make(z)
    assert abs(2 * network.n_edges / network.n_vertices - z) <= 1 / network.n_vertices + 1e-12
    assert np.bincount(network.edges.ravel()).max() <= 4
    assert "every edge" in pruned(network).network.note
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
    network = fibre_network("phantom", 9, 8, seed=3)
    # Of two edges a vertex, one is cut of each of the 8 + 9 + 1 closed lines of the lattice, which have no end.
    assert network.n_edges == 2 * 72 - 18
    L = network.bond_vectors(network.positions)
    lengths = np.linalg.norm(L, axis=1)
    np.testing.assert_allclose(lengths, np.round(lengths), atol=1e-12)
    assert lengths.max() > 1.5
    for angle in (0, 60, 120):
        along = np.abs(L @ [np.sin(np.deg2rad(angle)), -np.cos(np.deg2rad(angle))]) < 1e-9
        fibres = networkx.MultiGraph(network.edges[along].tolist())
        assert networkx.is_forest(fibres) and along.sum() > 20
    # In the third direction there are as many lines as the greatest common divisor.
    assert fibre_network("phantom", 20, 15, seed=2).n_edges == 2 * 300 - (20 + 15 + 5)


@pytest.mark.parametrize("seed", range(3))
def test_phantom_networks_are_floppy_below_their_onset(seed):
    network = fibre_network("phantom", 16, 16, z=3.2, seed=seed)
    assert elasticity(network, network.positions).value.bulk == 0
    onset = critical_strain(network, np.linalg.norm(network.bond_vectors(network.positions), axis=1), "dilation")
    assert onset.ok and 0.01 < onset.value.strain < 1


def test_mikado_crossings_by_brute_force():
    network = fibre_network("mikado", 60, z=3.2, seed=5)
    assert network.volume == pytest.approx(network.n_vertices)
    # Planar, and so every crossing of two edges is a vertex: no two edges cross inside.
    L, x = network.bond_vectors(network.positions), network.positions
    tail, side = x[network.edges[:, 0]], network.cell[0, 0]
    for image in np.ndindex(3, 3):
        start = tail + side * (np.array(image) - 1)
        apart = start[None] - tail[:, None]
        turn = L[:, None, 0] * L[None, :, 1] - L[:, None, 1] * L[None, :, 0]
        with np.errstate(divide="ignore", invalid="ignore"):
            s = (apart[..., 0] * L[None, :, 1] - apart[..., 1] * L[None, :, 0]) / turn
            t = (apart[..., 0] * L[:, None, 1] - apart[..., 1] * L[:, None, 0]) / turn
        crosses = (s > 1e-9) & (s < 1 - 1e-9) & (t > 1e-9) & (t < 1 - 1e-9) & (np.abs(turn) > 1e-12)
        assert not crosses.any()
    # Euler's formula on the torus holds for faces that are discs.
    assert network.n_vertices - network.n_edges + network.faces.n_faces == 0
