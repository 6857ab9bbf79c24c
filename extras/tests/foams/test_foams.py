"""Networks of random foams: their number of vertices, their seeds, and arguments without one."""

import numpy as np
import problems
import pytest
from refusals import refused

from critflow import voronoi_network
from critflow.points import random_sequential_addition
from critflow_extras import foam_network
from critflow_extras.foams import foams
from critflow_extras.foams.foams import check_foam, count_simplices


def with_a_hole(seed):
    points = np.random.default_rng(seed).random((400, 3))
    return points[np.linalg.norm(points - 0.5, axis=1) > 0.3]


@pytest.mark.parametrize("seed", range(3))
def test_holes_are_counted_with_more_images(seed):
    points = with_a_hole(seed) - 0.5
    points -= np.floor(points)
    assert count_simplices(points) == voronoi_network(points=points).n_vertices


def test_points_of_a_hard_core_need_few_images(monkeypatch):
    points = random_sequential_addition(100, 0.87 / 100 ** (1 / 3), np.random.default_rng(0), dimension=3)
    expected = voronoi_network(points=points).n_vertices
    monkeypatch.setattr(foams, "LAYERS", None)
    assert count_simplices(points) == expected


@pytest.mark.parametrize("n_vertices", [52, 60, 100, 200])
def test_a_foam_is_the_first_tessellation_of_its_number_of_vertices(n_vertices):
    network, expected = (make(n_vertices, n_vertices % 7) for make in (foam_network, problems.foam_network))
    assert (network.n_vertices, network.n_edges) == (n_vertices, 2 * n_vertices)
    assert problems.digest(network.edges, network.offsets) == problems.digest(expected.edges, expected.offsets)
    np.testing.assert_array_equal(network.positions, expected.positions)


def test_the_graph_is_frozen():
    network, again = (foam_network(60, 1) for _ in range(2))
    np.testing.assert_array_equal(again.positions, network.positions)
    assert not np.array_equal(foam_network(60, 2).edges, network.edges)
    assert problems.digest(network.edges, network.offsets) == "ce4b7c1fd54add8a"


def test_arguments_of_large_networks_are_checked_without_making_one():
    check_foam(10**7, 0.87)


CASES = {
    "beyond any memory": (lambda: foam_network(10**9), "at most 20,000,000"),
    "few vertices": (lambda: foam_network(40), "52"),
    "not whole": (lambda: foam_network(60.5), "whole"),
    "a large hard core": (lambda: foam_network(100, hard_core=1.2), "0.902"),
    "a negative hard core": (lambda: foam_network(100, hard_core=-1.0), "positive"),
}

test_values_that_make_no_foam_are_refused = refused(CASES)
