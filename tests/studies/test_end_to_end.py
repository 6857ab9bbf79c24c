"""Every study, small: run, resumed and reported, with the verdicts that do not depend on the size."""

import json
import re

import pytest

from critflow import Status
from critflow.engine.code_digest import load_study, named_studies

STUDIES = sorted(name for name, path in named_studies().items() if "benchmarks" not in path.parts)
# Studies in which some cases have another status than ok.
OTHER = {"ensemble", "gallery", "percolation", "three_dimensions"}
# The number of claims, and those that differ.
DIFFER = {
    "boundary": (1, set()),
    "gallery": (5, {"B_0-of-tensions"}),
    "statements": (33, set()),
    "three_bar": (7, {"second-form"}),
}
HOLD = {
    "ensemble": "equal-lengths",
    "stiffening": "stiffening-least",
    "shear": "G_0-bound",
    "weak_forces": "soft-modes",
}


@pytest.mark.parametrize("name", STUDIES)
def test_a_study_is_run_resumed_and_reported(name, runs, run_study, capsys, assert_picture):
    folder, dataset = runs(name)
    assert name in OTHER or (dataset.status == Status.ok).all()
    study = load_study(name).study
    for figure in study.figures:
        assert_picture(folder / "figures" / f"{figure}.png", most=10**6)
    for animation in study.animations:
        assert (folder / "figures" / f"{animation}.gif").read_bytes().startswith(b"GIF89a")
    claims = {claim["key"]: claim for claim in json.loads((folder / "claims.json").read_text())}
    differ = {key for key, claim in claims.items() if claim["verdict"] == "differs"}
    assert claims and all(claims[key]["because"] for key in differ)
    assert name not in DIFFER or (len(claims), differ) == DIFFER[name]
    assert name not in HOLD or claims[HOLD[name]]["verdict"] == "holds"
    capsys.readouterr()
    run_study(name, folder)
    assert re.search(r"\b(\d+) of \1 requested cases were stored before", capsys.readouterr().out)
