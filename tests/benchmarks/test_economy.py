"""The study of the cost saved by fewer variables, small: its results agree, at any times."""

import json

import numpy as np
import pytest
import xarray as xr

from critflow import Status
from critflow.command.main import main

SETTINGS = ["--set=n_vertices=60", "--set=seeds=1:3", "--set=repeats=1"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("economy")
    assert main(["run", "economy", "--workers", "0", "--out", str(folder), *SETTINGS]) == 0
    return folder


@pytest.fixture(scope="module")
def dataset(folder):
    with xr.open_dataset(folder / "economy.nc") as dataset:
        yield dataset.load()


# How far apart the two answers may be: rounding, the value at γ = 1e-6 against that at 0, the curvature of B(γ) over
# strains up to 0.01.
APART = {"member": 0.0, "configuration": 1e-12, "optimum": 1e-12, "moduli": 1e-5, "growth": 1.0}


@pytest.mark.parametrize("question", APART)
def test_both_ways_give_one_answer(dataset, question):
    difference = dataset.difference.sel(question=question).values
    assert (difference <= APART[question]).all()
    # An answer compared with itself would be no comparison; one member is computed twice by the same functions.
    assert question == "member" or (difference > 0).any()


def test_a_finer_path_leads_to_the_exact_growth(dataset, tmp_path):
    words = [*SETTINGS, "--set=questions=growth", "--set=strains=0.00001:0.0001:0.00001"]
    assert main(["run", "economy", "--workers", "0", "--out", str(tmp_path), *words]) == 0
    with xr.open_dataset(tmp_path / "economy.nc") as fine:
        assert (fine.difference.sel(question="growth") < 0.05 * dataset.difference.sel(question="growth")).all()


def test_times_and_bytes_are_there(dataset):
    assert (dataset.status == Status.ok).all()
    for name in ("seconds_short", "seconds_long"):
        assert (dataset[name] > 0).all()
        assert dataset[name].attrs["comment"] == "differs from run to run"
    # σ, lengths and coordinates alone are 90 + 90 + 120 numbers.
    assert (dataset.bytes_of_all > 8 * 300).all() and (dataset.bytes_of_scalars < 8 * 25).all()


def test_figure_claims_and_summary_are_written(folder, assert_picture):
    assert_picture(folder / "figures" / "economy.png")
    claims = json.loads((folder / "claims.json").read_text())
    assert [claim["key"] for claim in claims] == ["growth", "member", "moduli", "configuration", "optimum", "bytes"]
    assert all(claim["because"] for claim in claims if claim["verdict"] == "differs")
    summary = json.loads((folder / "summary.json").read_text())
    assert set(summary["questions"]) == set(APART)
    assert summary["bytes_of_scalars"] < 0.1 * summary["bytes_of_all"]
    assert np.isfinite(summary["questions"]["growth"]["ratio"])


@pytest.mark.parametrize(
    "setting", ["questions=grwth", "strains=0.001,0.002", "repeats=0", "past=0", "n_vertices=61", "variables=seconds"]
)
def test_settings_that_could_only_fail_are_refused(setting, tmp_path, capsys):
    words = [word for word in SETTINGS if word.split("=")[1] != setting.split("=")[0]]
    assert main(["run", "economy", "--workers", "0", "--out", str(tmp_path / "out"), *words, "--set", setting]) == 2
    message = capsys.readouterr().err.strip()
    assert message.startswith("critflow: ") and "\n" not in message


def test_it_runs_with_one_worker_at_most(tmp_path, capsys):
    assert main(["run", "economy", "--workers", "2", "--out", str(tmp_path / "out")]) == 2
    assert "give at most 1" in capsys.readouterr().err
