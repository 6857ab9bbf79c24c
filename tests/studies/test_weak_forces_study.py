"""The study of weak bending end to end, small: run, resumed and reported, and its scaling function."""

import json

import numpy as np

from critflow import Status
from workflows.weak_forces import PLACES, scaling_function


def test_the_study_is_run_resumed_and_reported(runs, run_study, capsys):
    folder, dataset = runs("weak_forces")
    assert (dataset.status == Status.ok).all()
    assert {path.stem for path in (folder / "figures").glob("*.png")} == {"weak_forces", "populations"}
    claims = {claim["key"]: claim for claim in json.loads((folder / "claims.json").read_text())}
    assert claims["soft-band"]["verdict"] == "holds"
    capsys.readouterr()
    run_study("weak_forces", folder)
    assert "1 of 1 requested cases were stored before" in capsys.readouterr().out


def test_tensions_of_the_cubic_equation_are_one_curve(runs):
    _, dataset = runs("weak_forces")
    scaled = (dataset.cubic / dataset.unit).values
    np.testing.assert_allclose(scaled, np.broadcast_to(scaling_function(PLACES), scaled.shape), rtol=1e-9)
    np.testing.assert_allclose(scaling_function([0.0, 1.5]) ** 3 - [0, 1.5 * scaling_function([1.5])[0] ** 2], 1)
