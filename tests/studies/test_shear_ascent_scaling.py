"""The scaling of compressed edges study end to end, small: parts of the bound and exponents."""

import pytest

from critflow.command.main import main
from critflow.result import Status

STUDY = "shear_ascent_scaling"


def test_parts_of_the_bound_are_met_in_order(dataset, folder):
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


def test_a_study_that_recomputes_nothing_says_so(folder, capsys):
    assert main(["verify", str(folder)]) == 0
    assert "recomputes no physics" in capsys.readouterr().out


@pytest.mark.parametrize("setting, word", [("fractions=0.5,1.5", "between"), ("n_steps=0", "least")])
def test_bad_settings_are_refused_before_anything_runs(setting, word, tmp_path, capsys):
    assert main(["run", STUDY, "--out", str(tmp_path / "out"), "--set", setting]) == 2
    assert word in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
