"""The command `critflow convert`, and the options that the commands on a user's own network share."""

import json
import os

import pytest
from tissue_patches import tissue

from critflow import lattice
from critflow.command.main import main
from critflow_extras import network_from, write_network


def test_a_network_is_read_reported_and_written(tmp_path, capsys):
    write_network(lattice("honeycomb", 4, 4), tmp_path / "h.csv")
    assert main(["convert", str(tmp_path / "h.csv"), str(tmp_path / "h.svg"), "--size", "40"]) == 0
    assert "32 vertices, 48 edges" in capsys.readouterr().out
    assert 'width="41.0' in (tmp_path / "h.svg").read_text()


def test_two_tables(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "ends.csv").write_text("from;to\nA;D\nB;D\nC;D\n")
    (tmp_path / "places.csv").write_text("id;x;y\nA;0;0\nB;4;0\nC;0;3\nD;1;1\n")
    for names in (("ends.csv", "places.csv"), ("places.csv", "ends.csv")):
        assert main(["convert", *names, "n.json", "--pins", "A,B,C"]) == 0
        assert network_from("n.json").network.n_edges == 3
    assert main(["convert", "ends.csv"]) == 2


def test_the_refusal_of_a_network_that_nothing_holds_names_the_command_that_helps(tmp_path, capsys):
    assert main(["convert", str(tissue(tmp_path, 1e-6)), str(tmp_path / "t.svg")]) == 2
    assert "critflow examine FILE tries every rule" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "word"),
    [
        (["h.csv", "h.png"], "ending"),
        (["missing.csv", "h.svg"], "no file"),
        (["h.csv", "h.svg", "--cell", "wide"], "numbers"),
        (["h.csv", "nowhere/h.json"], "folder"),
        ([".", "h.json"], "folder"),
        (["h.csv", "h.svg", "--cell", "1_0 1_0"], "1_0"),
        (["h.csv", "h.json", "--volume", "1_0"], "a number or 'hull', not '1_0'"),
        (["h.csv", "h.svg", "--copies", "100000"], "fewer copies"),
        (["h.csv", "h.svg", "--copies", "0"], "--copies must be a whole number"),
        (["h.csv", "h.svg", "--weld"], "'--weld' requires an argument"),
        (["h.csv", "h.svg", "--weld", "0.1"], "--weld belongs to polygons, not to this source: leave it out"),
        (["h.csv", "h.svg", "--traced", "1"], "--traced belongs to a label mask"),
        (["missing.csv", "h.svg", "--weld", "0.1"], "no file missing_edges.csv: check its name"),
        (["missing.csv", "h.svg", "--weld", "-1"], "no file"),
        (["cells.geojson", "h.svg", "--weld", "-1"], "--weld must be zero or a distance, not -1"),
        (["cells.geojson", "h.svg", "--weld", "wide"], "--weld must be zero or a distance, not 'wide'"),
        (["cells.geojson", "h.svg", "--weld", "1:2"], "--weld must be zero or a distance, not (1.0, 2.0)"),
    ],
)
def test_a_wrong_command_is_one_sentence(tmp_path, monkeypatch, capsys, words, word):
    write_network(lattice("honeycomb", 4, 4), tmp_path / "h.csv")
    cell = {"type": "Polygon", "coordinates": [[[0, 0], [1, 0], [0, 1]]]}
    (tmp_path / "cells.geojson").write_text(json.dumps(cell))
    monkeypatch.chdir(tmp_path)
    assert main(["convert", *words]) == 2
    error = capsys.readouterr().err
    assert word in error and error.count("\n") == 1


@pytest.mark.parametrize(("pipe", "name"), [("a.json", "a.json"), ("a_edges.csv", "a.csv"), ("a.nc", "a.nc")])
def test_a_pipe_is_not_waited_for(tmp_path, capsys, pipe, name):
    os.mkfifo(tmp_path / pipe)
    assert main(["convert", str(tmp_path / name), str(tmp_path / "out.json")]) == 2
    assert "regular" in capsys.readouterr().err
