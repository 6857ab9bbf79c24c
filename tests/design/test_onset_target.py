"""Prescribed onsets: reached to rounding, the multiplier against differences, ratios kept, bad input."""

import numpy as np
import pytest

from critflow import InputError, Status, critical_from_lengths, critical_strain, design_onset, voronoi_network

NETWORK = voronoi_network(n_vertices=24, seed=2)
# Floppy up to a shear of 0.18.
LENGTHS = np.full(36, 1.02 * critical_from_lengths(NETWORK, np.ones(36), throw=False).ratio)


def test_an_onset_is_reached_by_the_least_change_at_the_stated_cost():
    low, found, high = (design_onset(NETWORK, LENGTHS, strain) for strain in (0.162, 0.164, 0.166))
    again = critical_strain(NETWORK, found.rest_lengths, "simple_shear")
    assert again.strain == pytest.approx(0.164, abs=1e-10) and found.nearest and found.stats.residual < 1e-10
    assert found.distance < design_onset(NETWORK, LENGTHS, 0.164, prefer="ratios").distance
    cost = 0.5 * 36 * (high.distance**2 - low.distance**2) / 0.004
    assert found.multiplier == pytest.approx(cost, rel=1e-3)


def test_ratios_are_kept():
    found = design_onset(NETWORK, LENGTHS, 0.1, "uniaxial", prefer="ratios")
    assert np.ptp(found.rest_lengths) < 1e-12 and found.strain == pytest.approx(0.1, abs=1e-10)


def test_an_onset_that_equal_lengths_do_not_have_is_infeasible():
    # Lengths that are floppy at zero are floppy at a small compression as well.
    found = design_onset(NETWORK, LENGTHS, -0.05, "dilation", prefer="ratios", throw=False)
    assert found.status is Status.infeasible and "floppy" in found.note


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        ((LENGTHS, 0.0), "zero"),
        ((LENGTHS, np.nan), "number"),
        ((LENGTHS[:3], 0.1), "edge"),
        ((-LENGTHS, 0.1), "positive"),
    ],
)
def test_bad_onsets_are_one_sentence(arguments, word):
    with pytest.raises(InputError, match=word):
        design_onset(NETWORK, *arguments)
    with pytest.raises(InputError, match="preference"):
        design_onset(NETWORK, LENGTHS, 0.1, prefer="cheap")
