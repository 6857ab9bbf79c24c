"""Diagonals of faces as pairs of local responses."""

import numpy as np
from refusals import refused

from critflow import CriticalManifold, lattice, quantity, voronoi_network
from critflow_extras import foam_network, local_response
from critflow_extras.local.diagonals import face_diagonals, response_name


def test_diagonals_join_opposite_vertices():
    network = lattice("honeycomb", 3, 4)
    x = network.positions
    diagonals = face_diagonals(network)
    assert len(diagonals) == 12
    side = np.linalg.norm(network.bond_vectors(x), axis=1).mean()
    for i, j, image in diagonals:
        assert np.isclose(np.linalg.norm(x[j] + image @ network.cell - x[i]), 2 * side)


def test_every_diagonal_is_a_pair():
    network = voronoi_network(100, seed=3)
    critical = CriticalManifold(network).configuration(np.ones(150))
    source, *targets = face_diagonals(network)
    found = local_response(critical, source, targets).value
    assert len(targets) > 45 and np.isfinite(found.strains).all()
    goal = quantity(network, response_name(source, targets[3]))
    assert goal.source == found.source and goal.target == found.targets[3]


SQUARE = (0, 2, (0, 0)), (1, 3, (0, 0))
test_refused = refused(
    {
        "space": (lambda: face_diagonals(foam_network(60, seed=1)), "no faces"),
        "negative stress": (lambda: response_name(*SQUARE, stress=-1e-3), "zero or a positive number"),
        "no number": (lambda: response_name(*SQUARE, stress=np.nan), "zero or a positive number"),
    }
)


def test_a_stress_is_part_of_the_name():
    assert response_name(*SQUARE, stress=1e-3) == "local[0-2:0:0,1-3:0:0,0.001]"
    assert response_name(*SQUARE, stress=0) == "local[0-2:0:0,1-3:0:0]"
