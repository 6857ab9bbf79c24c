"""The notebooks run as they are, compute an ensemble where none is found, and arrive where they say they do."""

import re
import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pytest

from critflow.command.example_data import ensemble_path
from critflow.workflow.load import named_studies

ROOT = Path(__file__).parents[2]
sys.path.append(str(ROOT / "docs" / "_ext"))

import programs  # noqa: E402

FOLDER = ROOT / "docs" / "notebooks"
NAMES = [path.stem for path in programs.notebooks()]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder without an ensemble; the first notebook that runs in it computes one."""
    return tmp_path_factory.mktemp("notebooks")


@pytest.fixture
def execute(monkeypatch, folder):
    """The names, pictures and printed text of an executed notebook."""
    monkeypatch.setattr(sys, "argv", ["notebook"])

    def run(name):
        cells, names = programs.execute_notebook(FOLDER / f"{name}.py", folder)
        names["ensemble"].close()
        assert not plt.get_fignums(), "a figure was drawn and never shown"
        return names, [picture for cell in cells for picture in cell.pictures], "".join(cell.printed for cell in cells)

    return run


def test_there_are_four_and_none_is_a_study():
    assert [name[:2] for name in NAMES] == ["01", "02", "03", "04"]
    assert not set(NAMES) & set(named_studies())
    text = (ROOT / "docs" / "index.md").read_text(encoding="utf-8")
    assert all(f"(notebooks/{name}.py)" in text for name in NAMES)


def test_a_first_look(execute):
    names, pictures, said = execute("01_first_look")
    assert len(pictures) == 2
    table = names["table"]
    good = names["ensemble"].status.sel(population="random_stress") == 0
    assert table.members.sel(population="random_stress") == good.sum() == 4
    for word in ("slack_edges", "critflow run ensemble", "tension_variance", "n_vertices", "C_B undefined in"):
        assert word in said, word
    shown = re.search(r"bulk_modulus +B_0 = +(\S+) ± (\S+)", said)
    B_0 = names["ensemble"].bulk_modulus_0.sel(population="bulk_modulus").values
    np.testing.assert_allclose([float(shown[1]), float(shown[2])], [B_0.mean(), B_0.std()], rtol=0, atol=5e-5)


def test_structure_and_response(execute):
    names, pictures, _ = execute("02_structure_and_response")
    assert len(pictures) == 3
    between, within = names["between"], names["within"]
    assert between.shape == within.shape == (4, 4)
    assert np.nanmax(np.abs([between, within])) <= 1 + 1e-12
    # B_0 falls with the tension variance, between populations and within.
    assert between[0, 1] < -0.5 and within[0, 1] < 0
    rank = names["rank_correlation"]
    x = np.array([1.0, 5.0, 2.0, np.nan, 9.0])
    assert rank(x, x**3) == pytest.approx(1) and rank(x, -x) == pytest.approx(-1)
    assert np.isnan(rank(x, np.ones(5)))


def test_from_the_transition_to_stiffening(execute):
    names, pictures, _ = execute("03_critical_to_stiffening")
    assert len(pictures) == 1
    assert np.abs(names["critical"].coordinates - names["one"].coordinates.values).max() < 1e-12
    # Errors fall with the window, as its first and second power.
    line, parabola = np.log(names["errors"][:, 1:4])
    rates = np.diff([line, parabola], axis=1) / np.diff(np.log(names["windows"][1:4]))
    np.testing.assert_allclose(rates.mean(axis=1), [1.0, 2.0], rtol=0, atol=0.1)
    for name, value in names["by_hand"].items():
        assert value == pytest.approx(getattr(names["library"], name), rel=1e-9)
    np.testing.assert_allclose(names["ratio"], -0.5, rtol=1e-9)


def test_designing_with_isogonal_modes(execute):
    names, pictures, _ = execute("04_designing_with_isogonal_modes")
    assert len(pictures) == 2
    assert 0.2 < names["gain"] < 1
    assert np.abs(names["gradient"]).max() < 1e-10
    np.testing.assert_allclose(names["B_0"], names["bound"], rtol=1e-12)
    assert (np.diff(names["affine"]) > 0).all()
    perimeter = {key: names[key].lengths[names["sides"]].sum() for key in ("start", "large", "even")}
    assert perimeter["large"] > 1.5 * perimeter["start"]
    assert names["miss"] < 1e-11


def test_the_file_is_found_by_environment_and_above(folder, monkeypatch, tmp_path):
    monkeypatch.setattr(sys, "argv", ["kernel", "-f", "connection.json"])
    below = tmp_path / "results" / "ensemble" / "deep"
    below.mkdir(parents=True)
    (below.parent / "ensemble.nc").touch()
    monkeypatch.chdir(below)
    assert ensemble_path() == below.parent / "ensemble.nc"
    monkeypatch.setenv("CRITFLOW_ENSEMBLE", str(folder / "mine.nc"))
    assert ensemble_path() == folder / "mine.nc"
