"""A small dataset with configurations, for the tests of the page."""

import json

import pytest

from critflow.command.main import main

CLAIMS = [
    {"key": "ResponseMetrics-A-random_stress", "statement": "max B_0 lies about 50 % above random_stress"},
    {"key": "StructuralMetrics-random_stress", "statement": "random stress is alike"},
    {"key": "ResponseMetrics-C", "statement": "max G_0 networks have a much larger G_0 than all others"},
]
CLAIMS = [{"value": "1", "verdict": "holds", **claim} for claim in CLAIMS]


@pytest.fixture(scope="session")
def dataset(tmp_path_factory):
    """The path of a dataset of four cases with two claims; without the lengths no figure is drawn."""
    folder = tmp_path_factory.mktemp("ensemble")
    words = ["n_vertices=36", "seeds=0:2", "populations=bulk_modulus,random_stress", "strains=0.001,0.002,0.003"]
    words.append("variables=edges,offsets,cell,sigma,coordinates,bulk_modulus_0,shear_modulus_0,C_B_exact,bulk_modulus")
    assert main(["run", "ensemble", "--out", str(folder), "--workers", "0", *(f"--set={word}" for word in words)]) == 0
    (folder / "claims.json").write_text(json.dumps(CLAIMS))
    return folder / "ensemble.nc"
