"""Every study of the extras, small: run, resumed and reported, and settings that are refused."""

from pathlib import Path

import pytest
from critflow.studies.shared.populations import PAPER_POPULATIONS
from study_runs import studies_in

from critflow import Status
from critflow.command.main import main
from critflow.engine.code_digest import load_study

STUDIES = Path(__file__).resolve().parents[2] / "studies"
REFUSED = {
    "allostery": {"sizes=20": "at least 24", "loads=2.0": "between 0 and 1", "starts=0": "must be positive"},
    "reach": {
        **{"ratios=1": "between -1 and 1", "directions=2": "at least 3", "excess=0": "excess"},
        **{"surface_vertices=7": "n_vertices", "n_vertices=7": "n_vertices"},
    },
    "stiffening": {"n_vertices=7": "n_vertices", "sources=colour": "colour", "isogonal_vertices=7": "n_vertices"},
    "tension_inference": {"n_vertices=7": "n_vertices"},
    "three_dimensions": {
        **{"n_vertices=40": "", "hard_core=1.2": "", "strains=0": "", "threshold=0.0": "threshold"},
        **{"spread=-0.1": "spread", "strains=0.1,0.2,0.3": "contains 0 of the strains"},
    },
    "topology": {"cuts=0": "positive", "cuts=24000": "smaller", "pruned_edges=300": "smaller"},
}


@pytest.mark.parametrize("name", studies_in(STUDIES))
def test_a_study_is_run_resumed_and_reported(name, runs, claims_of_study):
    claims = claims_of_study(name)
    assert name == "three_dimensions" or (runs(name)[1].status == Status.ok).all()
    assert name != "stiffening" or claims["stiffening-least"]["verdict"] == "holds"


@pytest.mark.parametrize(
    "study, setting, word", [(study, *row) for study, rows in REFUSED.items() for row in rows.items()]
)
def test_settings_that_could_only_fail_are_refused(study, setting, word, tmp_path, capsys):
    assert main(["run", study, "--workers", "0", "--out", str(tmp_path / "out"), "--set", setting]) == 2
    message = capsys.readouterr().err.strip()
    assert message.startswith("critflow: ") and "\n" not in message and word in message
    assert not (tmp_path / "out").exists()


def test_foams_have_the_populations_of_the_paper():
    assert load_study("three_dimensions").study.axes[1].values == PAPER_POPULATIONS
