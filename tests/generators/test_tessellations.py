"""Tessellations in cells of any shape, against the definition and against other cells of the same lattice."""

from functools import partial

import numpy as np
import pytest
from units import same_in_units

from critflow import Network, delaunay_network, lattice, voronoi_network
from critflow.points import near_images, points_in_cell, random_sequential_addition, short_cell

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
    points = np.random.default_rng(3).random((40, dimension))
    network = delaunay_network(points=points, cell=cell)
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
