"""Studies of the scene on networks of files that only critflow-extras reads."""

import numpy as np
import pytest
import xarray as xr

from critflow import upper_bound, voronoi_network
from critflow.command.main import main
from critflow_extras import write_network
from workflows.shared import own_network

NETWORK = voronoi_network(24, seed=3).deformed([[1.1, 0.2], [0.0, 1.0]])


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def run(network):
    words = ("variables=B_0,status", "populations=max_B_0", "seeds=0", f"network={network}")
    return main(["run", "ensemble", "--workers", "0", "--out", "out", *(f"--set={word}" for word in words)])


def test_a_study_runs_on_a_graph_as_on_its_tables():
    digests = set()
    for name in ("mine.graphml", "mine.csv"):
        write_network(NETWORK, name)
        digests.add(own_network.with_digest(9, {"network": name, "n_vertices": 9})["network"].partition("@")[2])
    assert len(digests) == 1
    assert run("mine.graphml") == 0
    with xr.open_dataset("out/ensemble.nc") as dataset:
        np.testing.assert_allclose(dataset.B_0.values, upper_bound(NETWORK, "B_0"), rtol=1e-10)


def test_tables_of_other_columns_are_the_same_network(tmp_path):
    write_network(NETWORK, "mine.csv")
    table = tmp_path / "mine_edges.csv"
    first = own_network.with_digest(9, {"network": "mine.csv", "n_vertices": 9})
    table.write_text(table.read_text().replace("tail,head", "source,target").replace("stiffness", "k"))
    assert own_network.with_digest(9, {"network": "mine.csv", "n_vertices": 9}) == first


@pytest.mark.parametrize(("network", "word"), [("mine.png", "pictures.md"), ("loop.csv", "edge 2 joins vertex 1")])
def test_a_file_that_needs_more_is_one_sentence(tmp_path, network, word, capsys):
    (tmp_path / "loop_edges.csv").write_text("tail,head\n0,1\n1,2\n1,1\n")
    (tmp_path / "loop_vertices.csv").write_text("id,x,y,fixed\n0,0,0,1\n1,1,0.5,0\n2,2,0,1\n")
    assert run(network) == 2
    error = capsys.readouterr().err
    assert word in error and error.count("\n") == 1
