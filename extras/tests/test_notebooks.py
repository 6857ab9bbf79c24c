"""The notebook of the extras runs, on the dataset of one small network."""

import numpy as np
import pytest

from critflow.command.main import main
from workflows.pages.notebooks import EXTRAS, cells_of, execute


@pytest.mark.sweep
def test_isogonal_modes_keep_the_bulk_modulus(tmp_path, monkeypatch, empty_pictures):
    monkeypatch.delenv("CRITFLOW_ENSEMBLE", raising=False)
    settings = [f"--set={word}" for word in ("seeds=0:1", "n_vertices=60", "strains=0.001:0.003:0.001")]
    with empty_pictures():
        assert (
            main(["run", "ensemble", "--workers", "0", "--out", str(tmp_path / "results" / "ensemble"), *settings]) == 0
        )
    cells, names = execute(cells_of(EXTRAS / "04_designing_with_isogonal_modes.ipynb"), "isogonal", tmp_path)
    shown = [one for cell in cells for one in cell.get("outputs", []) if "image/png" in one.get("data", {})]
    assert len(shown) == 2
    assert names["smaller"] < names["V_L"] and np.ptp(names["B_0"]) < 1e-12
    assert names["miss"] < 1e-12
