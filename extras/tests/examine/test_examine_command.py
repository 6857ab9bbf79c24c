"""The command `critflow examine`."""

import numpy as np
from tissue_patches import tissue

from critflow import calls, lattice
from critflow.command.main import main
from critflow_extras import nearest_critical, network_from, write_network


def test_the_report_comes_first_and_names_commands(tmp_path, capsys):
    file = tmp_path / "h.csv"
    write_network(lattice("honeycomb", 4, 4), file)
    assert main(["examine", str(file)]) == 0
    report = capsys.readouterr().out
    # What to do next is a command, not a function.
    assert "**critical**" in report and f"critflow make {file} --out OUT" in report
    assert "stiffening give" not in report


def test_two_tables(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "ends.csv").write_text("from;to\nA;D\nB;D\nC;D\n")
    (tmp_path / "places.csv").write_text("id;x;y\nA;0;0\nB;4;0\nC;0;3\nD;1;1\n")
    for names in (("ends.csv", "places.csv"), ("places.csv", "ends.csv")):
        assert main(["examine", *names, "--pins", "A,B,C"]) == 0
        assert "4 vertices, 3 edges" in capsys.readouterr().out
    assert main(["examine", "ends.csv", "places.csv", "n.json"]) == 2


def test_the_refusal_says_what_each_rule_gives(tmp_path, capsys):
    assert main(["examine", str(tissue(tmp_path, 1e-6))]) == 2
    error = capsys.readouterr().err
    assert "--pins two_edges fixes" in error and "pins=" not in error and error.count("\n") == 1


def test_the_next_command_has_the_options_of_the_report(tmp_path, capsys):
    file = tissue(tmp_path, 1e-5)
    assert main(["examine", str(file), "--pins", "two_edges"]) == 0
    report = capsys.readouterr().out
    assert f"critflow make {file} --pins two_edges --objective nearest --out OUT gives that" in report
    given = network_from(file, pins="two_edges")
    near = nearest_critical(given.network, given.positions)
    moved = np.sqrt(np.mean(np.sum((near.value.coordinates - given.positions) ** 2, axis=1)))
    assert f"distance of the vertices {moved:.3e}" in report


def test_the_parts_of_an_examination_are_told_in_the_words_of_the_shell(monkeypatch, tmp_path):
    told = []
    monkeypatch.setattr(calls, "tell", told.append)
    (tmp_path / "t_edges.csv").write_text("tail,head\nA,D\nB,D\nC,D\n")
    (tmp_path / "t_vertices.csv").write_text("id,x,y\nA,0,0\nB,4,0\nC,0,3\nD,1,1\n")
    assert main(["examine", str(tmp_path / "t.csv")]) == 2
    assert "--pins hull" in told
