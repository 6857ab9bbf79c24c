"""Settings that could only fail are refused in one sentence before anything runs; `verify` names contradictions."""

import numpy as np
import pytest

from critflow.command.main import main
from critflow.engine.code_digest import load_study

SETTINGS = {
    "boundary": {"n_vertices=7": "n_vertices"},
    "ensemble": {
        **{"n_vertices=61": "even", "n_vertices=2": "even", "n_vertices=1000000000": "vertices"},
        **{"hard_core=1.2": "", "strains=0": "", "threshold=0.0": "positive"},
        **{"deformation=uniaxial_free": "simple_shear", "strains=0.001,0.002": "contains 2 of the strains"},
        **{"fit_window=0.0025": "need 3"},
    },
    "failure_map": {
        **{"quantities=colour": "no quantity", "n_steps=1": "at least 2"},
        **{"difficulties=smalest": "did you mean 'smallest'", "n_vertices=7": "n_vertices"},
    },
    "gallery": {
        **{"thresholds=0.1,0.03": "three positive numbers", "fraction=1.0": "between 0 and 1"},
        **{"shortest=0.0": "must be positive", "n_vertices=7": "vertices"},
    },
    "percolation": {"n_vertices=7": "n_vertices"},
    "shear": {
        **{"method=steepest": "fire", "algorithms=steepest": "fire", "n_vertices=7": "n_vertices"},
        **{"fractions=0.5,1.5": "between", "n_steps=0": "least", "n_starts=0": "least"},
        **{"detailed_seeds=0": "least"},
        **{"populations=shear": "population", "thresholds=0,0.1": "positive"},
    },
    "speed": {
        **{"contestants=auto,lammps": "no method 'lammps'", "gammas=0,0.9": "between 0"},
        **{"patience=0": "patience=0.0 must be positive", "least_time=0": "must be positive"},
        **{"n_vertices=7": "n_vertices", "n_vertices=20": "at least 40"},
    },
    "three_bar": {"span=-1": "span", "reach=1": "reach", "s=0:1:0.5": "s needs"},
}


@pytest.mark.parametrize(
    "study, setting, word", [(study, *row) for study, rows in SETTINGS.items() for row in rows.items()]
)
def test_settings_that_could_only_fail_are_refused(study, setting, word, tmp_path, capsys):
    assert main(["run", study, "--workers", "0", "--out", str(tmp_path / "out"), "--set", setting]) == 2
    message = capsys.readouterr().err.strip()
    assert message.startswith("critflow: ") and "\n" not in message and word in message
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    "study, variable, contradicted",
    [
        ("boundary", "boundary_vectors", "boundary_vectors"),
        ("boundary", "sigma", "sigma, force balance"),
        ("boundary", "sheared_cell", "sheared_cell at 0"),
        ("boundary", "sheared_bond_vectors", "sheared_bond_vectors at 0"),
        *(("ensemble", name, name) for name in ("C_B_fit", "energy", "stressed_fraction", "residual")),
        *(
            ("ensemble", name, word)
            for name, word in (("C_G_fit_standard_error", "C_G_fit"), ("sigma", "force balance"))
        ),
        ("shear", "G_0_ascent", "G_0_ascent"),
        ("shear", "longest_edge", "longest_edge"),
        ("shear", "least_tension", "least_tension"),
        ("shear", "compressed_edges", "compressed_edges"),
        ("shear", "compressed_length", "compressed_length"),
        ("three_bar", "length", "tension"),
        ("three_bar", "normal", "normal"),
        ("three_bar", "metric", "metric"),
    ],
)
def test_verify_names_what_does_not_follow(runs, study, variable, contradicted, capsys):
    folder, dataset = runs(study)
    assert main(["verify", str(folder)]) == 0
    assert "with the same result" in capsys.readouterr().out
    changed = dataset.copy(deep=True)
    changed[variable].values[...] += 1 + np.random.default_rng(1).random(changed[variable].shape)
    problems = load_study(study).study.verify(changed)
    assert problems
    assert all(contradicted in problem for problem in problems), problems
