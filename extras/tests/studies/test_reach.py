"""The study of reach, small: the bound is attained by stresses of any sign, and no positive stress is auxetic."""

import numpy as np

from studies.reach.support import attained, poisson_ratio, work

STUDY = "reach"


def test_stresses_of_any_sign_attain_the_bound_and_positive_ones_stay_below(dataset):
    ratio = work(dataset, dataset.signed.values) / dataset.support.values
    # In some direction of a small network the optimum of any sign has no balance.
    attaining = np.isfinite(ratio)
    assert attaining.mean() > 0.5
    np.testing.assert_allclose(ratio[attaining], 1, rtol=1e-8)
    assert (attained(dataset) < 1 + 1e-9).all()


def test_poisson_ratios_of_positive_stresses_are_positive(dataset):
    for values in (dataset.tensile.values, dataset.sampled.values):
        assert (poisson_ratio(values) > 0).all()


def test_dilation_reaches_the_surface_where_areas_do(dataset):
    # Where the area exceeds that of the lengths by 5 % a side.
    np.testing.assert_allclose(dataset.surface_strain.values[:, :, 2], 0.05, rtol=1e-9)


def test_designed_ratios_are_those_of_a_relaxation_that_shares_no_code(dataset):
    assert (dataset.ratio_error < 1e-9).all() and (dataset.ratio_checked_error < 1e-9).all()
