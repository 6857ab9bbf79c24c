"""The shear ascent study end to end, small: recorded measures follow from the recorded stresses."""

import json

import numpy as np
import pytest
from problems import modulus_by_formula

from critflow import Network, upper_bound
from critflow.command.main import main
from critflow.critical.transition import pure_shear, transition_modulus
from critflow.result import Status
from critflow.workflow.load import load_study

STUDY = "shear_ascent"


def test_every_recorded_step_follows_from_its_stress(dataset):
    for seed in dataset.seed.values:
        one = dataset.sel(seed=seed)
        network = Network(one.edges.values, one.offsets.values, one.cell.values)
        assert float(one.bound) == pytest.approx(
            upper_bound(network, transition_modulus(network, pure_shear(2))), rel=1e-12
        )
        for step in dataset.step.values:
            now = one.sel(step=step)
            sigma, x = now.sigma.values.astype(float), now.coordinates.values.astype(float)
            L = network.bond_vectors(x)
            length = np.linalg.norm(L, axis=1)
            # Stresses and coordinates are stored in single precision.
            by_formula = modulus_by_formula(network, sigma, L, pure_shear(2))
            assert float(now.shear_modulus) == pytest.approx(by_formula, rel=2e-4)
            assert float(now.longest_edge) == pytest.approx(length.max() / np.sqrt(60), rel=1e-5)
            tension = sigma * length
            assert float(now.least_tension) == pytest.approx(tension.min() / np.abs(tension).max(), rel=1e-4)
            assert int(now.compressed_edges) == np.count_nonzero(sigma < 0)
            assert float(now.compressed_length) == pytest.approx(length[sigma < 0].sum(), rel=1e-4, abs=1e-12)
    assert (dataset.shear_modulus.diff("step") > 0).all()
    assert (dataset.shear_modulus <= dataset.bound).all()
    assert set(np.unique(dataset.status)) == {Status.step_limit}


def test_the_ascent_has_its_figure_and_animation(folder, assert_picture):
    assert_picture(folder / "figures" / "shear_ascent.png", 20_000)
    assert (folder / "figures" / "shear_ascent.gif").read_bytes().startswith(b"GIF89a")
    claims = {claim["key"]: claim for claim in json.loads((folder / "claims.json").read_text())}
    assert claims["ShearModulusSteepestDescent-bound"]["verdict"] == "measured"
    assert json.loads((folder / "summary.json").read_text())["status"] == {"step_limit": 2}


@pytest.mark.parametrize("variable", ["shear_modulus", "longest_edge", "compressed_edges"])
def test_verify_names_what_does_not_follow(dataset, folder, variable, capsys):
    assert main(["verify", str(folder)]) == 0
    assert "physics was recomputed" in capsys.readouterr().out
    changed = dataset.copy(deep=True)
    changed[variable].values[...] += 1
    problems = load_study("shear_ascent").study.verify(changed)
    assert len(problems) == 2
    assert all(variable in problem for problem in problems), problems


@pytest.mark.parametrize("setting, word", [("method=steepest", "fire"), ("n_vertices=7", "n_vertices")])
def test_bad_settings_are_refused_before_anything_runs(setting, word, tmp_path, capsys):
    assert main(["run", STUDY, "--out", str(tmp_path / "out"), "--set", setting]) == 2
    assert word in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
