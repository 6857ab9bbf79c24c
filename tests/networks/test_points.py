"""Networks of random points: placement, tessellations in cells of any shape, statistics and reproducibility."""

from functools import partial

import numpy as np
import pytest
from problems import digest, foam_network
from units import same_in_units

from critflow import Network, delaunay_network, lattice, voronoi_network
from critflow import points as random_points
from critflow.points import (
    STANDARD_HARD_CORE,
    check_voronoi,
    near_images,
    points_in_cell,
    random_sequential_addition,
    short_cell,
)


def periodic_distances(points: np.ndarray) -> np.ndarray:
    """All pair distances in the periodic unit cube, with infinity on the diagonal."""
    step = points[:, None] - points[None]
    distance = np.linalg.norm(step - np.round(step), axis=2)
    np.fill_diagonal(distance, np.inf)
    return distance


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize(
    "n_points, distance, dimension",
    [(200, STANDARD_HARD_CORE / 200**0.5, 2), (100, 0.15, 3), (1000, 0.04 / 1000**0.5, 2)],
)
def test_points_satisfy_the_minimum_distance(n_points, distance, dimension, seed):
    points = random_sequential_addition(n_points, distance, np.random.default_rng(seed), dimension)
    assert points.shape == (n_points, dimension)
    assert points.min() >= 0 and points.max() < 1
    assert periodic_distances(points).min() >= distance


@pytest.mark.parametrize(
    "n_points, hard_core, dimension, bits",
    [
        (1, 0.5, 2, "f47cf9d290788d07"),
        (30, 0.5, 1, "aaf320150c55756e"),
        (50, 0.82, 2, "661f5a69e3c54fff"),
        (2000, 0.82, 2, "c51a118a9809e9af"),
        (2000, 0.6, 2, "0fe2484b2aabd201"),
        (50, 0.05, 2, "dbac86e5c79639bd"),
        (50, 1e-9, 2, "ffcf9e08d58e78f1"),
        (50, 1e-300, 3, "7e546f2c7640be5c"),
        (100, 0.85, 3, "6acfe489e6980cce"),
    ],
)
def test_points_are_frozen(n_points, hard_core, dimension, bits):
    # Sums, products and comparisons only, so every bit is the same on every machine; so are the next random numbers.
    rng = np.random.default_rng(7)
    points = random_sequential_addition(n_points, hard_core / n_points ** (1 / dimension), rng, dimension)
    assert digest(points, rng.random(3)) == bits


@pytest.mark.parametrize(
    "dimension, hard_core, total",
    [
        (2, 0.7, 2464.2206000330084),
        (3, 0.7, 6003.70028738539),
        (2, 0.82, 2577.0834777689943),
        (2, 1e-9, 2348.9434470093393),
    ],
)
def test_points_of_a_cell_are_frozen(dimension, hard_core, total):
    cell = np.array([[1.0, 0.1, 0.0], [0.7, 1.0, 0.2], [0.0, 0.3, 1.0]])[:dimension, :dimension]
    points = points_in_cell(60, hard_core, np.random.default_rng(4), cell)
    assert points @ np.arange(1.0, 1 + dimension) @ np.arange(60.0) == pytest.approx(total, rel=1e-12)


@pytest.mark.parametrize("cell", [np.eye(2), np.eye(3), np.array([[1.0, 0.1], [0.7, 1.0]])], ids=len)
def test_trials_in_parts_give_the_same_points(cell, monkeypatch):
    def points():
        return points_in_cell(400, 0.8, np.random.default_rng(3), cell)

    at_once = points()
    monkeypatch.setattr(random_points, "_BLOCK", 100)
    monkeypatch.setattr(random_points, "_MANY_TRIALS", 100)
    np.testing.assert_array_equal(points(), at_once)


CELLS = {
    "rectangular": [[4.0, 0.0], [0.0, 1.0]],
    "oblique": [[1.0, 0.1], [0.7, 1.0]],
    "strongly sheared": [[1.0, 0.0], [37.3, 1.0]],
}


@pytest.mark.parametrize("cell", CELLS.values(), ids=CELLS)
def test_networks_of_a_cell(cell):
    for make, degree, faces in ((voronoi_network, 3, 50), (delaunay_network, 6, 200)):
        network = make(100, seed=2, cell=cell)
        assert network.n_vertices == 100
        assert network.n_edges == degree * 50
        assert network.volume == pytest.approx(100, rel=1e-12)
        np.testing.assert_allclose(network.cell / network.cell[0, 0], np.array(cell) / cell[0][0], rtol=1e-12)
        assert network.faces.n_faces == faces
        assert np.linalg.norm(network.bond_vectors(network.positions), axis=1).max() < 3
        np.testing.assert_array_equal(make(100, seed=2, cell=cell).edges, network.edges)


def lengths(network):
    return np.sort(np.linalg.norm(network.bond_vectors(network.positions), axis=1))


@pytest.mark.parametrize("make", [voronoi_network, delaunay_network])
def test_equivalent_cells_have_the_same_tessellation(make):
    points, cell = np.random.default_rng(1).random((30, 2)), np.array([[1.3, 0.2], [0.1, 0.9]])
    change = np.array([[3, 2], [4, 3]])
    other = make(points=points @ np.linalg.inv(change) % 1, cell=change @ cell)
    np.testing.assert_allclose(lengths(other), lengths(make(points=points, cell=cell)), rtol=1e-11)


@pytest.mark.parametrize("dimension", [2, 3])
def test_delaunay_spheres_are_empty(dimension):
    # An edge of the Delaunay graph is a pair for which some sphere through both contains no other point; for pairs
    # whose own diametral sphere is empty (the Gabriel graph) it must be there.
    cell = np.array([[1.2, 0.1, 0.0], [0.3, 0.9, 0.2], [0.0, 0.2, 1.0]])[:dimension, :dimension]
    network = delaunay_network(points=np.random.default_rng(3).random((40, dimension)), cell=cell)
    edges = set(map(tuple, np.column_stack([network.edges, network.offsets])))
    x = network.positions
    ids, images = near_images(x @ np.linalg.inv(cell), cell, 0.6)
    places = x[ids] + images @ cell
    gabriel = 0
    for i in range(len(x)):
        for j, image, place in zip(ids, images, places, strict=True):
            radius = np.linalg.norm(place - x[i]) / 2
            if (i, *np.zeros(dimension)) < (j, *image) and radius < 0.2:
                distance = np.linalg.norm(places - (x[i] + place) / 2, axis=1)
                if np.sum(distance < radius * (1 - 1e-12)) == 0:
                    gabriel += 1
                    assert (i, j, *image) in edges
    assert gabriel > 60


def test_vertices_of_the_delaunay_network_are_the_points():
    points, cell = np.random.default_rng(1).random((30, 2)), np.array([[3.0, 0.2], [0.1, 4.0]])
    network = delaunay_network(points=points, cell=cell)
    np.testing.assert_allclose(network.positions, points @ cell, atol=1e-12)
    solid = delaunay_network(40, seed=1, cell=np.eye(3))
    assert (solid.n_vertices, solid.dimension) == (40, 3)
    assert solid.volume == pytest.approx(40)


def test_short_vectors_span_the_same_lattice():
    for cell in (
        [[1.0, 0.0], [1e6 + 0.3, 1.0]],
        [[5.0, 3.0], [8.0, 5.0]],
        [[1.0, 0.0], [0.5, 1.0]],  # short already, since half a vector leaves its length
        [[1, 0.4, 0.3], [7.1, 1, 3.3], [2.2, 9.4, 1]],
    ):
        short, rows = short_cell(np.array(cell))
        assert abs(np.linalg.det(rows)) == pytest.approx(1)
        np.testing.assert_allclose(short, rows @ np.array(cell))
        gram = short @ short.T
        off = np.abs(gram / np.diag(gram)) - np.eye(len(gram))
        assert off.max() <= 0.5 + 1e-6


@pytest.mark.parametrize("cell", CELLS.values(), ids=CELLS)
def test_hard_core_in_a_cell(cell):
    cell = np.array(cell)
    points = points_in_cell(60, 0.8, np.random.default_rng(4), cell)
    short, rows = short_cell(cell)
    inside = points @ np.round(np.linalg.inv(rows)) % 1.0
    ids, images = near_images(inside, short, 1.0)
    places = (inside[ids] + images) @ short
    apart = np.linalg.norm(places[:, None] - (inside @ short)[None], axis=2)
    least = np.min(apart[apart > 1e-9])
    assert least >= 0.8 * np.sqrt(abs(np.linalg.det(cell)) / 60) * (1 - 1e-12)


def test_points_of_a_square_are_those_of_no_cell():
    rng = np.random.default_rng
    points = points_in_cell(40, 0.8, rng(7), 3.0 * np.eye(2))
    np.testing.assert_array_equal(points, random_sequential_addition(40, 0.8 / np.sqrt(40), rng(7)))
    assert points_in_cell(40, 0.0, rng(1), np.eye(3)).shape == (40, 3)


def square(cell=CELLS["rectangular"]):
    return Network([[0, 1], [1, 0], [0, 1]], [[0, 0], [1, 0], [0, 1]], np.array(cell))


def shape(network):
    x = network.positions
    return {"number": (network.edges, network.offsets), "length": (network.cell, x, network.bond_vectors(x))}


POINTS = np.random.default_rng(1).random((30, 2))
LATTICES = {"honeycomb": (3, 2), "kagome": (2, 2), "diamond": (2, 2, 2)}
test_networks_in_cells_of_other_units = same_in_units(
    {
        f"{make.__name__}, {name}": (
            lambda cell, _, make=make: shape(make(points=POINTS, cell=cell.cell)),
            partial(square, cell),
        )
        for make in (voronoi_network, delaunay_network)
        for name, cell in CELLS.items()
    }
    | {
        name: (lambda _, units, name=name: shape(lattice(name, *LATTICES[name], edge_length=units.length)), square)
        for name in LATTICES
    },
    rtol=1e-12,
)


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
    check_voronoi(10**7, 0.82)
