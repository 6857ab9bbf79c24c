"""The notebooks run as they are, compute an ensemble where none is found, and arrive where they say they do."""

import json
import re
import sys

import matplotlib.pyplot as plt
import numpy as np
import pytest
from scipy.stats import spearmanr

from critflow.command.main import ensemble_path
from critflow.engine.code_digest import named_studies
from workflows.pages.notebooks import DOCS, FOLDER, PAGES, notebook_of

sys.path.append(str(DOCS / "_ext"))

import programs

NAMES = [path.stem for path in programs.notebooks()]
LINES_BEFORE_A_RESULT = 12
LARGEST_PICTURE, LARGEST_NOTEBOOK = 200_000, 2**20  # bytes


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder without an ensemble; the first notebook that runs in it computes one."""
    return tmp_path_factory.mktemp("notebooks")


@pytest.fixture
def execute(monkeypatch, folder):
    """The names and cells of an executed notebook."""
    monkeypatch.delenv("CRITFLOW_ENSEMBLE", raising=False)

    def run(name):
        path = FOLDER / f"{name}.ipynb"
        cells, names = programs.execute_notebook(path, folder)
        if "ensemble" in names:
            names["ensemble"].close()
        return names, cells

    return run


def test_they_are_listed_and_none_is_a_study():
    assert NAMES == list(PICTURES)
    assert not set(NAMES) & set(named_studies())
    for page in (DOCS / "index.md", DOCS / "howto" / "dataset.md"):
        text = page.read_text(encoding="utf-8")
        assert all(f"notebooks/{name}.ipynb)" in text for name in NAMES)
    assert {path.stem for path in FOLDER.glob("*.ipynb")} == {*NAMES, *PAGES}


@pytest.mark.parametrize("path", sorted(FOLDER.glob("*.ipynb")), ids=lambda path: path.stem)
def test_a_stored_notebook_has_no_outputs_and_is_valid(path):
    assert path.stat().st_size < LARGEST_NOTEBOOK
    whole = json.loads(path.read_text(encoding="utf-8"))
    assert (whole["nbformat"], whole["nbformat_minor"]) == (4, 5)
    cells = whole["cells"]
    assert cells[0]["cell_type"] == "markdown" and "".join(cells[0]["source"]).startswith("# ")
    assert len({cell["id"] for cell in cells}) == len(cells)
    for cell in cells:
        if cell["cell_type"] == "code":
            assert cell["outputs"] == [] and cell["execution_count"] is None
        for picture in cell.get("attachments", {}).values():
            assert len(picture["image/png"]) < LARGEST_PICTURE


@pytest.mark.parametrize("name", PAGES)
def test_a_notebook_of_a_page_is_that_of_the_page(name, execute):
    text = (FOLDER / f"{name}.ipynb").read_text(encoding="utf-8")
    assert text == notebook_of(DOCS / f"{name}.md"), "write it again: python -m workflows.pages.notebooks"
    assert f"(notebooks/{name}.ipynb)" in (DOCS / f"{name}.md").read_text(encoding="utf-8")
    _, cells = execute(name)
    shown = re.findall(r"^```output\n(.*?)^```$", (DOCS / f"{name}.md").read_text(encoding="utf-8"), flags=re.M | re.S)
    assert [cell.printed for cell in cells if cell.printed] == shown
    check_size(name, cells)
    plt.close("all")


PICTURES = {
    "01_first_look": 2,
    "02_structure_and_response": 3,
    "03_critical_to_stiffening": 1,
    "04_designing_with_isogonal_modes": 2,
    "05_does_force_anisotropy_predict_C_G": 1,
}


@pytest.mark.parametrize("name", PICTURES)
def test_a_notebook_shows_its_pictures(execute, name):
    names, cells = execute(name)
    assert not plt.get_fignums(), "a figure was drawn and never shown"
    assert sum(len(cell.pictures) for cell in cells) == PICTURES[name]
    check_size(name, cells)
    ARRIVES.get(name, lambda names, cells: None)(names, cells)


def check_size(name, cells):
    """The outputs of a notebook, and the code before its first one."""
    lines = 0
    for cell in cells:
        lines += len([line for line in cell.text.splitlines() if line.strip()]) if cell.code else 0
        if cell.printed or any(cell.value) or cell.pictures:
            break
    assert lines <= LINES_BEFORE_A_RESULT, f"{name}: {lines} lines before its first result"
    pictures = [len(picture) * 4 / 3 for cell in cells for picture in cell.pictures]  # in base 64
    assert max(pictures, default=0) < LARGEST_PICTURE
    assert sum(pictures) + sum(len(part) for cell in cells for part in (cell.printed, *cell.value)) < LARGEST_NOTEBOOK


def first_look(names, cells):
    assert "xr-wrap" in next(cell.value[1] for cell in cells if cell.code)  # the view of a dataset
    assert names["ensemble"].B_0.chunks is not None  # opened by dask
    B_0 = names["ensemble"].B_0.sel(population="max_B_0").values
    row = names["table"].sel(population_label="max B_0")
    shown = [float(row[key]) for key in ("n", "mean", "std", "error of the mean")]
    std = B_0.std(ddof=1)
    np.testing.assert_allclose(shown, [B_0.size, B_0.mean(), std, std / B_0.size**0.5], rtol=1e-12)


def structure(names, cells):
    between, within = names["estimates"]
    assert between[0, 1] < -0.5 and within[0, 1] < 0  # V_τ and B_0
    assert np.all(names["low"] <= names["high"] + 1e-15)


def stiffening(names, cells):
    # Errors fall with the window, as its first and second power.
    line, parabola = np.log(names["errors"][:, 1:4])
    rates = np.diff([line, parabola], axis=1) / np.diff(np.log(names["windows"][1:4]))
    np.testing.assert_allclose(rates.mean(axis=1), [1.0, 2.0], rtol=0, atol=0.1)
    for key, value in names["by_hand"].items():
        assert value == pytest.approx(getattr(names["library"], key), rel=1e-9)


def anisotropy(names, cells):
    """The correlations are those of SciPy; a resample of one network has none within a population."""
    medians = names["measures"].median("seed")
    for convention in names["COEFFICIENTS"]:
        expected = spearmanr(medians.kappa_force, medians[convention]).statistic
        where = {"convention": convention, "population_label": "between populations", "draw": 0}
        assert names["estimates"].sel(where).item() == pytest.approx(expected, abs=1e-12)
    same = np.ones((2, 5))
    assert np.isnan(names["spearman"](same, same)).all()
    said = [cell.printed for cell in cells if "predicts C_G:" in cell.printed]
    assert said and said[0].rstrip().endswith(("yes", "no"))


ARRIVES = {
    "01_first_look": first_look,
    "02_structure_and_response": structure,
    "03_critical_to_stiffening": stiffening,
    "05_does_force_anisotropy_predict_C_G": anisotropy,
}


def test_the_file_is_found_by_environment_and_above(folder, monkeypatch, tmp_path):
    monkeypatch.delenv("CRITFLOW_ENSEMBLE", raising=False)
    below = tmp_path / "results" / "ensemble" / "deep"
    below.mkdir(parents=True)
    (below.parent / "ensemble.nc").touch()
    monkeypatch.chdir(below)
    assert ensemble_path() == below.parent / "ensemble.nc"
    monkeypatch.setenv("CRITFLOW_ENSEMBLE", str(folder / "mine.nc"))
    assert ensemble_path() == folder / "mine.nc"
