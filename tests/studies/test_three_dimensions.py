"""The study of foams in three dimensions end to end, and the closed form of its stiffest population."""

import json
import re

import numpy as np

from critflow import (
    Network,
    Status,
    foam_network,
    upper_bound,
)
from critflow.command.main import main
from critflow.workflow.load import load_study

STUDY = "three_dimensions"


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


def test_claims_figure_and_checks(folder, dataset, capsys, assert_picture):
    assert_picture(folder / "figures" / "response.png")
    claims = {claim["key"]: claim for claim in json.loads((folder / "claims.json").read_text())}
    assert len(claims) == 15
    assert claims["ResponseMetrics-C"]["verdict"] == "holds"
    assert re.match(r"max B_0 [\d.]+, min V_τ", claims["ResponseMetrics-A"]["value"])
    assert all(claim["because"] for claim in claims.values() if claim["verdict"] == "differs")
    assert main(["verify", str(folder)]) == 0
    assert "12 stored cases" in capsys.readouterr().out
    assert load_study(STUDY).study.claims(dataset.sel(population=["random_lengths", "shear_modulus"])) == []
