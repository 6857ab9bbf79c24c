"""Random networks: definition, statistics and reproducibility."""

import numpy as np
import pytest
from problems import digest

from critflow import foam_network, voronoi_network
from critflow.points import check_foam, check_voronoi, random_sequential_addition

# Dimension and size, and limits of the mean edge length: 6 edges a face of area 2 give (2/√3)^(1/2)·... ≈ 0.88 for
# hexagons, and 0.79 for truncated octahedra, with one vertex per unit of volume.
SIZES = [(2, 12), (2, 40), (2, 100), (2, 1000), (3, 52), (3, 100), (3, 200)]
LENGTHS = {2: (0.6, 1.0), 3: (0.7, 0.9)}


@pytest.mark.parametrize("d, n_vertices", SIZES)
def test_standard_networks(d, n_vertices):
    network = (voronoi_network, foam_network)[d - 2](n_vertices, seed=n_vertices % 7)
    degree = d + 1
    assert (network.n_vertices, network.n_edges, network.dimension) == (n_vertices, degree * n_vertices // 2, d)
    np.testing.assert_array_equal(np.bincount(network.edges.ravel()), np.full(n_vertices, degree))
    np.testing.assert_allclose(network.cell, n_vertices ** (1 / d) * np.eye(d), rtol=1e-14)
    fraction = network.positions @ np.linalg.inv(network.cell)
    assert fraction.min() >= 0 and fraction.max() < 1
    assert d == 3 or network.faces.n_faces == n_vertices // 2
    low, high = LENGTHS[d]
    assert low < np.linalg.norm(network.bond_vectors(network.positions), axis=1).mean() < high


@pytest.mark.parametrize(("dimension", "n_cells"), [(2, 30), (3, 20)])
def test_vertices_are_equidistant_from_their_centres_and_edges_from_those_of_both_ends(dimension, n_cells):
    distance = (0.66, 0.87)[dimension - 2] / n_cells ** (1 / dimension)
    points = random_sequential_addition(n_cells, distance, np.random.default_rng(1), dimension)
    network = voronoi_network(points=points, cell=np.eye(dimension))
    images = np.array(list(np.ndindex(*(5,) * dimension))) - 2
    x, L = network.positions, network.bond_vectors(network.positions)

    def nearest(places):
        apart = places[:, None, None] - points[None, :, None] - images
        return np.sort(np.linalg.norm(apart, axis=3).reshape(len(places), -1), axis=1)

    for places, n in ((x, dimension + 1), (x[network.edges[:, 0]] + 0.5 * L, dimension)):
        found = nearest(places)
        np.testing.assert_allclose(found[:, n - 1], found[:, 0], rtol=1e-9)
        assert (found[:, n] > found[:, 0] * (1 + 1e-9)).all()
    assert network.n_edges == (dimension + 1) * network.n_vertices / 2 and np.linalg.norm(L, axis=1).min() > 0
    assert network.volume == pytest.approx(1)


def test_generator_is_advanced():
    rng = np.random.default_rng(5)
    assert not np.array_equal(voronoi_network(40, seed=rng).positions, voronoi_network(40, seed=rng).positions)


@pytest.mark.parametrize(
    "make, n_vertices, seed, graph, faces, total",
    [
        (foam_network, 60, 1, "ce4b7c1fd54add8a", None, None),
        (voronoi_network, 100, 8, "8e9e6f7fc0567d70", "226a9f23c93d50a5", 1011.4394327245155),
        (voronoi_network, 40, 1, "9a76d55c25d53adf", None, 255.9282192141523),
        (voronoi_network, 3162, 1, "4f797870627a0bb7", "dc29408ea6b673c0", 177326.29975171637),
    ],
)
def test_graphs_and_faces_are_frozen(make, n_vertices, seed, graph, faces, total):
    network, again = (make(n_vertices, seed) for _ in range(2))
    np.testing.assert_array_equal(again.positions, network.positions)
    assert not np.array_equal(make(n_vertices, seed + 1).edges, network.edges)
    assert digest(network.edges, network.offsets) == graph
    assert faces is None or faces == digest(network.faces.edges, network.faces.signs, network.faces.starts)
    assert total is None or network.positions.sum() == pytest.approx(total, rel=1e-12)


def test_arguments_of_large_networks_are_checked_without_making_one():
    check_voronoi(10**7, 0.82), check_foam(10**7, 0.87)
