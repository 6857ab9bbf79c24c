"""The command `critflow explore`, and what its page starts from."""

from pathlib import Path

import pytest

from critflow import voronoi_network
from critflow.command.main import main
from critflow_extras import write_network
from critflow_extras.explore import server
from critflow_extras.explore.source import File


def test_a_port_that_does_not_exist(capsys):
    assert main(["explore", "--port", "99999"]) == 2
    assert "65535" in capsys.readouterr().err


def test_the_words_of_a_case_choose_what_is_shown_first(dataset, monkeypatch):
    started = []
    monkeypatch.setattr(server, "serve", lambda explorer, *_: started.append(explorer))
    assert main(["explore", str(dataset), "--set", "seed=1", "--set", "population=random_stress", "--no-browser"]) == 0
    started[0].close()
    assert started[0].source.first_case().title == "seed 1, population random_stress"


@pytest.mark.parametrize(
    ("words", "word"),
    [
        (["n.csv", "--set", "seed=1"], "--set chooses a case of a dataset"),
        (["--set", "seed=1"], "--set chooses a case of a dataset"),
        (["DATASET", "--set", "seed=1"], "which population?"),
        (["DATASET", "--cell", "5 5"], "--cell says how a file of a network is read"),
        (["n.csv", "--seed", "3"], "--n-vertices and --seed make a random network"),
    ],
)
def test_options_that_would_be_ignored_are_refused(words, word, dataset, tmp_path, monkeypatch, capsys):
    write_network(voronoi_network(16, seed=1), tmp_path / "n.csv")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(server, "serve", lambda *_: pytest.fail("served"))
    assert main(["explore", *(str(dataset) if one == "DATASET" else one for one in words)]) == 2
    assert word in capsys.readouterr().err


def test_two_tables(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("ends.csv").write_text("from;to\nA;D\nB;D\nC;D\n")
    Path("places.csv").write_text("id;x;y;fixed\nA;0;0;1\nB;4;0;1\nC;0;3;1\nD;1;1;0\n")
    for names in (("ends.csv", "places.csv"), ("places.csv", "ends.csv")):
        source = File(*map(Path, names))
        assert source.title == " and ".join(names) and source.open()[1].network.n_edges == 3
        assert f"network_from({names!r})" in source.lines(source.open()[1])[0]
