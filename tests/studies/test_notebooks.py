"""The notebooks run as they are, and the committed ones show what they print and draw.

The committed outputs are those of `critflow run ensemble`; here the notebooks run on small networks.
"""

import base64
import json
import re

import matplotlib.pyplot as plt
import numpy as np
import pytest
from scipy.stats import spearmanr

from critflow.command.main import ensemble_path
from critflow.engine.code_digest import named_studies
from workflows.pages.notebooks import DOCS, EXTRAS, FOLDER, PAGES, cells_of, cells_of_page, digest, execute, source

PICTURES = {
    "01_first_look": 2,
    "02_structure_and_response": 3,
    "03_critical_to_stiffening": 1,
    "05_does_force_anisotropy_predict_C_G": 1,
}
COMMITTED = sorted([*FOLDER.glob("*.ipynb"), *EXTRAS.glob("*.ipynb")])
LINES_BEFORE_A_RESULT = 12
LARGEST_PICTURE, LARGEST_NOTEBOOK = 60_000, 400_000  # bytes
# What differs from one machine, day or version to another.
OF_A_MACHINE = r"/(home|root|tmp|work|Users|usr)/|\.venv|20\d\d-\d\d-\d\d|[Ww]arning|Traceback"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder without an ensemble; the first notebook that runs in it computes one."""
    return tmp_path_factory.mktemp("notebooks")


@pytest.fixture
def run(monkeypatch, folder):
    """A function that executes cells, and returns them with their outputs, and their names."""
    monkeypatch.delenv("CRITFLOW_ENSEMBLE", raising=False)

    def executed(cells, name):
        cells, names = execute(cells, name, folder)
        if "ensemble" in names:
            names["ensemble"].close()
        return cells, names

    return executed


def outputs(cells):
    return [output for cell in cells if cell["cell_type"] == "code" for output in cell["outputs"]]


def pictures(cells):
    return [base64.b64decode(one["data"]["image/png"]) for one in outputs(cells) if "image/png" in one.get("data", {})]


def printed(cells):
    return ["".join(one["text"]) for one in outputs(cells) if one["output_type"] == "stream"]


def test_they_are_listed_and_none_is_a_study():
    assert {path.stem for path in FOLDER.glob("*.ipynb")} == {*PICTURES, *PAGES}
    assert not set(PICTURES) & set(named_studies())
    text = (DOCS / "index.md").read_text(encoding="utf-8")
    assert all(f"notebooks/{name}.ipynb)" in text for name in PICTURES)


@pytest.mark.parametrize("path", COMMITTED, ids=lambda path: path.stem)
def test_a_committed_notebook_shows_its_results(path):
    """Those of its code, small, and nothing that is of one machine or one day."""
    assert path.stat().st_size <= LARGEST_NOTEBOOK
    whole = json.loads(path.read_text(encoding="utf-8"))
    cells = whole["cells"]
    assert (whole["nbformat"], whole["nbformat_minor"]) == (4, 5)
    assert cells[0]["cell_type"] == "markdown" and source(cells[0]).startswith("# ")
    assert len({cell["id"] for cell in cells}) == len(cells)
    assert whole["metadata"]["code"] == digest(cells), "execute it: python -m workflows.pages.notebooks"
    lines = 0
    for cell in cells:
        shown = outputs([cell])
        lines += 0 if cell["cell_type"] != "code" else len([line for line in source(cell).splitlines() if line.strip()])
        if shown:
            break
    assert lines <= LINES_BEFORE_A_RESULT or path.stem in PAGES, "lines before the first result"
    for cell in (cell for cell in cells if cell["cell_type"] == "code"):
        text = source(cell)
        assert not re.search(r"^print\(", text, flags=re.M) or printed([cell]), text
        assert len(pictures([cell])) == text.count("plt.show()"), text
    assert all(len(picture) <= LARGEST_PICTURE for picture in pictures(cells))
    of_pages = [one for one in outputs(cells) if "image/png" not in one.get("data", {})]
    found = re.search(OF_A_MACHINE, json.dumps(of_pages, ensure_ascii=False))
    assert not found, found


@pytest.mark.parametrize("name", PAGES)
def test_a_notebook_of_a_page_is_that_of_the_page(name, run):
    page = DOCS / f"{name}.md"
    text = page.read_text(encoding="utf-8")
    assert f"(notebooks/{name}.ipynb)" in text
    cells, committed = cells_of_page(page), cells_of(FOLDER / f"{name}.ipynb")
    assert [source(cell) for cell in cells] == [source(cell) for cell in committed]
    shown = re.findall(r"^```output\n(.*?)^```$", text, flags=re.M | re.S)
    assert printed(committed) == printed(run(cells, name)[0]) == shown


@pytest.mark.parametrize("name", PICTURES)
def test_a_notebook_runs(run, name):
    cells, names = run(cells_of(FOLDER / f"{name}.ipynb"), name)
    assert not plt.get_fignums(), "a figure was drawn and never shown"
    assert len(pictures(cells)) == PICTURES[name]
    ARRIVES[name](names, cells)


def first_look(names, cells):
    assert names["ensemble"].B_0.chunks is not None  # opened by dask
    assert names["ensemble"].V_tau.attrs["symbol"] == "$V_\\tau$"
    assert (names["right"].get_xlabel(), names["right"].get_ylabel()) == ("$B_0$", "$C_B$")
    B_0 = names["ensemble"].B_0.sel(population="max_B_0").values
    row = names["table"].sel(population_label="max B_0")
    shown = [float(row[key]) for key in ("n", "mean", "std", "error of the mean")]
    std = B_0.std(ddof=1)
    np.testing.assert_allclose(shown, [B_0.size, B_0.mean(), std, std / B_0.size**0.5], rtol=1e-12)


def structure(names, cells):
    for values, low, high in names["ranges"].values():
        assert np.all(low <= values + 1e-15) and np.all(values <= high + 1e-15)
        assert values[0, 1] < 0  # V_τ and B_0
    assert names["between"][0, 1] < -0.5


def stiffening(names, cells):
    # Errors fall with the window, as its first and second power.
    line, parabola = np.log(names["errors"][:, 1:4])
    rates = np.diff([line, parabola], axis=1) / np.diff(np.log(names["windows"][1:4]))
    np.testing.assert_allclose(rates.mean(axis=1), [1.0, 2.0], rtol=0, atol=0.1)
    for key, value in names["by_hand"].items():
        assert value == pytest.approx(getattr(names["library"], key), rel=1e-9)


def anisotropy(names, cells):
    """The correlations are those of SciPy, without one population too; a constant has none."""
    medians = names["measures"].median("seed")
    for convention in names["COEFFICIENTS"]:
        value, low, high = (one.sel(convention=convention).item() for one in names["estimates"]["between populations"])
        parts = [medians, *(medians.drop_sel(population=name) for name in medians.population.values)]
        expected = [spearmanr(part.kappa_force, part[convention]).statistic for part in parts]
        np.testing.assert_allclose([value, low, high], [expected[0], min(expected[1:]), max(expected[1:])], atol=1e-12)
    same = np.ones((2, 5))
    assert np.isnan(names["rank_correlation"](same, same)).all()
    assert next(text for text in printed(cells) if "predicts C_G:" in text).rstrip().endswith(("yes", "no"))


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
