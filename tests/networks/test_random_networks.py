"""Random networks: definition, statistics and reproducibility."""

import numpy as np
import pytest
from problems import digest

from critflow import (
    InputError,
    foam_network,
    honeycomb_network,
    mikado_network,
    random_sequential_addition,
    voronoi_network,
    voronoi_of,
)
from critflow.networks.random_networks import check_foam, check_voronoi


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


@pytest.mark.parametrize("dimension", [2, 3])
def test_vertices_are_equidistant_from_their_centres(dimension):
    # The definition of a Voronoi vertex: its d + 1 nearest centres are equidistant.
    points = random_sequential_addition(20, 0.15, np.random.default_rng(4), dimension)
    network = voronoi_of(points, side=1.0)
    images = np.stack(np.meshgrid(*[(-1, 0, 1)] * dimension), axis=-1).reshape(-1, dimension)
    step = network.positions[:, None, None] - points[None, :, None] - images
    nearest = np.sort(np.linalg.norm(step, axis=3).reshape(network.n_vertices, -1), axis=1)
    np.testing.assert_allclose(nearest[:, dimension], nearest[:, 0], rtol=1e-9)
    assert (nearest[:, dimension + 1] > nearest[:, dimension] * (1 + 1e-9)).all()


@pytest.mark.parametrize("make", [voronoi_network, foam_network])
def test_the_seed_decides(make):
    state = np.random.get_state()[1].copy()  # noqa: NPY002 the state under test
    first, second, rng = make(60, seed=5), make(60, seed=5), np.random.default_rng(5)
    for name in ("edges", "offsets", "positions", "cell"):
        np.testing.assert_array_equal(getattr(first, name), getattr(second, name))
    assert not np.array_equal(first.positions, make(60, seed=6).positions)
    np.testing.assert_array_equal(first.positions, make(60, seed=rng).positions)
    assert not np.array_equal(first.positions, make(60, seed=rng).positions)
    np.testing.assert_array_equal(np.random.get_state()[1], state)  # noqa: NPY002


def test_small_networks_are_frozen():
    # A change of these numbers changes every stored result: topology exactly, positions to rounding.
    network, foam = voronoi_network(40, seed=1), foam_network(60, seed=1)
    assert digest(network.edges, network.offsets) == "9a76d55c25d53adf"
    assert digest(foam.edges, foam.offsets) == "ce4b7c1fd54add8a"
    places = [[0.6195094517945733, 1.4681486733039535], [0.42160539154920795, 5.51305491897013]]
    np.testing.assert_allclose(network.positions[[0, 39]], places, rtol=1e-12)


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


@pytest.mark.parametrize(
    "check, make, n_vertices, hard_core, message",
    [
        (check_voronoi, voronoi_network, 61, 0.82, "even"),
        (check_voronoi, voronoi_network, 2, 0.82, "even"),
        (check_voronoi, voronoi_network, -10, 0.82, "even"),
        (check_voronoi, voronoi_network, 60, 1.2, "hard core"),
        (check_voronoi, voronoi_network, 60, -1.0, "positive"),
        (check_voronoi, voronoi_network, 60, np.nan, "positive"),
        (check_foam, foam_network, 40, 0.87, "52"),
        (check_foam, foam_network, 100, 1.2, "0.902"),
        (check_foam, foam_network, 100, -1.0, "positive"),
    ],
)
def test_impossible_networks_raise(check, make, n_vertices, hard_core, message):
    for function in (check, make):
        with pytest.raises(InputError, match=message):
            function(n_vertices, hard_core=hard_core)


def test_large_networks_are_checked_without_being_made():
    check_voronoi(10**7, 0.82)
    check_foam(10**7, 0.87)


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
