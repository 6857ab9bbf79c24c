"""The cone program of perimeters against that of lengths."""

import numpy as np
import pytest
import scipy.sparse as sp

from critflow import critical_from_lengths, voronoi_network
from critflow.cones import fit_lengths
from critflow_extras import critical_from_perimeters
from critflow_extras.tissue.perimeter_program import fit_perimeters

NETWORK = voronoi_network(100, seed=1)


def test_the_cone_program_of_lengths_is_that_of_one_edge_a_face():
    target = 1 + 0.05 * np.random.default_rng(1).standard_normal(150)
    cables = (NETWORK.free_incidence, NETWORK.boundary_vectors)
    one = fit_lengths(*cables, target, 1e-12)
    other = fit_perimeters(*cables, sp.csr_array(np.eye(150)), target, 1e-12)
    assert one.ratio == pytest.approx(other.ratio, rel=1e-10)
    # Interior-point programs of a gap of 1e-12 end within about its root.
    np.testing.assert_allclose(other.multipliers, one.multipliers, rtol=1e-4)
    np.testing.assert_array_equal(other.stressed, one.stressed)
    springs = critical_from_lengths(NETWORK, target).value
    faces = critical_from_perimeters(NETWORK, target, sides=sp.eye_array(150)).value
    # To the error 1e-12 of the polished perimeters, over the softest curvature of some 1e-3.
    np.testing.assert_allclose(faces.configuration.bond_vectors, springs.bond_vectors, rtol=0, atol=1e-8)
    np.testing.assert_allclose(faces.face_tensions, springs.tensions / springs.tensions.mean(), rtol=1e-8)
