"""Random networks: definition, statistics and reproducibility."""

import hashlib

import numpy as np
import pytest
from problems import voronoi_3d

from critflow import (
    InputError,
    foam_network,
    honeycomb_network,
    mikado_network,
    random_sequential_addition,
    voronoi_network,
    voronoi_of,
)
from critflow.generators.random_networks import check_foam, check_voronoi


def digest(*arrays: np.ndarray) -> str:
    """Hash of every bit of the arrays."""
    bits = [array.astype("<i8" if array.dtype.kind == "i" else "<f8").tobytes() for array in arrays]
    return hashlib.sha256(b"".join(bits)).hexdigest()[:16]


@pytest.mark.parametrize("n_vertices, seed", [(12, 1), (40, 2), (100, 3), (1000, 4)])
def test_standard_network(n_vertices, seed):
    network = voronoi_network(n_vertices, seed=seed)
    assert (network.n_vertices, network.n_edges) == (n_vertices, 3 * n_vertices // 2)
    np.testing.assert_array_equal(np.bincount(network.edges.ravel()), np.full(n_vertices, 3))
    assert network.volume == pytest.approx(n_vertices, rel=1e-14)
    assert network.faces.n_faces == n_vertices // 2
    fraction = network.positions @ np.linalg.inv(network.cell)
    assert fraction.min() >= 0 and fraction.max() < 1
    # Mean edge length O(1): 6 edges a face of area 2 give (2/√3)^(1/2)·... ≈ 0.88 for hexagons.
    assert 0.6 < np.linalg.norm(network.bond_vectors(network.positions), axis=1).mean() < 1.0


def test_vertices_are_equidistant_from_three_centres():
    # The definition of a Voronoi vertex: its three nearest centres are equidistant.
    points = random_sequential_addition(30, 0.12, np.random.default_rng(1))
    network = voronoi_of(points, side=1.0)
    step = network.positions[:, None] - points[None]
    images = np.array([[i, j] for i in (-1, 0, 1) for j in (-1, 0, 1)])
    distance = np.linalg.norm(step[:, :, None] - images, axis=3).reshape(len(network.positions), -1)
    nearest = np.sort(distance, axis=1)
    np.testing.assert_allclose(nearest[:, 2], nearest[:, 0], rtol=1e-10)
    assert (nearest[:, 3] > nearest[:, 2] * (1 + 1e-9)).all()


def test_edges_lie_on_the_bisector_of_two_centres():
    points = random_sequential_addition(30, 0.12, np.random.default_rng(2))
    network = voronoi_of(points, side=1.0)
    middle = network.positions[network.edges[:, 0]] + 0.5 * network.bond_vectors(network.positions)
    images = np.array([[i, j] for i in (-2, -1, 0, 1, 2) for j in (-2, -1, 0, 1, 2)])
    distance = np.sort(
        np.linalg.norm(middle[:, None, None] - points[None, :, None] - images, axis=3).reshape(len(middle), -1), axis=1
    )
    np.testing.assert_allclose(distance[:, 1], distance[:, 0], rtol=1e-10)


def test_three_dimensional_voronoi():
    network = voronoi_3d()
    np.testing.assert_array_equal(np.bincount(network.edges.ravel()), np.full(network.n_vertices, 4))
    assert network.n_edges == 2 * network.n_vertices
    assert network.volume == pytest.approx(network.n_vertices, rel=1e-14)
    # Euler for a tessellation of the 3-torus: N_v − N_e + N_f − N_c = 0; every edge borders three faces.
    L = network.bond_vectors(network.positions)
    assert np.linalg.norm(L, axis=1).min() > 0


def test_same_seed_same_network():
    first, second = voronoi_network(100, seed=5), voronoi_network(100, seed=5)
    for name in ("edges", "offsets", "positions", "cell"):
        np.testing.assert_array_equal(getattr(first, name), getattr(second, name))
    other = voronoi_network(100, seed=6)
    assert not np.array_equal(first.positions, other.positions)


def test_generator_is_advanced():
    rng = np.random.default_rng(5)
    assert not np.array_equal(voronoi_network(40, seed=rng).positions, voronoi_network(40, seed=rng).positions)


def test_network_of_seed_one_is_frozen():
    # A change of these numbers changes every stored result: topology exactly, positions to rounding.
    network = voronoi_network(40, seed=1)
    assert digest(network.edges, network.offsets) == "9a76d55c25d53adf"
    np.testing.assert_allclose(
        network.positions[[0, 39]],
        [[0.6195094517945733, 1.4681486733039535], [0.42160539154920795, 5.51305491897013]],
        rtol=1e-12,
    )


@pytest.mark.parametrize(
    "n_vertices, seed, graph, faces, total",
    [
        (100, 8, "8e9e6f7fc0567d70", "226a9f23c93d50a5", 1011.4394327245155),
        (3162, 1, "4f797870627a0bb7", "dc29408ea6b673c0", 177326.29975171637),
    ],
)
def test_graphs_and_faces_are_frozen(n_vertices, seed, graph, faces, total):
    network = voronoi_network(n_vertices, seed)
    assert digest(network.edges, network.offsets) == graph
    assert digest(network.faces.edges, network.faces.signs, network.faces.starts) == faces
    assert network.positions.sum() == pytest.approx(total, rel=1e-12)


def test_global_generator_is_unchanged():
    before = np.random.get_state()[1].copy()  # noqa: NPY002 the state under test
    voronoi_network(40, seed=1)
    np.testing.assert_array_equal(np.random.get_state()[1], before)  # noqa: NPY002


@pytest.mark.parametrize("n_vertices, seed", [(52, 1), (100, 2), (200, 3)])
def test_foam(n_vertices, seed):
    network = foam_network(n_vertices, seed)
    assert (network.n_vertices, network.n_edges, network.dimension) == (n_vertices, 2 * n_vertices, 3)
    np.testing.assert_array_equal(np.bincount(network.edges.ravel()), np.full(n_vertices, 4))
    np.testing.assert_allclose(network.cell, n_vertices ** (1 / 3) * np.eye(3), rtol=1e-14)
    fraction = network.positions @ np.linalg.inv(network.cell)
    assert fraction.min() >= 0 and fraction.max() < 1
    # Space-filling truncated octahedra with one vertex per unit of volume have edges of length 0.79.
    assert 0.7 < np.linalg.norm(network.bond_vectors(network.positions), axis=1).mean() < 0.9


def test_foam_vertices_are_equidistant_from_four_centres():
    # Every vertex is a circumcentre: its four nearest centres are equidistant.
    points = random_sequential_addition(20, 0.87 / 20 ** (1 / 3), np.random.default_rng(4), dimension=3)
    network = voronoi_of(points, side=1.0)
    images = np.array([[i, j, k] for i in (-1, 0, 1) for j in (-1, 0, 1) for k in (-1, 0, 1)])
    step = network.positions[:, None, None] - points[None, :, None] - images
    nearest = np.sort(np.linalg.norm(step, axis=3).reshape(network.n_vertices, -1), axis=1)
    np.testing.assert_allclose(nearest[:, 3], nearest[:, 0], rtol=1e-9)
    assert (nearest[:, 4] > nearest[:, 3]).all()


def test_foam_of_seed_one_is_frozen():
    network = foam_network(60, seed=1)
    assert digest(network.edges, network.offsets) == "ce4b7c1fd54add8a"
    np.testing.assert_array_equal(foam_network(60, seed=1).positions, network.positions)
    assert not np.array_equal(foam_network(60, seed=2).edges, network.edges)


@pytest.mark.parametrize(
    "words, message",
    [
        ({"n_vertices": 40}, "52"),
        ({"n_vertices": 60.5}, "whole"),
        ({"n_vertices": 100, "hard_core": 1.2}, "0.902"),
        ({"n_vertices": 100, "hard_core": -1.0}, "positive"),
    ],
)
def test_impossible_foams_raise(words, message):
    with pytest.raises(InputError, match=message):
        foam_network(**words)


@pytest.mark.parametrize("points", [[[0.1, 0.2]], np.argwhere(np.ones((4, 4))) / 4 + 0.1], ids=["one", "lattice"])
def test_degenerate_points_raise(points):
    with pytest.raises(InputError, match="lattice"):
        voronoi_of(np.asarray(points))


@pytest.mark.parametrize(
    "make",
    [
        lambda: voronoi_network(10**9),
        lambda: foam_network(10**9),
        lambda: honeycomb_network(10**5, 10**5),
        lambda: mikado_network(10**9),
        lambda: random_sequential_addition(10**9, 1e-5, np.random.default_rng(0)),
    ],
    ids=["voronoi", "foam", "lattice", "mikado", "points"],
)
def test_sizes_beyond_any_memory_are_refused_before_they_are_allocated(make):
    with pytest.raises(InputError, match="at most 20,000,000"):
        make()


def test_arguments_are_checked_without_a_network():
    check_voronoi(10**7, 0.82)
    check_foam(10**7, 0.87)
    for check, words, message in (
        (check_voronoi, (61,), "even"),
        (check_voronoi, (60, 1.2), "hard core"),
        (check_foam, (40,), "52"),
    ):
        with pytest.raises(InputError, match=message):
            check(*words)
