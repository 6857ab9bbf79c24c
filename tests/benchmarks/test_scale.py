"""The study of scale end to end, small: its stages agree with calls one by one, and its report follows from them."""

import json
import sys

import pytest
import xarray as xr

from critflow import Status, bulk_modulus_bound, optimize, stiffening, voronoi_network
from critflow.cli import main
from critflow.workflow.load import load_study

SIZES = 100, 200


@pytest.fixture(scope="module")
def scale(tmp_path_factory):
    folder = tmp_path_factory.mktemp("scale")
    words = "--set", "n_vertices=100,200", "--set", "least_time=0.01"
    assert main(["run", "scale", "--workers", "0", "--out", str(folder), *words]) == 0
    with xr.open_dataset(folder / "scale.nc") as dataset:
        return dataset.load(), folder


def report(name):
    """A function of the files next to the study."""
    return vars(sys.modules[load_study("scale").study.claims.__module__])[name]


def test_every_stage_is_timed_and_ends_well(scale):
    dataset, _ = scale
    assert dataset.seconds.dims == ("seed", "n_vertices", "stage")
    assert (dataset.seconds > 0).all() and (dataset.seconds < 60).all()
    assert (dataset.memory > 10).all() and (dataset.memory < 1e5).all()
    assert (dataset.stage_status == Status.ok).all()
    # Repeated until the least time is spent.
    assert (dataset.repeats.sel(stage="gradient") > 1).all()
    checked = dataset.error.sel(stage=["configuration", "gradient", "checked", "optimum", "moduli", "coefficients"])
    assert (checked < 1e-11).all()
    assert (dataset.backend.sel(stage=["points", "tessellation"]) == 0).all()
    assert (dataset.backend.sel(stage=["configuration", "coefficients"]) > 0).all()


@pytest.mark.parametrize("n_vertices", SIZES)
def test_the_case_is_the_standard_network(scale, n_vertices):
    one = scale[0].sel(seed=0, n_vertices=n_vertices)
    network = voronoi_network(n_vertices, seed=0)
    best = optimize(network, "bulk_modulus").value
    exact = stiffening(best).value
    assert float(one.bulk_modulus) == pytest.approx(bulk_modulus_bound(network), rel=1e-12)
    assert float(one.shear_modulus) == pytest.approx(exact.shear_0, rel=1e-10)
    assert float(one.C_B) == pytest.approx(exact.C_B, rel=1e-11)
    assert float(one.C_G) == pytest.approx(exact.C_G, rel=1e-11)
    assert abs(float(one.gap)) < 1e-13
    assert float(one.change_by_refinement) < 1e-12


def test_the_report_has_its_figure_claims_and_profile(scale, assert_picture):
    dataset, folder = scale
    assert_picture(folder / "figures" / "scale.png", 20_000)
    claims = {claim["key"]: claim for claim in json.loads((folder / "claims.json").read_text())}
    for key in ("Scale-memory", "Scale-certificate", "Scale-status"):
        assert claims[key]["verdict"] == "holds", claims[key]
    # Nothing is said of a million vertices, nor of exponents, by a run of small networks.
    assert not {"Scale-generation", "Scale-configuration"} & claims.keys()
    summary = json.loads((folder / "summary.json").read_text())
    for shares in summary["share_of_time"].values():
        assert sum(shares.values()) == pytest.approx(1.0, rel=1e-12)
    largest = dataset.seconds.sel(stage="gradient", n_vertices=200).item()
    assert summary["seconds"]["gradient"][-1] == pytest.approx(largest)
    assert summary["solver"]["coefficients"] == ["qdldl", "qdldl"]


def imagined(scale, power, memory=1000.0):
    """The dataset as if its networks had 10⁴ and 10⁶ vertices and its times grew with a power of that."""
    dataset = scale[0].copy(deep=True).assign_coords(n_vertices=[10_000, 1_000_000])
    dataset.seconds[..., 0, :] = 0.1
    dataset.seconds[..., 1, :] = 0.1 * 100**power
    dataset.memory[...] = memory
    return dataset


@pytest.mark.parametrize(
    "power, memory, differ",
    [(0.8, 1000.0, set()), (1.1, 9000.0, {"memory", "generation"}), (1.3, 1000.0, {"configuration", "generation"})],
)
def test_claims_are_judged_by_what_was_asked(scale, power, memory, differ):
    dataset = imagined(scale, power, memory)
    assert report("fitted")(dataset, "configuration") == pytest.approx(power, rel=1e-12)
    claims = {claim.key.removeprefix("Scale-"): claim for claim in report("claims")(dataset)}
    assert {key for key, claim in claims.items() if claim.verdict == "differs"} == differ
    assert {"memory", "generation", "configuration", "status", "certificate"} <= claims.keys()
    assert load_study("scale").study.figures["scale"](dataset).axes


@pytest.mark.parametrize(
    "setting, sentence",
    [
        ("n_vertices=101", "must be even"),
        ("n_vertices=20", "at least 40"),
        ("least_time=0", "must be positive"),
        ("stages=points", "always all of"),
    ],
)
def test_bad_settings_are_refused_before_anything_runs(setting, sentence, tmp_path, capsys):
    assert main(["run", "scale", "--out", str(tmp_path / "out"), "--set", setting]) == 2
    assert sentence in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


# The condensed saddle
