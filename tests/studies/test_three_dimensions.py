"""The study of foams in three dimensions end to end, and the closed form of its stiffest population."""

import json

import numpy as np
import pytest

from critflow import (
    Network,
    Status,
    foam_network,
    optimize,
    stiffening,
    strain_path,
    upper_bound,
    voronoi_network,
)
from critflow.command.main import main

STUDY = "three_dimensions"


@pytest.mark.parametrize("make", [lambda: voronoi_network(60, seed=2), lambda: foam_network(60, seed=1)])
def test_the_largest_bulk_modulus_falls_as_springs_that_stretch_alike(make):
    """At σ ∝ k the network expands affinely, E ∝ ((1 + γ)^{1/d} − 1)², so that C_B = (3/d − 2) B_0."""
    network = make()
    critical = optimize(network, "bulk_modulus").value
    exact = stiffening(critical).value
    assert exact.C_B == pytest.approx((3 / network.dimension - 2) * exact.bulk_0, rel=1e-10)
    path = strain_path(critical, [0.1]).value
    stretch = 1.1 ** (1 / network.dimension)
    assert path.energy[0] == pytest.approx(0.5 * np.sum(critical.lengths**2) * (stretch - 1) ** 2, rel=1e-12)
    np.testing.assert_allclose(path.states[0].lengths, stretch * critical.lengths, rtol=1e-10)


def test_the_dataset_is_labelled_as_the_ensemble_is(dataset):
    assert {"seed": 2, "population": 6, "strain": 10, "edge": 120, "vertex": 60, "axis": 3}.items() <= dict(
        dataset.sizes
    ).items()
    for name in ("sigma", "coordinates", "bulk_modulus", "C_B_exact", "C_G", "C_G_error", "status"):
        assert dataset[name].attrs["long_name"] and dataset[name].attrs["units"] == "1"
    assert "anisotropy_physical" not in dataset


def test_statuses_and_bounds_are_those_that_foams_have(dataset):
    status = dataset.status.transpose("population", "seed")
    for population in ("bulk_modulus", "shear_modulus", "random_stress"):
        assert (status.sel(population=population) == Status.ok).all(), population
    # Of some foams several edges shrink together, and rounding ends the descent before its infimum is shown.
    assert np.isin(status, [Status.ok, Status.slack_edges, Status.edge_collapse, Status.stalled]).all()
    for seed in dataset.seed.values:
        one = dataset.sel(seed=seed)
        network = Network(one.edges.values, one.offsets.values, one.cell.values)
        np.testing.assert_array_equal(network.edges, foam_network(60, seed=int(seed)).edges)
        assert (one.bulk_modulus_0 <= upper_bound(network, "B_0") * (1 + 1e-12)).all()


def test_claims_figure_and_checks(folder, capsys, assert_picture):
    assert_picture(folder / "figures" / "response.png")
    claims = {claim["key"]: claim for claim in json.loads((folder / "claims.json").read_text())}
    assert len(claims) == 14
    assert claims["ResponseMetrics-A"]["verdict"] == claims["ResponseMetrics-C"]["verdict"] == "holds"
    assert all(claim["because"] for claim in claims.values() if claim["verdict"] == "differs")
    assert main(["verify", str(folder)]) == 0
    assert "12 stored cases" in capsys.readouterr().out


def test_one_configuration_is_shown(folder, tmp_path, capsys, assert_picture):
    picture = tmp_path / "one.png"
    words = ["--set", "seed=1", "--set", "population=bulk_modulus", "--out", str(picture)]
    assert main(["show", str(folder / "three_dimensions.nc"), *words]) == 0
    text = capsys.readouterr().out
    assert "rigid to second order" in text and "100.000000 % of its bound" in text
    assert_picture(picture)


def test_some_populations_alone(dataset, run_study, tmp_path):
    alone = run_study(STUDY, tmp_path, "seeds=1", "populations=random_lengths,shear_modulus")
    for population in alone.population.values:
        one, other = (ds.sel(seed=1, population=population) for ds in (alone, dataset))
        np.testing.assert_array_equal(one.sigma, other.sigma)
    assert json.loads((tmp_path / "claims.json").read_text()) == []
