"""Pictures: every edge is drawn once, whole and in its cell, in any units."""

import matplotlib
import numpy as np
import pytest
from matplotlib.figure import Figure
from problems import NETWORKS, critical_of, oblique, random_stress, sheared, slack_lattice
from scipy.spatial import cKDTree
from units import same_in_units

from critflow import CriticalManifold, lattice, voronoi_network
from critflow.pictures import (
    draw_network,
    face_polygons,
    images_in_cell,
    periodic_segments,
    shade_faces,
    unit_pressure_tensions,
)


def sorted_rows(pieces):
    flat = np.round(pieces.reshape(len(pieces), -1), 9) + 0.0
    return flat[np.lexsort(flat.T)]


def test_lines_have_an_image_for_each_border_that_they_cross():
    inside, crossing = [[0.2, 0.3], [0.6, 0.5]], [[0.8, 0.5], [1.3, 0.6]]
    pieces, lines = images_in_cell(np.array([inside, crossing]))
    np.testing.assert_array_equal(np.sort(lines), [0, 1, 1])
    expected = [inside, crossing, np.array(crossing) - [1, 0]]
    np.testing.assert_allclose(sorted_rows(pieces), sorted_rows(np.array(expected)))


@pytest.mark.parametrize("dimension", [2, 3])
def test_images_do_not_depend_on_the_one_given(dimension):
    rng = np.random.default_rng(1)
    starts = rng.random((30, 1, dimension))
    ends = np.concatenate([starts, starts + rng.uniform(-1.4, 1.4, (30, 1, dimension))], axis=1)
    here = images_in_cell(ends)
    there = images_in_cell(ends + rng.integers(-3, 4, (30, 1, dimension)))
    np.testing.assert_allclose(sorted_rows(here[0]), sorted_rows(there[0]), atol=1e-8)
    np.testing.assert_array_equal(np.bincount(here[1]), np.bincount(there[1]))
    # Each piece meets the cell, and together they cover each line as often as its length has it.
    along = np.linspace(0, 1, 2001)[:, None, None]
    points = here[0][:, 0] + along * (here[0][:, 1] - here[0][:, 0])
    inside = ((points > 0) & (points < 1)).all(axis=2).mean(axis=0)
    np.testing.assert_allclose(np.bincount(here[1], inside), 1, atol=5e-3)


matplotlib.use("Agg")

CASES = {
    "voronoi": lambda: voronoi_network(40, seed=1),
    "oblique": lambda: oblique(voronoi_network(40, seed=2)),
    "sheared": lambda: sheared(voronoi_network(40, seed=3), 0.7),
    "edges longer than the cell": lambda: voronoi_network(8, seed=3),
    "honeycomb": lambda: lattice("honeycomb", 3, 2),
}


def configuration(name, spread=1.0):
    network = CASES[name]()
    return CriticalManifold(network).configuration(random_stress(network.n_edges, 1) ** spread)


def of_network(network):
    return network.edges, network.offsets, network.cell


def clipped_length(ends: np.ndarray, cell: np.ndarray) -> float:
    """Length of the part of a segment (2, 2) that lies in the cell, by Liang and Barsky's clipping."""
    start, end = ends @ np.linalg.inv(cell)
    low, high = 0.0, 1.0
    for s, step in zip(start, end - start, strict=True):
        if abs(step) < 1e-14:
            if not 0 <= s <= 1:
                return 0.0
            continue
        a, b = sorted(((0 - s) / step, (1 - s) / step))
        low, high = max(low, a), min(high, b)
    return max(0.0, high - low) * float(np.linalg.norm(ends[1] - ends[0]))


@pytest.mark.parametrize("moved", [0.0, 13.37], ids=["as it is", "far from the origin"])
@pytest.mark.parametrize("name", CASES)
def test_periodic_images_cover_every_edge(name, moved):
    critical = configuration(name)
    network = critical.network
    segments, edge = periodic_segments(*of_network(network), critical.coordinates + moved)
    # Every image is a shifted copy of the edge.
    np.testing.assert_allclose(segments[:, 1] - segments[:, 0], critical.bond_vectors[edge], rtol=0, atol=1e-11)
    drawn = np.zeros(network.n_edges)
    for ends, owner in zip(segments, edge, strict=True):
        drawn[owner] += clipped_length(ends, network.cell)
    np.testing.assert_allclose(drawn, critical.lengths, rtol=1e-10)
    # None is drawn twice, and none outside the cell.
    keys = np.round(np.column_stack([edge, segments[:, 0]]), 8)
    assert len(np.unique(keys, axis=0)) == len(keys)
    fraction = segments @ np.linalg.inv(network.cell)
    assert (fraction.max(axis=1) > 0).all() and (fraction.min(axis=1) < 1).all()


def test_edges_along_the_border_are_drawn_once():
    network = lattice("kagome", 3, 3)
    _, edge = periodic_segments(*of_network(network), network.positions)
    np.testing.assert_array_equal(np.sort(edge), np.arange(network.n_edges))


def test_tensions_at_unit_pressure():
    critical = configuration("voronoi")
    tension = unit_pressure_tensions(critical.sigma, critical.lengths, critical.network.volume)
    # Pressure by the virial: Σ τ|L|/(2V).
    assert np.sum(tension * critical.lengths) / (2 * 40) == pytest.approx(1, rel=1e-13)
    ratio = tension / critical.tensions
    np.testing.assert_allclose(ratio, ratio[0], rtol=1e-13)


def test_colours_follow_tensions_and_mark_compression():
    critical = configuration("voronoi")
    network = critical.network
    tensions = critical.tensions.copy()
    tensions[[3, 17]] *= -1
    axes = Figure().add_subplot()
    lines = draw_network(axes, *of_network(network), critical.coordinates, tensions, limits=(0.0, 2.0))
    _, edge = periodic_segments(*of_network(network), critical.coordinates)
    expected = tensions[edge]
    np.testing.assert_array_equal(lines.get_array(), np.sort(expected[expected >= 0]))
    assert lines.get_clim() == (0.0, 2.0)
    assert (np.diff(lines.get_linewidths()) >= 0).all()
    compressed = [c for c in axes.collections if c is not lines]
    assert [len(c.get_segments()) for c in compressed] == [np.count_nonzero(expected < 0)]
    # The edge with the largest tension is drawn last, at its position.
    strongest = critical.bond_vectors[np.argmax(tensions)]
    ends = lines.get_segments()[-1]
    np.testing.assert_allclose(ends[1] - ends[0], strongest, rtol=0, atol=1e-12)


@pytest.mark.parametrize("name", ["voronoi", "oblique", "sheared", "honeycomb"])
def test_face_polygons_follow_the_edges(name):
    critical = configuration(name)
    network = critical.network
    polygons = face_polygons(network.faces, network.edges, critical.coordinates, critical.bond_vectors)
    nexts = [np.roll(p, -1, axis=0) for p in polygons]
    sides = np.concatenate([q - p for p, q in zip(polygons, nexts, strict=True)])
    walked = network.faces.signs[:, None] * critical.bond_vectors[network.faces.edges]
    np.testing.assert_allclose(sides, walked, rtol=0, atol=1e-12)
    # Corners are vertices, up to whole cells.
    tree = cKDTree(np.mod(critical.coordinates @ np.linalg.inv(network.cell), 1.0) % 1.0, boxsize=1.0)
    corners = np.mod(np.concatenate(polygons) @ np.linalg.inv(network.cell), 1.0) % 1.0
    assert tree.query(corners)[0].max() < 1e-12


def test_shaded_faces_cover_the_cell():
    critical = configuration("oblique")
    network = critical.network
    polygons = face_polygons(
        network.faces, network.edges, critical.coordinates + np.array([3.0, -5.0]), critical.bond_vectors
    )
    axes = Figure().add_subplot()
    shading = shade_faces(axes, polygons, network.cell)
    points = np.random.default_rng(0).random((200, 2)) @ network.cell
    inside = sum(path.contains_points(points).astype(int) for path in shading.get_paths())
    np.testing.assert_array_equal(inside, 1)
    assert shading.get_clip_path() is not None


def test_slack_edges_are_drawn_grey_below_the_taut_part():
    network, _, critical = slack_lattice()
    axes = Figure().add_subplot()
    draw_network(axes, *of_network(network), critical.coordinates, critical.tensions)
    taut, compressed, slack = axes.collections
    assert len(compressed.get_segments()) == 0
    assert len(slack.get_segments()) >= np.count_nonzero(critical.sigma == 0)
    assert (np.asarray(taut.get_array()) > 0).all()
    assert slack.get_zorder() < taut.get_zorder()
    assert max(slack.get_linewidths()) < min(taut.get_linewidths()) + 0.1


def lines(network, units):
    critical = critical_of(network)
    graph = network.edges, network.offsets, network.cell
    segments, edge = periodic_segments(*graph, critical.coordinates)
    drawn = draw_network(Figure().add_subplot(), *graph, critical.coordinates, critical.tensions)
    polygons = face_polygons(network.faces, network.edges, critical.coordinates, critical.bond_vectors)
    tension = unit_pressure_tensions(critical.sigma, critical.lengths, network.volume)
    return {
        "number": (edge, drawn.get_linewidths()),
        "length": (segments, np.array(drawn.get_segments()), *drawn.get_clim(), np.concatenate(polygons), tension),
    }


test_figures_in_other_units = same_in_units(
    {name: (lines, NETWORKS[name]) for name in ("voronoi", "oblique", "sheared")}
)
