"""The shear studies end to end, small: what they store follows from what they store, and exponents are recovered."""

import json
import sys
from itertools import combinations

import numpy as np
import pytest
import xarray as xr
from problems import modulus_by_formula

from critflow import Network, modulus_bound, voronoi_network
from critflow.cli import main
from critflow.critical.objectives import pure_shear
from critflow.result import Status
from critflow.workflow.load import load_study


def ran(folder, study, *settings):
    words = [word for setting in settings for word in ("--set", setting)]
    assert main(["run", study, "--workers", "0", "--out", str(folder), *words]) == 0
    with xr.open_dataset(folder / f"{study}.nc") as dataset:
        return dataset.load(), folder


@pytest.fixture(scope="module")
def ascent(tmp_path_factory):
    return ran(tmp_path_factory.mktemp("ascent"), "shear_ascent", "seeds=0:2", "n_vertices=60", "steps=0,1,3,10,40,200")


@pytest.fixture(scope="module")
def compression(tmp_path_factory):
    settings = "seeds=0:3", "n_vertices=40,80", "n_steps=400", "fractions=0.3,0.6"
    return ran(tmp_path_factory.mktemp("compression"), "shear_ascent_scaling", *settings)


@pytest.fixture(scope="module")
def scaling(tmp_path_factory):
    settings = "seeds=0:3", "n_vertices=40,80", "detailed_seeds=2", "n_starts=3", "thresholds=0.1,0.3"
    return ran(tmp_path_factory.mktemp("scaling"), "shear_scaling", *settings)


def test_every_recorded_step_follows_from_its_stress(ascent):
    dataset, _ = ascent
    for seed in dataset.seed.values:
        one = dataset.sel(seed=seed)
        network = Network(one.edges.values, one.offsets.values, one.cell.values)
        assert float(one.bound) == pytest.approx(modulus_bound(network, pure_shear(2)), rel=1e-12)
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


def test_the_ascent_has_its_figure_and_animation(ascent):
    _, folder = ascent
    assert (folder / "figures" / "shear_ascent.png").stat().st_size > 20_000
    assert (folder / "figures" / "shear_ascent.gif").read_bytes().startswith(b"GIF89a")
    claims = {claim["key"]: claim for claim in json.loads((folder / "claims.json").read_text())}
    assert claims["ShearModulusSteepestDescent-bound"]["verdict"] == "measured"
    assert json.loads((folder / "summary.json").read_text())["status"] == {"step_limit": 2}


@pytest.mark.parametrize("variable", ["shear_modulus", "longest_edge", "compressed_edges"])
def test_verify_names_what_does_not_follow(ascent, variable, capsys):
    dataset, folder = ascent
    assert main(["verify", str(folder)]) == 0
    assert "physics was recomputed" in capsys.readouterr().out
    changed = dataset.copy(deep=True)
    changed[variable].values[...] += 1
    problems = load_study("shear_ascent").study.verify(changed)
    assert len(problems) == 2
    assert all(variable in problem for problem in problems), problems


def test_a_study_that_recomputes_nothing_says_so(compression, capsys):
    assert main(["verify", str(compression[1])]) == 0
    assert "no physics can be recomputed" in capsys.readouterr().out


def test_parts_of_the_bound_are_met_in_order(compression):
    dataset, folder = compression
    climbed = dataset.sel(algorithm="lbfgs")
    assert (climbed.status == Status.ok).all()
    assert (climbed.step > 0).all()
    assert (climbed.step.diff("fraction") >= 0).all()
    assert (climbed.shear_modulus_end >= 0.6 * climbed.bound).all()
    # It stops at the largest part, where it is measured too.
    last = climbed.isel(fraction=-1)
    assert (last.compressed_edges == last.compressed_edges_end).all()
    assert (dataset.shear_modulus_end < dataset.bound).all()
    # Nothing at the bound has less compression than the linear program allows; below it networks may.
    assert (dataset.least_compressed_length > 0.5 * dataset.n_vertices).all()
    assert (folder / "figures" / "compression.png").exists()


def test_the_shear_modulus_is_kept_only_where_it_was_wanted(scaling):
    dataset, folder = scaling
    optimised = dataset.shear_modulus_0.sel(population="shear_modulus")
    assert (optimised > dataset.shear_modulus_0.drop_sel(population="shear_modulus")).all()
    assert (optimised < dataset.bound).all()
    detailed = dataset.isel(seed=slice(0, 2))
    assert (detailed.shear_modulus_of_threshold.sel(threshold=0.1) == optimised.isel(seed=slice(0, 2))).all()
    assert (detailed.shear_modulus_of_threshold.diff("threshold") < 0).all()
    assert np.isnan(dataset.objective_of_start.isel(seed=2)).all()
    assert (dataset.threshold_status.isel(seed=2) == Status.missing).all()
    for n_vertices in dataset.n_vertices.values:
        expected = modulus_bound(voronoi_network(int(n_vertices), 1), pure_shear(2))
        assert float(dataset.bound.sel(seed=1, n_vertices=n_vertices)) == pytest.approx(expected, rel=1e-13)
    assert (folder / "figures" / "shear_scaling.png").exists()


@pytest.mark.parametrize(
    "study, setting, sentence",
    [
        ("shear_ascent", "method=steepest", "lbfgs, fire"),
        ("shear_ascent", "n_vertices=7", "n_vertices"),
        ("shear_ascent_scaling", "fractions=0.5,1.5", "between 0 and 1"),
        ("shear_ascent_scaling", "n_steps=0", "at least 1"),
        ("shear_scaling", "populations=shear", "no population"),
        ("shear_scaling", "thresholds=0,0.1", "positive"),
        ("shear_scaling", "n_starts=0", "at least 1"),
    ],
)
def test_bad_settings_are_refused_before_anything_runs(study, setting, sentence, tmp_path, capsys):
    assert main(["run", study, "--out", str(tmp_path / "out"), "--set", setting]) == 2
    assert sentence in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


# What the reports compute of themselves


def report(study, name):
    """A function of the files beside a study."""
    figure = next(iter(load_study(study).study.figures.values()))
    return vars(sys.modules[figure.__module__])[name]


def test_an_exponent_is_recovered_with_its_interval():
    exponent = report("shear_scaling", "exponent")
    sizes, rng = np.array([100, 200, 500, 1000]), np.random.default_rng(4)
    inside = 0
    for _ in range(40):
        values = (sizes**-0.8)[:, None] * rng.standard_normal((4, 60)) ** 2
        fit = exponent(sizes, values)
        assert fit[1] < fit[0] < fit[2]
        inside += fit[1] <= -0.8 <= fit[2]
    # 95 % intervals: 38 of 40 are expected, 33 or fewer once in a thousand times.
    assert inside >= 34


def test_the_expected_best_of_some_starts_by_enumeration():
    best_of_first = report("shear_scaling", "_best_of_first")
    values = np.array([[0.3, 0.9, 0.5, 0.7], [1.0, 0.2, 0.4, 0.8]])
    for picked in (1, 2, 3, 4):
        expected = [np.mean([max(some) for some in combinations(row, picked)]) / row.max() for row in values]
        np.testing.assert_allclose(best_of_first(values)[:, picked - 1], expected, rtol=1e-13)
