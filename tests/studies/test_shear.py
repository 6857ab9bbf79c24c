"""The shear study, small: bounds, thresholds and exponents."""

import numpy as np
import pytest

from critflow import upper_bound, voronoi_network
from critflow.quantities import pure_shear, transition_modulus
from critflow.result import Status
from workflows.shared.reports import exponent

STUDY = "shear"


def test_the_shear_modulus_is_kept_only_where_it_is_the_objective(dataset):
    optimised = dataset.G_0.sel(population="max_G_0")
    assert (optimised > dataset.G_0.drop_sel(population="max_G_0")).all()
    assert (optimised < dataset.bound).all()
    detailed = dataset.isel(seed=slice(0, 2))
    assert (detailed.G_0_of_threshold.sel(threshold=0.1) == optimised.isel(seed=slice(0, 2))).all()
    assert (detailed.G_0_of_threshold.diff("threshold") < 0).all()
    assert np.isnan(dataset.objective_of_start.isel(seed=2)).all()
    assert (dataset.threshold_status.isel(seed=2) == Status.missing).all()
    for n_vertices in dataset.n_vertices.values:
        expected = upper_bound(
            voronoi_network(int(n_vertices), 1), transition_modulus(voronoi_network(int(n_vertices), 1), pure_shear(2))
        )
        assert float(dataset.bound.sel(seed=1, n_vertices=n_vertices)) == pytest.approx(expected, rel=1e-13)


def test_an_exponent_is_recovered_with_its_interval():
    sizes, rng = np.array([100, 200, 500, 1000]), np.random.default_rng(4)
    inside = 0
    for _ in range(40):
        values = (sizes**-0.8)[:, None] * rng.standard_normal((4, 60)) ** 2
        fit = exponent(sizes, values)
        assert fit[1] < fit[0] < fit[2]
        inside += fit[1] <= -0.8 <= fit[2]
    # 95 % intervals: 38 of 40 are expected, 33 or fewer once in a thousand times.
    assert inside >= 34
