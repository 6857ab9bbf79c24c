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
    assert NAMES == list(PICTURES)
    assert not set(NAMES) & set(named_studies())
    text = (ROOT / "docs" / "index.md").read_text(encoding="utf-8")
    assert all(f"(notebooks/{name}.py)" in text for name in NAMES)


PICTURES = {
    "01_first_look": 2,
    "02_structure_and_response": 3,
    "03_critical_to_stiffening": 1,
    "04_designing_with_isogonal_modes": 2,
}


@pytest.mark.parametrize("name", PICTURES)
def test_a_notebook_shows_its_pictures(execute, name):
    names, pictures, said = execute(name)
    assert len(pictures) == PICTURES[name]
    if name == "01_first_look":
        shown = re.search(r"max_B_0 +B_0 = +(\S+) ± (\S+)", said)
        B_0 = names["ensemble"].B_0.sel(population="max_B_0").values
        np.testing.assert_allclose([float(shown[1]), float(shown[2])], [B_0.mean(), B_0.std()], rtol=0, atol=5e-5)
    if name == "03_critical_to_stiffening":
        # Errors fall with the window, as its first and second power.
        line, parabola = np.log(names["errors"][:, 1:4])
        rates = np.diff([line, parabola], axis=1) / np.diff(np.log(names["windows"][1:4]))
        np.testing.assert_allclose(rates.mean(axis=1), [1.0, 2.0], rtol=0, atol=0.1)
        for key, value in names["by_hand"].items():
            assert value == pytest.approx(getattr(names["library"], key), rel=1e-9)


def test_the_file_is_found_by_environment_and_above(folder, monkeypatch, tmp_path):
    monkeypatch.setattr(sys, "argv", ["kernel", "-f", "connection.json"])
    below = tmp_path / "results" / "ensemble" / "deep"
    below.mkdir(parents=True)
    (below.parent / "ensemble.nc").touch()
    monkeypatch.chdir(below)
    assert ensemble_path() == below.parent / "ensemble.nc"
    monkeypatch.setenv("CRITFLOW_ENSEMBLE", str(folder / "mine.nc"))
    assert ensemble_path() == folder / "mine.nc"
