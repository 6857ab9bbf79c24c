"""`critflow verify` recomputes what the smaller studies stored, and names what does not follow."""

import numpy as np
import pytest
import xarray as xr

from critflow.cli import main
from critflow.workflow.load import load_study

STUDIES = {
    "boundary": ("n_vertices=12", "seeds=0:2"),
    "three_bar": ("s=-2.1:2.1:0.3",),
    "shear_ascent": ("seeds=0:1", "n_vertices=40", "steps=0,5,50"),
}
# A stored variable to change, and what verify says does not follow then.
CHANGED = [
    ("boundary", "boundary_vectors", "boundary_vectors, bond_vectors"),
    ("boundary", "sigma", "force balance"),
    ("boundary", "sheared_bond_vectors", "sheared_bond_vectors at 0"),
    ("three_bar", "length", "tension"),
    ("three_bar", "normal", "normal"),
    ("three_bar", "metric", "metric"),
    ("shear_ascent", "shear_modulus", "shear_modulus"),
    ("shear_ascent", "longest_edge", "longest_edge"),
    ("shear_ascent", "compressed_edges", "compressed_edges"),
]


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    made = {}
    for study, settings in STUDIES.items():
        made[study] = tmp_path_factory.mktemp(study) / "out"
        words = [word for setting in settings for word in ("--set", setting)]
        assert main(["run", study, "--workers", "0", "--out", str(made[study]), *words]) == 0
    return made


@pytest.mark.parametrize("study", STUDIES)
def test_good_folders_are_believed(folders, study, capsys):
    assert main(["verify", str(folders[study])]) == 0
    assert "and with their physics" in capsys.readouterr().out


@pytest.mark.parametrize("study, variable, said", CHANGED)
def test_what_does_not_follow_is_named(folders, study, variable, said):
    with xr.open_dataset(folders[study] / f"{study}.nc") as dataset:
        changed = dataset.load().copy(deep=True)
    rng = np.random.default_rng(1)
    values = changed[variable].values
    changed[variable].values[...] = values + 1 + rng.random(values.shape)
    problems = load_study(study).study.verify(changed)
    assert problems
    assert all(said in problem for problem in problems), problems


def test_a_study_that_recomputes_nothing_says_so(tmp_path, capsys):
    settings = ("seeds=0:1", "n_vertices=40", "n_steps=5", "fractions=0.01", "algorithms=lbfgs")
    words = [word for setting in settings for word in ("--set", setting)]
    assert main(["run", "shear_ascent_scaling", "--workers", "0", "--out", str(tmp_path / "out"), *words]) in (0, 1)
    main(["verify", str(tmp_path / "out")])
    assert "recomputes no physics" in capsys.readouterr().out
