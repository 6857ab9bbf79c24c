"""The central path to an onset: weak tensions and slack edges."""

import numpy as np
import pytest

from critflow import CriticalManifold, Deformation, Network
from critflow.taut_edges import OnsetState
from critflow_extras.cables.boundary_path import BoundaryPath
from critflow_extras.cables.central_path import follow_central_path


def test_the_central_path_separates_a_weak_tension_from_a_slack_edge():
    # A cable of two parts between pins, taut at a strain of 0.2, and two cables to its middle: one slack, and one that
    # is just as long as the distance there, without tension.
    network = Network([[0, 1], [1, 2], [1, 3], [1, 4]], pins={0: [0, 0], 2: [1, 0], 3: [0, 1], 4: [0.5, 1]})
    lengths = np.array([0.5, 0.7, 2.0, np.hypot(0.1, 1.0)])
    path = BoundaryPath(CriticalManifold(network), Deformation.uniaxial(2))
    taut = np.array([True, True, False, False])
    start = OnsetState(0.19, np.zeros(0), np.array([[0.495, 1e-3]]), np.array([2.0, 1.4, 1e-6, 1e-6]), taut)
    end = follow_central_path(path, lengths, start)
    assert end is not None
    assert end.strain == pytest.approx(0.2, abs=1e-12)
    np.testing.assert_array_equal(end.taut[:3], taut[:3])
    tension = end.sigma * np.linalg.norm(end.bond_vectors(path), axis=1)
    np.testing.assert_allclose(tension[:2] / tension[0], 1.0, rtol=1e-6)
    assert 0 < tension[2] < 1e-12 * tension[0]
