"""The study of foams in three dimensions, small: statuses and bounds."""

import numpy as np

from critflow import Network, Status, upper_bound
from critflow_extras import foam_network

STUDY = "three_dimensions"
SOUND = [Status.ok, Status.slack_edges, Status.compressed_edges, Status.edge_collapse]


def test_statuses_and_bounds_are_those_that_foams_have(dataset):
    status = dataset.status.transpose("population", "seed")
    for population in ("max_B_0", "max_G_0", "random_stress"):
        assert (status.sel(population=population) == Status.ok).all(), population
    # Of some foams several edges shrink together, and rounding ends the descent before its infimum is shown.
    assert np.isin(status, [*SOUND, Status.stalled]).all()
    for seed in dataset.seed.values:
        one = dataset.sel(seed=seed)
        network = Network(one.edges.values, one.offsets.values, one.cell.values)
        np.testing.assert_array_equal(network.edges, foam_network(60, seed=int(seed)).edges)
        assert (one.B_0 <= upper_bound(network, "B_0") * (1 + 1e-12)).all()


def test_coefficients_are_undefined_where_an_edge_collapses(dataset):
    collapsed = dataset.status == Status.edge_collapse
    assert collapsed.any()
    for name in ("C_B", "C_G_error_bound", "C_G_stress_corrected_fit"):
        assert np.isnan(dataset[name].values[collapsed.values]).all(), name
        assert np.isfinite(dataset[name].sel(population="max_B_0")).all()
    assert np.isfinite(dataset.B_0.values[collapsed.values]).all()
    assert (dataset.valid.values == dataset.status.isin(SOUND)).all()
