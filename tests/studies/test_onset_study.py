"""The onset study end to end, small: strains with bounds, and convex surfaces."""

import numpy as np
import pytest

from critflow.result import Status
from workflows.onset.study import network_of

STUDY = "onset"


def test_critical_strains_have_bounds_and_the_others_a_status(dataset):
    found = np.isfinite(dataset.critical_strain)
    assert ((dataset.strain_status == Status.ok) == found).all()
    assert float(dataset.critical_strain_error_bound.max()) < 2e-9
    assert found.sel(family="triangular", z=3.4).all()
    # A Voronoi network is in balance under the forces of its dual triangulation: it is at the transition as built, and
    # rounding may hide the side.
    assert dataset.strain_status.sel(family="voronoi", z=3).isin((Status.rigid, Status.undecided)).all()
    assert dataset.surface_strain.sel(family="triangular").isnull().all()


def test_surfaces(dataset, folder):
    one = dataset.sel(family="voronoi").isel(seed=0)
    # Dilation reaches the surface where the area exceeds that of the lengths by 5 % a side.
    np.testing.assert_allclose(one.surface_strain.values[:, 2], 0.05, rtol=1e-9)
    claims = (folder / "claims.md").read_text(encoding="utf-8")
    assert "OnsetConvex" in claims
    for name in ("coordination", "surfaces"):
        assert (folder / "figures" / f"{name}.png").exists()


def test_families_have_the_coordination_requested():
    network = network_of("triangular", 48, 3.4, 1)
    assert 2 * network.n_edges / network.n_vertices == pytest.approx(3.4, abs=2 / network.n_vertices)
