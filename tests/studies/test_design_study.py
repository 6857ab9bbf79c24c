"""The studies of design end to end, small: each is run, resumed and reported."""

import json

import pytest

from critflow import Status

QUESTIONS = ("curves", "fronts", "isogonal", "onset", "poisson", "pruning", "reach", "stiffening", "stress", "topology")


@pytest.mark.parametrize("question", QUESTIONS)
def test_a_study_of_design_is_run_resumed_and_reported(question, runs, run_study, capsys):
    folder, dataset = runs(f"design_{question}")
    assert (dataset.status == Status.ok).all()
    assert (folder / "figures" / f"{question}.png").exists() == (question != "stress")
    assert json.loads((folder / "claims.json").read_text())
    capsys.readouterr()
    run_study(f"design_{question}", folder)
    assert "1 of 1 requested cases were stored before" in capsys.readouterr().out
