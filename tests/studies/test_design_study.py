"""The study of design end to end, small: every module is run and reported."""

import numpy as np
import pytest

from critflow import Status
from critflow.command.main import main
from workflows.design.study import PARTS, study

STUDY = "design"


def test_every_part_has_a_figure_and_claims(dataset, folder):
    assert (dataset.status == Status.ok).all()
    assert set(study.figures) == set(PARTS)
    for part in PARTS:
        assert (folder / "figures" / f"{part}.png").exists()


def test_a_run_of_one_part_leaves_the_others_undefined(dataset):
    for name, variable in dataset.items():
        part = str(name).split("_")[0]
        if part in PARTS and variable.dtype.kind == "f":
            others = variable.sel(part=[other for other in PARTS if other != part])
            assert np.isnan(others).all()


@pytest.mark.parametrize(
    "setting, word", [("parts=colour", "part"), ("topology_cuts=0", "of topology"), ("topology_cuts=24000", "smaller")]
)
def test_bad_settings_are_refused_before_anything_runs(setting, word, tmp_path, capsys):
    assert main(["run", STUDY, "--out", str(tmp_path / "out"), "--set", setting]) == 2
    assert word in capsys.readouterr().err
