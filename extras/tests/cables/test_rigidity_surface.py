"""The rigidity surface: convex, with the stresses as its normals."""

import numpy as np
import pytest

from critflow import InputError, Status, critical_from_lengths, voronoi_network
from critflow_extras import rigidity_surface
from critflow_extras.cables.rigidity_surface import strain_plane

NETWORK = voronoi_network(24, seed=2)
LENGTHS = np.full(36, 1.05 * critical_from_lengths(NETWORK, np.ones(36), throw=False).ratio)


def test_the_floppy_strains_are_convex_and_the_stresses_their_normals():
    surface = rigidity_surface(NETWORK, LENGTHS, strain_plane(np.diag([1.0, -1.0]), np.eye(2), 12))
    inside = surface.points[surface.found]
    assert len(inside) >= 6
    assert surface.error_bounds[surface.found].max() < 1e-9
    # Each tangent plane has all other points, and zero strain, on its floppy side.
    side = np.einsum("nij,mij->nm", surface.normals[surface.found], inside)
    assert (np.diag(side) > 0).all()
    assert (side <= np.diag(side)[:, None] + 1e-9).all()
    assert (surface.taut[surface.found] > 0).all()
    # Pure compression flattens the cell.
    assert surface.statuses[9] is Status.floppy
    assert np.isnan(surface.strains[9])


def test_directions_have_one_shape():
    with pytest.raises(InputError, match="shape"):
        rigidity_surface(NETWORK, LENGTHS, np.eye(2))
    with pytest.raises(InputError, match="shape"):
        strain_plane(np.eye(2), np.eye(3), 4)
