"""The taut backbone of configurations with slack edges: known graphs, carried numbers and cables."""

import numpy as np
import pytest
from problems import slack_lattice, taut_rows
from refusals import refused

from critflow import CriticalConfiguration, InputError, Network, voronoi_network
from critflow.manifold import critical_configuration
from critflow.taut_part import backbone

# A cable of two edges between the pins 0 and 1, and two slack edges from its middle to a third pin.
HUNG = Network([[0, 3], [3, 1], [3, 4], [4, 2]], pins={0: [1, 1], 1: [3, 1], 2: [2, 0]})
HUNG_COORDINATES = np.array([[1, 1], [3, 1], [2, 0], [2.5, 1], [2.2, 0.5]])


@pytest.fixture(scope="module")
def slack():
    return slack_lattice()[2]


def test_without_slack_edges_the_backbone_is_the_configuration():
    network = voronoi_network(n_vertices=20, seed=1)
    critical = critical_configuration(network, np.ones(network.n_edges), network.positions)
    bone = backbone(critical)
    assert bone.configuration is critical
    assert bone.n_slack == 0
    assert bone.stressed_fraction == 1
    assert len(bone.floppy_vertices) == 0


def test_the_backbone_keeps_bond_vectors_balance_and_bounds(slack):
    bone = backbone(slack)
    part = bone.configuration
    assert bone.n_slack == np.count_nonzero(slack.sigma == 0) > 0
    apart = np.linalg.norm(part.bond_vectors - slack.bond_vectors[bone.taut], axis=1)
    assert (apart <= part.bond_errors + slack.bond_errors[bone.taut]).all() and part.bond_errors.max() < 1e-14
    assert np.sum(part.sigma**2) == pytest.approx(part.network.n_edges, rel=1e-14)
    np.testing.assert_allclose(part.network.bond_vectors(part.coordinates), part.bond_vectors, rtol=0, atol=1e-13)
    assert part.residual < 1e-13
    # Every vertex is floppy or part of the backbone.
    assert len(bone.floppy_vertices) + part.network.n_vertices == slack.network.n_vertices


def test_slack_edges_and_the_pins_that_they_alone_meet_are_left_out():
    bone = backbone(critical_configuration(HUNG, np.array([1.0, 3.0, 0, 0]), HUNG_COORDINATES))
    assert bone.taut.tolist() == [True, True, False, False]
    assert sorted(bone.configuration.network.pins) == [0, 1]
    assert np.array_equal(bone.configuration.coordinates, HUNG_COORDINATES[[0, 1, 3]])
    assert bone.floppy_vertices.tolist() == [2, 4]


def test_disconnected_taut_parts_are_components():
    bone = backbone(taut_rows())
    assert [component.network.n_edges for component in bone.components] == [3, 3, 3]
    for component in bone.components:
        # A component without pins is grounded at its first vertex.
        assert not component.coordinates[0].any()
        assert component.residual < 1e-14


def stressed(sigma):
    """The backbone of HUNG at a stress."""
    return backbone(CriticalConfiguration(HUNG, np.array(sigma), HUNG_COORDINATES, HUNG.bond_vectors(HUNG_COORDINATES)))


IMAGES = Network([[0, 0], [0, 1], [1, 0]], [[1, 0], [0, 0], [0, 1]], np.eye(2))
BETWEEN_IMAGES = critical_configuration(IMAGES, np.array([1.0, 0, 0]), np.array([[0, 0], [0.1, 0.5]]))
test_stresses_without_a_backbone_are_refused = refused(
    {
        "no stress": (lambda: stressed([0.0, 0, 0, 0]), "zero"),
        "NaN": (lambda: stressed([np.nan, 1, 1, 1]), "finite"),
        "end of a single edge": (lambda: stressed([1.0, 1, 1, 0]), "vertex 4"),
        "an edge between images of one vertex": (lambda: backbone(BETWEEN_IMAGES), "divide"),
        "no one configuration": (lambda: backbone(taut_rows()).configuration, "3 components"),
    },
    InputError,
)
