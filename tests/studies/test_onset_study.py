"""The onset study, small: the surface along a dilation, and the coordination of its families."""

import numpy as np
import pytest
from workflows.onset import network_of

STUDY = "onset"


def test_dilation_reaches_the_surface_where_areas_do(dataset):
    one = dataset.sel(family="voronoi").isel(seed=0)
    # Dilation reaches the surface where the area exceeds that of the lengths by 5 % a side.
    np.testing.assert_allclose(one.surface_strain.values[:, 2], 0.05, rtol=1e-9)


def test_families_have_the_coordination_requested():
    network = network_of("triangular", 48, 3.4, 1)
    assert 2 * network.n_edges / network.n_vertices == pytest.approx(3.4, abs=2 / network.n_vertices)
