"""Every study, small: run, resumed and reported, with the verdicts that do not depend on the size."""

from pathlib import Path

import pytest
from study_runs import studies_in

from critflow import Status

WORKFLOWS = Path(__file__).resolve().parents[2] / "workflows"
# Studies in which some cases have another status than ok.
OTHER = {"ensemble", "gallery", "percolation"}
# The number of claims, and those that differ.
DIFFER = {
    "boundary": (1, set()),
    "gallery": (5, {"B_0-of-tensions"}),
    "statements": (36, set()),
    "three_bar": (7, {"second-form"}),
}
HOLD = {"ensemble": "equal-lengths", "relations": "pairs", "shear": "G_0-bound"}


@pytest.mark.parametrize("name", [one for one in studies_in(WORKFLOWS) if one not in ("failure_map", "speed")])
def test_a_study_is_run_resumed_and_reported(name, runs, claims_of_study):
    claims = claims_of_study(name)
    assert name in OTHER or (runs(name)[1].status == Status.ok).all()
    differ = {key for key, claim in claims.items() if claim["verdict"] == "differs"}
    assert name not in DIFFER or (len(claims), differ) == DIFFER[name]
    assert name not in HOLD or claims[HOLD[name]]["verdict"] == "holds"
