"""Numbers of edges and faces in cut networks are those of the network given."""

import numpy as np
import pytest
from problems import random_stress

from critflow import CriticalManifold, Status, voronoi_network
from critflow.quantities import quantity
from critflow_extras import edge_leverage, prune_towards

NETWORK = voronoi_network(30, seed=3)
SIGMA = random_stress(NETWORK.n_edges, seed=4)
CRITICAL = CriticalManifold(NETWORK).configuration(SIGMA)
FACE = 4
SIDES = set(NETWORK.faces.edges[NETWORK.faces.starts[FACE] : NETWORK.faces.starts[FACE + 1]].tolist())


def cut_vectors(edges):
    """Bond vectors (N_b, 2) after cuts, NaN on the edges cut."""
    kept = np.ones(NETWORK.n_edges, bool)
    kept[edges] = False
    there = CriticalManifold(NETWORK.without_edges(edges)).configuration(SIGMA[kept])
    L = np.full((NETWORK.n_edges, 2), np.nan)
    L[kept] = there.bond_vectors
    return L


def area(L):
    """By the shoelace formula along the walk of the face in the whole network; NaN where a side is cut."""
    walk = slice(NETWORK.faces.starts[FACE], NETWORK.faces.starts[FACE + 1])
    corners = np.cumsum(NETWORK.faces.signs[walk, None] * L[NETWORK.faces.edges[walk]], axis=0)
    x, y = corners.T
    return 0.5 * np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y)


def length(edge):
    return lambda L: np.linalg.norm(L[edge])


MEASURES = {"length[0]": length(0), "length[7]": length(7), "length[44]": length(44), f"area[{FACE}]": area}


@pytest.mark.parametrize("name", MEASURES)
def test_leverage_measures_the_edge_or_face_of_the_whole(name):
    found = edge_leverage(CRITICAL, name)
    assert found.ok
    expected = [MEASURES[name](cut_vectors([edge])) for edge in range(NETWORK.n_edges)]
    cut = SIDES if "area" in name else {int(name[7:-1])}
    assert set(np.flatnonzero(np.isnan(found.value.after)).tolist()) == cut
    np.testing.assert_allclose(found.value.after, expected, rtol=1e-9)


@pytest.mark.parametrize("name", MEASURES)
def test_pruning_steers_the_edge_or_face_of_the_whole(name):
    wanted = 1.1 * quantity(NETWORK, name).evaluate(CRITICAL)[0]
    found = prune_towards(CRITICAL, {name: wanted}, throw=False)
    assert len(found.cuts) and found.status in (Status.ok, Status.not_reached)
    values = [MEASURES[name](cut_vectors(found.cuts[:n].tolist())) for n in range(1, 1 + len(found.cuts))]
    np.testing.assert_allclose(found.values[1:], values, rtol=1e-8)
    assert abs(found.objective - wanted) < abs(found.values[0] - wanted)


def test_an_edge_that_is_measured_is_neither_cut_nor_left_hanging():
    found = prune_towards(CRITICAL, {"length[7]": "smallest"}, cuts=8, throw=False)
    assert np.isfinite(found.values).all() and 7 in found.edges
