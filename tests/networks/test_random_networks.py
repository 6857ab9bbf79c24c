"""Random networks: definition, statistics and reproducibility."""

import hashlib

import numpy as np
import pytest
from problems import voronoi_3d

from critflow import InputError, foam_network, random_sequential_addition, voronoi_network, voronoi_of
from critflow.networks.random_networks import STANDARD_HARD_CORE


def digest(*arrays: np.ndarray) -> str:
    """Hash of every bit of the arrays."""
    bits = [array.astype("<i8" if array.dtype.kind == "i" else "<f8").tobytes() for array in arrays]
    return hashlib.sha256(b"".join(bits)).hexdigest()[:16]


def periodic_distances(points: np.ndarray) -> np.ndarray:
    """All pair distances in the periodic unit cube, with infinity on the diagonal."""
    step = points[:, None] - points[None]
    distance = np.linalg.norm(step - np.round(step), axis=2)
    np.fill_diagonal(distance, np.inf)
    return distance


def plain_addition(n_points: int, distance: float, rng: np.random.Generator) -> np.ndarray:
    """Random sequential addition by its definition: trials uniform in the square, rejected within the distance."""
    points: list[np.ndarray] = []
    while len(points) < n_points:
        trial = rng.random(2)
        step = np.array(points).reshape(-1, 2) - trial
        if not len(points) or np.min(np.sum((step - np.round(step)) ** 2, axis=1)) >= distance**2:
            points.append(trial)
    return np.array(points)


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


@pytest.mark.parametrize("seed", range(4))
def test_points_satisfy_the_minimum_distance(seed):
    distance = STANDARD_HARD_CORE / np.sqrt(200)
    points = random_sequential_addition(200, distance, np.random.default_rng(seed))
    assert points.shape == (200, 2)
    assert points.min() >= 0 and points.max() < 1
    assert periodic_distances(points).min() >= distance


def test_points_satisfy_the_minimum_distance_in_three_dimensions():
    points = random_sequential_addition(100, 0.15, np.random.default_rng(1), dimension=3)
    assert points.shape == (100, 3)
    assert periodic_distances(points).min() >= 0.15


@pytest.mark.parametrize("hard_core", [0.5, 0.75])
def test_fast_addition_has_the_statistics_of_plain_addition(hard_core):
    # Mean nearest-neighbour distance over independent packings of each kind; four standard errors of the difference.
    n_points, n_packings = 40, 60
    distance = hard_core / np.sqrt(n_points)
    samples = {}
    for seed, make in enumerate((random_sequential_addition, plain_addition)):
        rng = np.random.default_rng(seed)
        packings = [make(n_points, distance, rng) for _ in range(n_packings)]
        nearest = np.array([periodic_distances(p).min(axis=1) for p in packings])
        pairs = np.array([(periodic_distances(p) < 1.5 * distance).sum() / n_points for p in packings])
        samples[make] = nearest.mean(axis=1), nearest.std(axis=1), pairs
    for fast, plain in zip(samples[random_sequential_addition], samples[plain_addition], strict=True):
        error = np.sqrt((fast.var(ddof=1) + plain.var(ddof=1)) / n_packings)
        assert abs(fast.mean() - plain.mean()) < 4 * error


def test_points_are_uniform_in_the_square():
    # Fourier modes of the density vanish within four standard errors.
    rng = np.random.default_rng(3)
    packings = [random_sequential_addition(40, 0.6 / np.sqrt(40), rng) for _ in range(80)]
    for mode in ([1, 0], [0, 1], [4, 0], [0, 4], [7, 7]):
        phase = np.array([np.exp(2j * np.pi * (p @ mode)).sum() for p in packings])
        for part in (phase.real, phase.imag):
            assert abs(part.mean()) < 4 * part.std(ddof=1) / np.sqrt(len(part))


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
    "n_points, hard_core, dimension, bits",
    [
        (1, 0.5, 2, "f47cf9d290788d07"),
        (30, 0.5, 1, "aaf320150c55756e"),
        (50, 0.82, 2, "661f5a69e3c54fff"),
        (2000, 0.82, 2, "c51a118a9809e9af"),
        (2000, 0.6, 2, "0fe2484b2aabd201"),
        (100, 0.85, 3, "6acfe489e6980cce"),
    ],
)
def test_points_are_frozen(n_points, hard_core, dimension, bits):
    # Sums, products and comparisons only, so every bit is the same on every machine; so are the next random numbers.
    rng = np.random.default_rng(7)
    points = random_sequential_addition(n_points, hard_core / n_points ** (1 / dimension), rng, dimension)
    assert digest(points, rng.random(3)) == bits


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
