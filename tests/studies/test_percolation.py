"""The percolation study, small: the curve, its half points and their power of the size."""

import json

import numpy as np
import pytest

from critflow import Status, optimize, voronoi_network
from workflows.percolation import curve, half_point, readings, threshold_power

STUDY = "percolation"


def test_narrow_rest_lengths_stress_every_edge(dataset):
    for state in dataset.state.values:
        (full, n), (tense, _) = curve(dataset, state), curve(dataset, state, "tension_fraction")
        assert (n == 3).all() and (full[:, 0] == 1).all() and (tense <= full).all() and (tense[:, -1] < 1).all()
    assert (curve(dataset)[0][:, -1] < 1).all()
    assert (dataset.solve_status.isel(spread=0) == Status.ok).all()


def test_the_printed_box_stresses_more_edges_and_has_the_smaller_gap(dataset):
    wide = dataset.isel(spread=-1, n_vertices=-1)
    transition, box = wide.sel(state="transition"), wide.sel(state="box_N_b")
    assert (box.stressed_fraction > transition.stressed_fraction).all()
    assert (box.tension_fraction <= box.stressed_fraction).all() and (box.tension_fraction < 1).any()
    assert (box.B_0_part > transition.B_0_part).all()
    # The protocol in the box V = N_v ends slightly past the exact transition.
    narrow = dataset.isel(spread=0, n_vertices=-1).B_0_part
    assert np.abs(narrow.sel(state="box_N_v") / narrow.sel(state="transition") - 1).max() < 0.03
    assert (narrow.sel(state="box_N_b") / narrow.sel(state="transition") > 1.01).all()


def test_the_numbers_at_the_printed_spread_are_those_of_the_ensemble(runs, run_study, tmp_path):
    """The same networks and rest lengths; here the protocol runs for all networks at that spread."""
    ensemble = runs("ensemble")[1]
    ds = run_study(STUDY, tmp_path, "n_vertices=60", "spreads=0.1,0.3", "protocol_networks=0")
    # The figure has the percentage and the number of networks of its title.
    (full, n), (at,) = curve(ds, "box_N_b"), [row for row in readings(ds) if row["state"] == "box_N_b"]
    assert n.tolist() == [[0, 3]] and at["networks"] == 3 and 100 * full[0, 1] == at["full"]
    ds = ds.isel(n_vertices=0, spread=1)
    for state, population in (("transition", "random_lengths_transition"), ("box_N_b", "random_lengths")):
        one, other = ds.sel(state=state), ensemble.sel(population=population)
        for name in ("stressed_fraction", "tension_fraction", "V_L", "V_tau", "kappa_phys", "kappa_force"):
            np.testing.assert_array_equal(one[name], other[name], err_msg=name)
        best = ensemble.B_0.sel(population="max_B_0")
        np.testing.assert_allclose(one.B_0_part, other.B_0 / best, rtol=1e-12)


def test_equal_rest_lengths_are_min_V_L_at_the_transition_and_near_it_in_the_boxes(run_study, tmp_path):
    ds = run_study(STUDY, tmp_path, "seeds=0:1", "n_vertices=40", "spreads=0,0.3")
    states = ds.isel(spread=0, n_vertices=0, seed=0)
    equal = states.sel(state="transition")
    best = optimize(voronoi_network(40, seed=0), "V_L").value
    np.testing.assert_allclose(equal.V_L, 0, atol=1e-9)
    np.testing.assert_allclose(equal.V_tau, np.var(best.tensions) / np.mean(best.tensions) ** 2, rtol=1e-3)
    assert (states.V_L.drop_sel(state="transition") > 1e-9).all() and (states.V_L < 1e-3).all()
    rows = {(row["state"], row["spread"]): row for row in readings(ds)}
    assert set(rows) == {(state, s) for state in ("transition", "box_N_v", "box_N_b") for s in (0, 0.3)}
    assert rows["box_N_b", 0]["stressed"] == rows["box_N_b", 0]["full"] == 100
    assert rows["transition", 0.3]["gap"] > rows["box_N_b", 0.3]["gap"] > rows["box_N_b", 0]["gap"]
    assert {claim["key"] for claim in json.loads((tmp_path / "claims.json").read_text())} == {
        "percolation-threshold", "percolation-size", "percolation-gap", "percolation-stressed",
    }  # fmt: skip


def test_the_half_point_and_its_power_are_recovered():
    spreads, sizes = np.linspace(0.05, 0.5, 46), np.array([50, 500])
    half = 0.8 * sizes**-0.25
    full = np.exp(-np.log(2) * (spreads / half[:, None]) ** 4)
    np.testing.assert_allclose([half_point(spreads, row) for row in full], half, atol=1e-3)
    assert threshold_power(sizes, half) == pytest.approx(-0.25, rel=1e-12)
    assert np.isnan(half_point(spreads, np.ones(46)))
    assert np.isnan(threshold_power(sizes, np.array([0.2, np.nan])))
