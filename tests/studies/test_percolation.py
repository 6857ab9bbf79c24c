"""The percolation study, small: the curve, its half points and their power of the size."""

import numpy as np
import pytest

from critflow import Status
from workflows.percolation import curve, half_point, threshold_power

STUDY = "percolation"


def test_narrow_rest_lengths_stress_every_edge(dataset):
    full, slack, counts = curve(dataset)
    assert (counts == 3).all()
    assert (full[:, 0] == 1).all() and np.abs(slack[:, 0]).max() < 1e-12
    assert (slack[:, -1] > 0).all() and (full[:, -1] < 1).all()
    assert (dataset.solve_status.isel(spread=0) == Status.ok).all()


def test_the_half_point_and_its_power_are_recovered():
    spreads, sizes = np.linspace(0.05, 0.5, 46), np.array([50, 500])
    half = 0.8 * sizes**-0.25
    full = np.exp(-np.log(2) * (spreads / half[:, None]) ** 4)
    np.testing.assert_allclose([half_point(spreads, row) for row in full], half, atol=1e-3)
    assert threshold_power(sizes, half) == pytest.approx(-0.25, rel=1e-12)
    assert np.isnan(half_point(spreads, np.ones(46)))
    assert np.isnan(threshold_power(sizes, np.array([0.2, np.nan])))
