"""The choice of a case of a dataset by the command."""

from pathlib import Path

import pytest

from critflow.command.main import main

TINY = str(Path(__file__).parents[3] / "tests" / "engine" / "tiny_study.py")


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """A finished run of the tiny study; tests only read it."""
    folder = tmp_path_factory.mktemp("results")
    assert main(["run", TINY, "--out", str(folder), "--workers", "0"]) == 0
    return folder


@pytest.mark.parametrize(
    ("setting", "word"),
    [("sed=1", "'seed'"), ("population=flopy", "'floppy'"), ("seed=1", "add --set population=random")],
)
def test_a_mistake_in_the_choice_gives_one_sentence_and_draws_nothing(results, capsys, setting, word):
    before = sorted(results.rglob("*"))
    capsys.readouterr()
    assert main(["show", str(results / "tiny.nc"), "--set", setting]) == 2
    out, err = capsys.readouterr()
    assert (out, len(err.splitlines())) == ("", 1)
    assert err.startswith("critflow: ") and word in err
    assert sorted(results.rglob("*")) == before
