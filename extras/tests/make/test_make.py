"""The command `critflow make`."""

import numpy as np
import pytest
from tissue_patches import tissue

import critflow
import critflow_extras as ce
from critflow import delaunay_network, lattice, voronoi_network
from critflow.command.main import main
from critflow_extras import network_from, write_network
from critflow_extras.files import data
from critflow_extras.make import making


def test_the_best_configuration_is_written_and_drawn(tmp_path, capsys):
    write_network(lattice("honeycomb", 4, 4), tmp_path / "h.csv")
    words = ["make", str(tmp_path / "h.csv"), "--out", str(tmp_path / "m.csv"), "--picture", str(tmp_path / "m.png")]
    assert main(words) == 0
    out = capsys.readouterr().out
    assert "B_0 0.2886751346" in out and "100.000000 % of its bound" in out
    assert (tmp_path / "m.png").read_bytes().startswith(b"\x89PNG")
    assert network_from(tmp_path / "m.csv").force_densities == pytest.approx(np.ones(48))


def test_the_nearest_configuration(tmp_path, capsys):
    file, out = tissue(tmp_path, 1e-5), tmp_path / "made.csv"
    assert main(["make", str(file), "--pins", "two_edges", "--objective", "nearest", "--out", str(out)]) == 0
    made, given = network_from(out), network_from(file, pins="two_edges")
    moved = np.sqrt(np.mean(np.sum((made.positions - given.positions) ** 2, axis=1)))
    assert f"distance {moved:.6g} (ok" in capsys.readouterr().out
    assert ce.rigidity(made.network, made.positions).value.n_self_stresses == 1


def test_the_nearest_configuration_lies_where_the_file_has_it(tmp_path):
    network = voronoi_network(16, seed=1)
    given = network.positions + np.array([3.0, -2.0])
    write_network(network, tmp_path / "n.csv", given)
    assert main(["make", str(tmp_path / "n.csv"), "--objective", "nearest", "--out", str(tmp_path / "m.csv")]) == 0
    np.testing.assert_allclose(network_from(tmp_path / "m.csv").positions, given, rtol=0, atol=1e-12)


def test_a_network_with_targets(tmp_path, capsys):
    source, out = tmp_path / "v.csv", tmp_path / "made.csv"
    write_network(voronoi_network(n_vertices=16, seed=1), source)
    assert main(["make", str(source), "--target", "C_B=0", "--target", "B_0=0.2:0.25", "--out", str(out)]) == 0
    made = network_from(out)
    critical = critflow.CriticalManifold(made.network).configuration(made.force_densities)
    exact = critflow.stiffening(critical).value
    assert abs(exact.C_B) < 1e-9 and 0.201 < exact.bulk_0 < 0.25 + 1e-9
    assert "C_B" in capsys.readouterr().out
    before = {path: path.read_bytes() for path in tmp_path.iterdir()}
    words = ["--picture", str(tmp_path / "made.png"), "--out", str(out)]
    assert main(["make", str(source), "--target", "C_B=-9", *words]) == 3
    refused = capsys.readouterr().out
    assert "at least" in refused and "nothing is written" in refused and "written to" not in refused
    # What was there before stays, and no picture shows a configuration without the properties.
    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == before
    assert main(["make", str(source), "--target", "C_B", "--out", str(out)]) == 2
    assert "NAME=VALUE" in capsys.readouterr().err
    twice = ["make", str(source), "--target", "C_B=0", "--out", str(out)]
    assert main([*twice, "--target", "C_B=1"]) == 2 and "twice" in capsys.readouterr().err
    assert main([*twice, "--objective", "bulk_modulus"]) == 2 and "--objective" in capsys.readouterr().err


def test_poissons_ratio_of_springs_at_rest(tmp_path, capsys):
    source, out = tmp_path / "d.csv", tmp_path / "made.csv"
    network = delaunay_network(24, seed=2)
    write_network(network, source)
    words = ["make", str(source), "--target", "poisson=-0.5", "--out", str(out)]
    assert main([*words, "--picture", str(tmp_path / "made.png")]) == 0
    printed = capsys.readouterr().out
    assert "poisson -0.5 ±" in printed and "springs at rest" in printed
    made = network_from(out)
    C = critflow.elasticity(made.network, made.positions).value
    for direction, across in (([1, 0], [0, 1]), ([1, 2], [2, -1])):
        assert C.poisson(direction, across) == pytest.approx(-0.5, abs=1e-7)
    np.testing.assert_allclose(
        made.network.bond_vectors(made.positions), network.bond_vectors(network.positions), rtol=0, atol=1e-12
    )
    assert main([*words, "--change", "stress"]) == 2 and "--change stiffness" in capsys.readouterr().err
    assert main([*words, "--change", "faces"]) == 2 and "stress or stiffness" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "word"),
    [
        (["make", "h.csv", "--out", "m.svg", "--objective", "colour"], "colour"),
        (["make", "h.csv", "--out", "m.csv", "--change", "stiffness"], "give --target NAME=VALUE"),
        (["make", "h.csv", "--out", "m.csv", "--target", "B_0=0_1"], "0_1"),
        (["make", "h.csv", "--out", "m.csv", "--objective", ""], "--objective needs a name"),
        (["convert", "h.csv", "h.stl", "--radius", "1e300"], "--radius 1e+300 must be positive and at most"),
        (["make", "t.csv", "--out", "m.csv", "--target", "C_B=0"], "in Python, prune_towards("),
        (["make", "t.csv", "--out", "m.csv", "--target", "C_B=0"], "and --change stiffness changes springs at rest"),
        (["convert", "h.csv", "h.svg", "--size", "-5"], "--size -5 must be positive"),
        (["make", "h.csv", "--out", "h.csv"], "h.csv would overwrite h_edges.csv"),
        (["make", "h_edges.csv", "h_vertices.csv", "--out", "./h.csv"], "would overwrite h_edges.csv"),
        (["convert", "h.csv", "h_edges.csv"], "would overwrite h_edges.csv"),
        (["make", "h.csv", "--cell", "5 5", "--out", "m.csv"], "has a cell of its own: leave --cell out"),
        (["make", "h.csv", "--set", "seed=1", "--out", "m.csv"], "--set chooses a case of a dataset"),
    ],
)
def test_a_wrong_command_is_one_sentence(tmp_path, monkeypatch, capsys, words, word):
    write_network(lattice("honeycomb", 4, 4), tmp_path / "h.csv")
    write_network(lattice("triangular", 4, 4), tmp_path / "t.csv")
    monkeypatch.chdir(tmp_path)
    assert main(words) == 2
    error = capsys.readouterr().err
    assert word in error and error.count("\n") == 1


@pytest.mark.parametrize(
    ("words", "code", "word"),
    [
        (["--out", "m.gml"], 6, "networkx"),
        (["--out", "m.doc"], 2, "ending"),
        (["--out", "nowhere/m.csv"], 2, "folder"),
        (["--out", "m.stl"], 6, "critflow-extras[formats]"),
        (["--out", "m.json"], 6, "networkx"),
        (["--out", "m.csv", "--picture", "m.doc"], 2, "picture"),
        (["--out", "m.graphml", "--target", "B_0=0.2"], 6, "networkx"),
        (["--out", "m.svg"], 2, "two-dimensional"),
    ],
)
def test_what_cannot_be_written_is_refused_before_the_computation(tmp_path, monkeypatch, capsys, words, code, word):
    network = critflow.lattice("diamond", 2, 2, 2) if word == "two-dimensional" else lattice("honeycomb", 2, 2)
    write_network(network, tmp_path / "n.csv")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(data, "import_module", lambda name: (_ for _ in ()).throw(ImportError(name)))
    for name in ("optimize", "design", "nearest_critical"):
        monkeypatch.setattr(making, name, lambda *_, **__: pytest.fail("computed"))
    assert main(["make", "n.csv", *words]) == code
    assert word in capsys.readouterr().err
