"""The notebooks run as they are, on a small ensemble, and arrive where they say they do."""

import io
import re
import runpy
import sys
from pathlib import Path

import matplotlib
import matplotlib.pyplot as plt
import numpy as np
import pytest

from critflow.cli import main
from critflow.workflow.load import named_studies

matplotlib.use("Agg")

FOLDER = Path(__file__).parents[2] / "workflows" / "notebooks"
NAMES = sorted(path.stem for path in FOLDER.glob("*.py"))


@pytest.fixture(scope="module")
def ensemble(tmp_path_factory):
    folder = tmp_path_factory.mktemp("notebooks") / "ensemble"
    settings = ["--set", "n_vertices=60", "--set", "seeds=0:4", "--set", "strains=0.002,0.005,0.01"]
    assert main(["run", "ensemble", "--workers", "0", "--out", str(folder), *settings]) == 0
    return folder / "ensemble.nc"


@pytest.fixture
def execute(monkeypatch, tmp_path):
    """Run a notebook in an empty folder; figures are drawn where they would be shown."""
    pictures = []

    def show():
        for number in plt.get_fignums():
            picture = io.BytesIO()
            plt.figure(number).savefig(picture, format="png", dpi=40)
            pictures.append(picture.getvalue())
        plt.close("all")

    def run(name, *words):
        plt.close("all")
        monkeypatch.chdir(tmp_path)
        monkeypatch.setattr(plt, "show", show)
        monkeypatch.setattr(sys, "argv", [f"{name}.py", *words])
        names = runpy.run_path(str(FOLDER / f"{name}.py"), run_name="__main__")
        names["ensemble"].close()
        assert not plt.get_fignums(), "a figure was drawn and never shown"
        return names, pictures

    return run


def test_there_are_four_and_none_is_a_study():
    assert [name[:2] for name in NAMES] == ["01", "02", "03", "04"]
    assert not set(NAMES) & set(named_studies())
    text = (FOLDER / "README.md").read_text(encoding="utf-8")
    assert all(f"`{name}.py`" in text for name in NAMES)


@pytest.mark.parametrize("name", NAMES)
def test_the_text_is_cells(name):
    text = (FOLDER / f"{name}.py").read_text(encoding="utf-8")
    head, *cells = re.split(r"^# %%", text, flags=re.M)
    assert head == ""
    kinds = [cell.split("\n", 1)[0].strip() for cell in cells]
    assert set(kinds) == {"", "[markdown]"} and kinds[0] == "[markdown]"
    for kind, cell in zip(kinds, cells, strict=True):
        lines = cell.split("\n")[1:]
        if kind:
            assert all(line == "" or line.startswith("#") for line in lines), "prose is comments"
        else:
            compile("\n".join(lines), name, "exec")


def test_a_first_look(execute, ensemble, capsys):
    names, pictures = execute("01_first_look", str(ensemble))
    said = capsys.readouterr().out
    assert len(pictures) == 2
    table = names["table"]
    good = names["ensemble"].status.sel(population="random_stress") == 0
    assert table.members.sel(population="random_stress") == good.sum() == 4
    for word in ("slack_edges", "critflow run ensemble", "tension_variance", "n_vertices", "C_B undefined in"):
        assert word in said, word
    shown = re.search(r"bulk_modulus +B_0 = +(\S+) ± (\S+)", said)
    B_0 = names["ensemble"].bulk_modulus_0.sel(population="bulk_modulus").values
    np.testing.assert_allclose([float(shown[1]), float(shown[2])], [B_0.mean(), B_0.std()], rtol=0, atol=5e-5)


def test_structure_and_response(execute, ensemble):
    names, pictures = execute("02_structure_and_response", str(ensemble))
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


def test_from_the_transition_to_stiffening(execute, ensemble, capsys):
    names, pictures = execute("03_critical_to_stiffening", str(ensemble))
    assert len(pictures) == 1
    assert np.abs(names["critical"].coordinates - names["one"].coordinates.values).max() < 1e-12
    # Errors fall with the window, as its first and second power.
    line, parabola = np.log(names["errors"][:, 1:4])
    rates = np.diff([line, parabola], axis=1) / np.diff(np.log(names["windows"][1:4]))
    np.testing.assert_allclose(rates.mean(axis=1), [1.0, 2.0], rtol=0, atol=0.1)
    for name, value in names["by_hand"].items():
        assert value == pytest.approx(getattr(names["library"], name), rel=1e-9)
    np.testing.assert_allclose(names["ratio"], -0.5, rtol=1e-9)


def test_designing_with_isogonal_modes(execute, ensemble):
    names, pictures = execute("04_designing_with_isogonal_modes", str(ensemble))
    assert len(pictures) == 2
    assert 0.2 < names["gain"] < 1
    assert np.abs(names["gradient"]).max() < 1e-10
    np.testing.assert_allclose(names["B_0"], names["bound"], rtol=1e-12)
    assert (np.diff(names["affine"]) > 0).all()
    perimeter = {key: names[key].lengths[names["sides"]].sum() for key in ("start", "large", "even")}
    assert perimeter["large"] > 1.5 * perimeter["start"]
    assert names["miss"] < 1e-11


def test_the_file_is_found_by_environment_and_above(execute, ensemble, monkeypatch, tmp_path):
    named = execute("01_first_look", str(ensemble))[0]["dataset_path"]
    monkeypatch.setattr(sys, "argv", ["kernel", "-f", "connection.json"])
    assert named() == Path("results/ensemble/ensemble.nc")
    below = tmp_path / "results" / "ensemble" / "deep"
    below.mkdir(parents=True)
    (below.parent / "ensemble.nc").touch()
    monkeypatch.chdir(below)
    assert named() == below.parent / "ensemble.nc"
    monkeypatch.setenv("CRITFLOW_ENSEMBLE", str(ensemble))
    assert named() == ensemble


def test_all_notebooks_find_their_file_alike():
    texts = [(FOLDER / f"{name}.py").read_text(encoding="utf-8") for name in NAMES]
    assert len({re.search(r"def dataset_path.*?\n\n\n", text, re.S)[0] for text in texts}) == 1
