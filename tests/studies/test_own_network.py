"""Studies on the network of a file: its contents are part of the identity of the cases."""

from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from critflow import elasticity, extensions, lattice, read_critical, upper_bound, voronoi_network, write_network
from critflow.command.main import main
from critflow.engine.code_digest import load_study
from critflow.engine.settings import select
from critflow.result import StudyError
from workflows.benchmarks.failure_map.outcomes import Outcome

NETWORK = voronoi_network(24, seed=3).deformed([[1.1, 0.2], [0.0, 1.0]])
SMALL = ["--set", "variables=B_0,iterations,status", "--workers", "0", "--out", "out"]


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    # Tables are read without critflow-extras, whether it is installed or not.
    monkeypatch.setattr(extensions, "find_spec", lambda name: None)
    extensions.has_extras.cache_clear()
    write_network(NETWORK, "mine.csv")
    yield
    extensions.has_extras.cache_clear()


def run(study, *settings):
    return main(["run", study, *SMALL, *(f"--set={word}" for word in settings)])


def test_the_ensemble_of_a_file_is_resumed_while_its_network_is_the_same(capsys):
    settings = ("network=mine.csv", "populations=max_B_0,random_stress,min_V_tau", "seeds=0:2")
    assert run("ensemble", *settings) == 0
    with xr.open_dataset("out/ensemble.nc") as dataset:
        stiffest = dataset.B_0.sel(population="max_B_0").values
        np.testing.assert_allclose(stiffest, upper_bound(NETWORK, "B_0"), rtol=1e-10)
        drawn = dataset.B_0.sel(population="random_stress").values
        assert drawn[0] != drawn[1] and (drawn < stiffest).all()
        assert (dataset.status == 0).all()
        # The second descent starts elsewhere.
        assert np.diff(dataset.iterations.sel(population="min_V_tau")) != 0
    capsys.readouterr()
    # A note in the file changes nothing, another spring makes new cases.
    vertices = Path("mine_vertices.csv")
    vertices.write_text("# measured in May\n" + vertices.read_text())
    assert run("ensemble", *settings) == 0
    assert "6 of 6 requested cases were stored before" in capsys.readouterr().out
    write_network(NETWORK.with_stiffness(np.linspace(1, 2, 36)), "mine.csv")
    assert run("ensemble", *settings) == 0
    assert "0 of 6 requested cases were stored before" in capsys.readouterr().out


def test_the_stiffnesses_of_a_file_are_stored():
    """The physics is recomputed, and a case is read, with them."""
    write_network(NETWORK.with_stiffness(np.linspace(1, 2, 36)), "soft.csv")
    settings = ("network=soft.csv", "populations=max_B_0", "seeds=0", "strains=0.001:0.003:0.001")
    words = ["--workers", "0", "--out", "whole", *(f"--set={word}" for word in settings)]
    assert main(["run", "ensemble", *words]) == 0 and main(["verify", "whole"]) == 0
    assert "No statement is tested" in Path("whole/claims.md").read_text()
    with xr.open_dataset("whole/ensemble.nc") as dataset:
        one = dataset.sel(seed=0, population="max_B_0")
        assert elasticity(read_critical(one)).value.bulk == pytest.approx(float(one.B_0), rel=1e-12)


def test_the_gallery_of_a_file():
    assert run("gallery", "network=mine.csv", "panels=max_B_0,max_B_0_wave,random_lengths") == 0
    with xr.open_dataset("out/gallery.nc") as dataset:
        both = dataset.B_0.sel(panel=["max_B_0", "max_B_0_wave"]).values
        np.testing.assert_allclose(both, upper_bound(NETWORK, "B_0"), rtol=1e-10)


def test_the_failure_map_of_a_file(monkeypatch, tmp_path):
    study = load_study("failure_map").study
    words = ("network=mine.csv", "difficulties=skew_cell,hard_core", "quantities=configuration", "n_steps=2", "seeds=0")
    parameters = select(study, words).parameters
    found = study.case(parameters, difficulty="skew_cell", seed=0)
    assert (found["outcome"][0] == Outcome.exact).all() and (found["error"][0] < 1e-15).all()
    empty = study.case(parameters, difficulty="hard_core", seed=0)
    assert not empty["outcome"].any() and np.isnan(empty["strength"]).all()
    write_network(voronoi_network(80, seed=1), "large.csv")
    with pytest.raises(StudyError, match="vertices"):
        select(study, ("network=large.csv",))


@pytest.mark.parametrize("setting", ["n_vertices=20", "hard_core=0.5"])
def test_settings_of_generated_networks_are_refused_beside_a_file(setting, capsys):
    assert run("ensemble", "network=mine.csv", setting) == 2
    assert f"{setting.partition('=')[0]} is of generated networks" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("network", "word"),
    [
        ("missing.csv", "no file"),
        ("mine", "ending"),
        ("mine.csv@0123456789abcdef", "another network"),
        ("mine.png", "pip install . ./extras"),
        ("stiff.csv", "self-stress"),
        ("patch.csv", "periodic"),
        ("loop.csv", "itself"),
    ],
)
def test_a_network_that_does_not_fit_is_one_sentence(network, word, capsys):
    write_network(lattice("triangular", 3, 3), "stiff.csv")
    for name, edges in (("patch", "0,1\n1,2\n"), ("loop", "0,1\n1,2\n1,1\n")):
        with open(f"{name}_edges.csv", "w") as table:
            table.write("tail,head\n" + edges)
        with open(f"{name}_vertices.csv", "w") as table:
            table.write("id,x,y,fixed\n0,0,0,1\n1,1,0.5,0\n2,2,0,1\n")
    assert run("ensemble", f"network={network}") == 2
    error = capsys.readouterr().err
    assert word in error and error.count("\n") == 1
