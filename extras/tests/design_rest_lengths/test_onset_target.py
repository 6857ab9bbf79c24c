"""Prescribed onsets: reached to rounding, the multiplier against differences, ratios kept, bad input."""

import numpy as np
import pytest
from refusals import refused

from critflow import Status, critical_from_lengths, optimize, spring_state, voronoi_network
from critflow_extras import critical_strain, design

NETWORK = voronoi_network(n_vertices=24, seed=2)
# Floppy up to a shear of 0.18.
LENGTHS = np.full(36, 1.02 * critical_from_lengths(NETWORK, np.ones(36), throw=False).ratio)


def with_onset(strain, path="simple_shear", lengths=LENGTHS, **options):
    state = spring_state(NETWORK, lengths, NETWORK.positions)
    return design(state, {f"onset[{path}]": strain}, change="rest_lengths", **options)


def test_an_onset_is_reached_by_the_least_change_at_the_stated_cost():
    low, found, high = (with_onset(strain) for strain in (0.162, 0.164, 0.166))
    again = critical_strain(NETWORK, found.value.rest_lengths, "simple_shear").value
    assert again.strain == pytest.approx(0.164, abs=1e-10) and found.reached
    assert found.distance < with_onset(0.164, prefer="ratios").distance
    cost = 0.5 * 36 * (high.distance**2 - low.distance**2) / 0.004
    assert found.targets["onset[simple_shear]"].multiplier == pytest.approx(cost, rel=1e-3)


def test_ratios_are_kept():
    found = with_onset(0.1, "uniaxial", prefer="ratios")
    assert np.ptp(found.value.rest_lengths) < 1e-12
    assert found.targets["onset[uniaxial]"].value == pytest.approx(0.1, abs=1e-10)


def test_two_onsets_are_reached_together():
    targets = {"onset[simple_shear]": 0.17, "onset[uniaxial]": 0.1}
    found = design(spring_state(NETWORK, LENGTHS, NETWORK.positions), targets, change="rest_lengths", throw=False)
    for name, strain in targets.items():
        path = name[6:-1]
        again = critical_strain(NETWORK, found.value.rest_lengths, path).value.strain
        assert again == pytest.approx(strain if found.reached else found.targets[name].value, abs=1e-9)


def test_an_onset_that_equal_lengths_do_not_have_is_not_reached():
    # Lengths that are floppy at zero are floppy at a small compression as well.
    found = with_onset(-0.05, "dilation", prefer="ratios", throw=False)
    assert not found.ok and not found.reached


def test_an_onset_without_any_start_is_not_reached():
    """No multiple of these rest lengths has an onset at −0.05: where that shear is at the transition, zero is rigid."""
    network = voronoi_network(20, seed=1)
    critical = optimize(network, "B_0").value
    state = spring_state(network, critical.lengths, critical.coordinates)
    found = design(state, {"onset[simple_shear]": -0.05}, change="rest_lengths", throw=False)
    assert found.status is Status.rigid and not found.reached


BAD = {
    "zero": (lambda: with_onset(0.0), "zero"),
    "NaN": (lambda: with_onset(np.nan), "number"),
    "interval": (lambda: with_onset((0.1, 0.2)), "zero"),
    "preference": (lambda: with_onset(0.1, prefer="cheap"), "prefer"),
    "no onset": (
        lambda: design(spring_state(NETWORK, LENGTHS, NETWORK.positions), {"B_0": 0.2}, change="rest_lengths"),
        "onset",
    ),
}
test_bad_arguments_are_one_sentence = refused(BAD)
