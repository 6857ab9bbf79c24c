"""Examinations of networks with known answers, their pages, and the commands."""

import os
import re
from importlib import import_module

import numpy as np
import pytest
from scipy.spatial import ConvexHull

import critflow
from critflow import (
    InputError,
    Network,
    critical_from_lengths,
    examine,
    lattice,
    network_from,
    voronoi_network,
    write_network,
)
from critflow.command.main import main
from critflow.extras.examine.page import write_page
from critflow.extras.files import data as exchange
from critflow.result import NetworkError

VORONOI = voronoi_network(n_vertices=40, seed=1)


@pytest.fixture(scope="module")
def floppy():
    rng = np.random.default_rng(0)
    return examine(VORONOI, VORONOI.positions + 0.02 * rng.normal(size=(40, 2)), 1.2 * np.ones(60))


def test_a_critical_design_in_six_decimals_is_recognised(tmp_path):
    critical = critical_from_lengths(VORONOI, np.ones(60)).value
    write_network(VORONOI, tmp_path / "c.csv", np.round(critical.coordinates, 6))
    found = examine(str(tmp_path / "c.csv"))
    assert found.order == "critical" and found.rigidity.value.n_self_stresses == 1 and found.tension > 0.05
    assert found.nearest.distance < 1e-6 and found.critical_strains == {}
    exact = critflow.elasticity(critical).value.bulk
    assert found.critical_elasticity.value.bulk == pytest.approx(exact, rel=1e-5)
    largest = int(np.nanargmin(found.leverage.change))
    assert found.leverage.change[largest] < 0 and f"unchanged: {found.edge_name(largest)}" in str(found)
    # By the default tolerance the count would be uncertain, and all digits of the file are in the report.
    assert "6 decimals" in str(found)


@pytest.mark.parametrize("seed", range(4))
def test_a_mechanism_in_three_decimals_is_not_rigid(seed):
    # Equal parallel bars carry a body on a circle; the edges are so short that three decimals could be those of a grid.
    rng = np.random.default_rng(seed)
    feet = 0.5 * rng.random((5, 2))
    x = np.round(np.concatenate([feet, feet + np.array([0.1314, 0.3095])]), 3)
    edges = [[i, 5 + i] for i in range(5)] + [[5 + i, 5 + j] for i in range(5) for j in range(i)]
    network = Network(edges, pins={i: x[i] for i in range(5)}, positions=x)
    assert examine(network, decimals=3, deformations=()).order in ("floppy", "undecided")


def test_a_floppy_network_has_onsets_and_advice(floppy):
    assert floppy.order == "floppy" and floppy.tension == 0 and floppy.elasticity.value.bulk == 0
    onset = floppy.critical_strains["dilation"]
    assert "**floppy**" in str(floppy) and f"{onset.strain:.8g}" in str(floppy)
    assert set(floppy.critical_strains) == {"dilation", "simple_shear", "pure_shear", "uniaxial"}
    # The answer and the advice come first.
    assert "uniaxial" in floppy.advice[0] and "critical configuration" in floppy.advice[1]
    assert floppy.advice[0] in str(floppy).split("## ")[0]
    # The floppy modes are orthonormal: their parts add up to their number.
    n_modes = floppy.rigidity.value.n_zero_modes - floppy.rigidity.value.n_trivial
    assert 2 * floppy.participation.sum() == pytest.approx(n_modes)


def test_a_lattice_is_rigid_to_first_order(tmp_path):
    found = examine(lattice("triangular", 4, 4))
    assert (found.order, found.title) == ("first", "rigid to first order")
    assert found.elasticity.value.bulk == pytest.approx(np.sqrt(3) / 2)
    assert found.tension == pytest.approx(1)
    # C_xxxx = 3C_xyxy of isotropy: ν = 1/3, and Young's modulus 2/√3.
    assert "Young's modulus 1.1547005, Poisson's ratio 0.333333" in str(found)
    write_page(found, tmp_path / "page.html")
    page = (tmp_path / "page.html").read_text()
    assert "| xx | 1.29904 | 0.433013 | 0 |" in str(found) and page.count("<td>") == 12
    assert found.critical_strains == {}


def test_a_patch_with_fixed_vertices_has_moduli_per_named_volume():
    inner = (VORONOI.offsets == 0).all(axis=1)
    patch = network_from(edges=VORONOI.edges[inner], positions=VORONOI.positions, pins="hull")
    found = examine(patch)
    assert "convex hull" in str(found) and found.network.volume == pytest.approx(ConvexHull(patch.positions).volume)
    named = network_from(edges=VORONOI.edges[inner], positions=VORONOI.positions, pins="hull", volume=10.0)
    again = examine(named, deformations=())
    assert again.network.volume == 10 and "convex hull, V" not in str(again)


@pytest.mark.parametrize(
    ("network", "order"),
    [
        (lattice("honeycomb", 1, 2), "critical"),
        (critflow.lattice("kagome", 1, 1), "prestress"),
        (critflow.lattice("diamond", 1, 1, 1), "first"),
        (Network([[0, 1], [1, 0]], [[0], [1]], [[2.0]], positions=[[0.0], [1.1]]), "first"),
        (
            critflow.Network([[0, 1], [1, 2]], pins={0: [0, 0], 2: [1, 0]}, positions=[[0, 0], [0.5, 0.1], [1, 0]]),
            "first",
        ),
    ],
)
def test_reports_of_tiny_networks_have_no_undefined_numbers(network, order):
    found = examine(network)
    assert found.order == order
    assert "nan" not in str(found) and "inf" not in str(found)
    assert found.advice


@pytest.mark.parametrize("form", ["%.6f", "%.6g", "%.3f", "single"])
def test_a_critical_network_of_few_digits_is_recognised(form):
    critical = critical_from_lengths(VORONOI, np.ones(60)).value
    # In single precision a tessellation, itself critical, of which the rounding has a larger effect.
    x = VORONOI.positions if form == "single" else critical.coordinates + 7.0
    few = x.astype(np.float32).astype(float) if form == "single" else np.vectorize(lambda v: float(form % v))(x)
    read = network_from(edges=VORONOI.edges, positions=few, offsets=VORONOI.offsets, cell=VORONOI.cell)
    found = examine(read, deformations=())
    assert found.order == "critical"
    assert any("so lengths are known to" in note for note in found.notes)


def tissue(tmp_path, noise):
    """Tables of a patch of a tessellation: with the vertices of two edges held it is critical, up to the noise."""
    inner = (VORONOI.offsets == 0).all(axis=1)
    edges = VORONOI.edges[inner]
    while (hanging := (np.bincount(edges.ravel(), minlength=40)[edges] == 1).any(axis=1)).any():
        edges = edges[~hanging]
    x = VORONOI.positions + noise * np.random.default_rng(0).normal(size=(40, 2))
    vertices = "".join(f"{v},{x[v, 0]:.15g},{x[v, 1]:.15g}\n" for v in np.unique(edges))
    (tmp_path / "t_vertices.csv").write_text(f"id,x,y\n{vertices}")
    (tmp_path / "t_edges.csv").write_text("tail,head\n" + "".join(f"{a},{b}\n" for a, b in edges))
    return tmp_path / "t.csv"


def test_every_rule_for_fixed_vertices_is_tried(tmp_path, capsys):
    file = tissue(tmp_path, 1e-6)
    with pytest.raises(NetworkError) as question:
        examine(file)
    answers = {rule: answer for rule, answer in re.findall(r"pins='(\w+)' (.*?)\. ", str(question.value))}
    assert list(answers) == ["hull", "outer_face", "two_edges", "box"]
    assert re.search(r"within \de-0[67] of an edge, one self-stress in tension", answers["two_edges"])
    assert answers["box"].startswith("fixes 4: floppy, 0 self-stresses")
    assert main(["examine", str(file)]) == 2
    error = capsys.readouterr().err
    assert "--pins two_edges fixes" in error and "pins=" not in error and error.count("\n") == 1
    assert main(["convert", str(file), str(tmp_path / "t.svg")]) == 2
    assert "critflow examine FILE tries every rule" in capsys.readouterr().err


@pytest.mark.parametrize(("noise", "nearly"), [(1e-5, True), (3e-3, False)])
def test_a_network_that_was_relaxed_to_a_tolerance_is_critical_within_it(tmp_path, noise, nearly):
    found = examine(network_from(tissue(tmp_path, noise), pins="two_edges"))
    lengths = np.linalg.norm(found.network.bond_vectors(found.coordinates), axis=1)
    assert found.distance == pytest.approx(found.nearest.distance / lengths.mean())
    assert found.nearly_critical is nearly and found.order == "floppy"
    if nearly:
        exact = critflow.elasticity(found.nearest.value).value
        assert f"critical within {found.distance:.1g} of an edge**: one self-stress" in str(found)
        assert "strictly, as given, floppy" in str(found) and f"B_0 = {exact.bulk:.8g}" in str(found)
        assert found.elasticity is None and "nearest.value" in found.advice[0]
    else:
        assert found.title == "floppy" and found.elasticity.value.bulk == 0


def test_a_rigid_network_with_a_loose_chain_is_not_called_floppy():
    # A triangular lattice with a bent path of three edges next to one of its own.
    base = lattice("triangular", 4, 4)
    tail, head = base.edges[0]
    x = np.concatenate([base.positions, base.positions[tail] + [[0.3, 0.2], [0.7, 0.3]]])
    edges = np.concatenate([base.edges, [[tail, 16], [16, 17], [17, head]]])
    offsets = np.concatenate([base.offsets, [[0, 0], [0, 0], base.offsets[0]]])
    found = examine(Network(edges, offsets, base.cell, positions=x))
    assert found.loose == (1, 2) and found.title == "rigid, with 1 loose part"
    assert "2 vertices can move without resistance" in str(found) and found.elasticity.value.bulk > 0.8


def test_rotations_about_fixed_vertices_are_no_floppy_modes():
    x = [[0, 0], [1, 0], [0.5, 0.8], [1.5, 0.8]]
    edges = [[0, 1], [1, 2], [2, 0], [2, 3], [3, 1]]
    found = examine(Network(edges, pins={0: x[0]}, positions=x))
    assert (found.n_floppy_modes, found.title) == (0, "rigid, but free to rotate")
    assert "0 floppy modes, 1 rotation about the fixed vertices" in str(found)
    assert found.advice == ("fix a vertex that is not in line with the fixed ones, and it cannot rotate",)
    # In space one fixed vertex leaves three rotations, two one, and three not in line none.
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
    pairs = np.array([[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]])
    for n_pins, rotations in ((1, 3), (2, 1), (3, 0)):
        kept = pairs[pairs[:, 1] >= n_pins]
        found = examine(Network(kept, pins=dict(enumerate(corners[:n_pins])), positions=corners), deformations=())
        n_zero = found.rigidity.value.n_zero_modes
        assert (n_zero, found.n_floppy_modes) == (rotations, 0)


def test_self_stresses_of_large_rigid_networks_are_counted_only():
    network = critflow.delaunay_network(n_vertices=200, seed=0)
    found = examine(network, deformations=())
    exact = critflow.rigidity(network, network.positions).value
    assert found.n_self_stresses == exact.n_self_stresses == 202 and found.order == "first"
    assert not len(found.rigidity.value.self_stresses) and "at least 1.0e-05" in str(found)


def test_vertices_have_the_names_of_the_source(tmp_path):
    (tmp_path / "a_vertices.csv").write_text("id,x,y\nA,0,0\nB,4,0\nC,0,3\nD,1,1\nE,9,9\n")
    (tmp_path / "a_edges.csv").write_text("tail,head\nA,D\nB,D\nC,D\nE,E\n")
    text = str(examine(network_from(tmp_path / "a.csv", pins=["A", "B", "C"])))
    assert "1 (B–D)" in text and "source: tables a_edges.csv" in text
    inner = (VORONOI.offsets == 0).all(axis=1)
    read = network_from(edges=VORONOI.edges[inner], positions=VORONOI.positions, pins="hull")
    assert examine(read, deformations=()).names == tuple(map(str, read.data.vertex_numbers))


def test_whole_coordinates_of_a_grid_count_as_exact():
    read = network_from(critflow.lattice("square", 4, 4))
    found = examine(read, deformations=())
    assert found.tolerance == 1e-6 and (found.order, found.rigidity.value.n_self_stresses) == ("prestress", 8)
    assert any("0 decimals and count as exact" in note for note in found.notes)


def test_an_edge_without_length_leaves_the_answer_open():
    x = VORONOI.positions.copy()
    tail, head = VORONOI.edges[0]
    x[head] = x[tail] - VORONOI.offsets[0] @ VORONOI.cell
    found = examine(network_from(edges=VORONOI.edges, offsets=VORONOI.offsets, cell=VORONOI.cell, positions=x))
    assert found.order == "undecided" and "**undecided**: edge 0 has no length" in str(found)
    assert "nan" not in str(found) and "modes" not in str(found) and any("no length" in n for n in found.notes)


def test_pages_have_the_report_and_the_picture(floppy, tmp_path):
    floppy.save(tmp_path / "page.md")
    text = (tmp_path / "page.md").read_text()
    assert "![The network](page.png)" in text and (tmp_path / "page.png").stat().st_size > 10_000
    write_page(floppy, tmp_path / "page.html")
    page = (tmp_path / "page.html").read_text()
    assert page.count("<tr>") == 5 and "data:image/png;base64," in page
    with pytest.raises(InputError, match="ending"):
        write_page(floppy, tmp_path / "page.docx")


def test_commands(tmp_path, capsys):
    write_network(lattice("honeycomb", 4, 4), tmp_path / "h.csv")
    assert main(["convert", str(tmp_path / "h.csv"), str(tmp_path / "h.svg"), "--size", "40"]) == 0
    assert "32 vertices, 48 edges" in capsys.readouterr().out
    assert main(["examine", str(tmp_path / "h.csv"), "--out", str(tmp_path / "h.html")]) == 0
    report = capsys.readouterr().out
    assert "**critical**" in report and (tmp_path / "h.html").exists()
    # What to do next is a command, not a function.
    assert f"critflow make {tmp_path / 'h.csv'} --out OUT" in report and "stiffening give" not in report
    made = ["make", str(tmp_path / "h.csv"), "--out", str(tmp_path / "m.csv"), "--picture", str(tmp_path / "m.png")]
    assert main(made) == 0
    assert "B_0 0.2886751346" in capsys.readouterr().out
    assert network_from(tmp_path / "m.csv").force_densities == pytest.approx(np.ones(48))


@pytest.mark.parametrize(
    ("words", "word"),
    [
        (["convert", "h.csv", "h.png"], "ending"),
        (["convert", "missing.csv", "h.svg"], "no file"),
        (["make", "h.csv", "--out", "m.svg", "--objective", "colour"], "colour"),
        (["convert", "h.csv", "h.svg", "--cell", "wide"], "numbers"),
        (["convert", "h.csv", "nowhere/h.json"], "folder"),
        (["convert", ".", "h.json"], "folder"),
        (["convert", "h.csv", "h.svg", "--cell", "1_0 1_0"], "1_0"),
        (["convert", "h.csv", "h.json", "--volume", "1_0"], "a number or 'hull', not '1_0'"),
        (["make", "h.csv", "--out", "m.csv", "--target", "B_0=0_1"], "0_1"),
        (["make", "t.csv", "--out", "m.csv", "--target", "C_B=0"], "in Python, prune_towards("),
        (["convert", "h.csv", "h.svg", "--copies", "100000"], "fewer copies"),
    ],
)
def test_a_wrong_command_is_one_sentence(tmp_path, monkeypatch, capsys, words, word):
    write_network(lattice("honeycomb", 4, 4), tmp_path / "h.csv")
    write_network(lattice("triangular", 4, 4), tmp_path / "t.csv")
    monkeypatch.chdir(tmp_path)
    assert main(words) == 2
    error = capsys.readouterr().err
    assert word in error and error.count("\n") == 1


@pytest.mark.parametrize(("pipe", "name"), [("a.json", "a.json"), ("a_edges.csv", "a.csv"), ("a.nc", "a.nc")])
def test_a_pipe_is_not_waited_for(tmp_path, capsys, pipe, name):
    os.mkfifo(tmp_path / pipe)
    file, out = str(tmp_path / name), str(tmp_path / "out.json")
    for words in (["examine", file], ["convert", file, out], ["make", file, "--out", out]):
        assert main(words) == 2
        assert "regular" in capsys.readouterr().err


def test_the_command_makes_the_configuration_that_its_report_names(tmp_path, capsys):
    file, out = tissue(tmp_path, 1e-5), tmp_path / "made.csv"
    assert main(["examine", str(file), "--pins", "two_edges"]) == 0
    report = capsys.readouterr().out
    next_command = f"make {file} --pins two_edges --objective nearest --out"
    assert next_command in report
    assert main([*next_command.split(), str(out)]) == 0
    made, given = network_from(out), network_from(file, pins="two_edges")
    moved = np.sqrt(np.mean(np.sum((made.positions - given.positions) ** 2, axis=1)))
    assert f"distance of the vertices {moved:.3e}" in report
    assert f"distance {moved:.6g} (ok" in capsys.readouterr().out
    assert critflow.rigidity(made.network, made.positions).value.n_self_stresses == 1


def test_the_command_makes_a_network_with_targets(tmp_path, capsys):
    source, out = tmp_path / "v.csv", tmp_path / "made.csv"
    write_network(voronoi_network(n_vertices=16, seed=1), source)
    assert main(["make", str(source), "--target", "C_B=0", "--target", "B_0=0.2:0.25", "--out", str(out)]) == 0
    made = network_from(out)
    critical = critflow.CriticalManifold(made.network).configuration(made.force_densities)
    exact = critflow.stiffening(critical).value
    assert abs(exact.C_B) < 1e-9 and 0.201 < exact.bulk_0 < 0.25 + 1e-9
    assert "C_B" in capsys.readouterr().out
    assert main(["make", str(source), "--target", "C_B=-9", "--out", str(out)]) == 3
    assert "at least" in capsys.readouterr().out
    assert main(["make", str(source), "--target", "C_B", "--out", str(out)]) == 2
    assert "NAME=VALUE" in capsys.readouterr().err
    twice = ["make", str(source), "--target", "C_B=0", "--out", str(out)]
    assert main([*twice, "--target", "C_B=1"]) == 2 and "twice" in capsys.readouterr().err
    assert main([*twice, "--objective", "bulk_modulus"]) == 2 and "--objective" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "code", "word"),
    [
        (["make", "h.csv", "--out", "m.gml"], 6, "networkx"),
        (["make", "h.csv", "--out", "m.doc"], 2, "ending"),
        (["make", "h.csv", "--out", "nowhere/m.csv"], 2, "folder"),
        (["make", "h.csv", "--out", "m.stl"], 6, "critflow[formats]"),
        (["make", "h.csv", "--out", "m.json"], 6, "networkx"),
        (["make", "d.csv", "--out", "m.svg"], 2, "two-dimensional"),
        (["make", "h.csv", "--out", "m.csv", "--picture", "m.doc"], 2, "picture"),
        (["make", "h.csv", "--out", "m.graphml", "--target", "B_0=0.2"], 6, "networkx"),
        (["examine", "h.csv", "--out", "h.doc"], 2, "ending"),
        (["examine", "h.csv", "--out", "nowhere/h.html"], 2, "folder"),
        (["convert", "h.csv", "h.dxf"], 6, "ezdxf"),
    ],
)
def test_what_cannot_be_written_is_refused_before_the_computation(tmp_path, monkeypatch, capsys, words, code, word):
    write_network(lattice("honeycomb", 2, 2), tmp_path / "h.csv")
    write_network(critflow.lattice("diamond", 2, 2, 2), tmp_path / "d.csv")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(exchange, "import_module", lambda name: (_ for _ in ()).throw(ImportError(name)))
    for module, name in (
        ("design.optimize", "optimize"),
        ("design.targets", "design"),
        ("examination.examine", "examine"),
    ):
        computing = import_module(f"critflow.{module}")
        monkeypatch.setattr(computing, name, lambda *_, **__: pytest.fail("computed"))
    assert main(words) == code
    assert word in capsys.readouterr().err


def test_a_critical_file_needs_no_search_for_onsets(tmp_path, monkeypatch):
    """Its rest lengths are the lengths at its coordinates up to rounding, so that it is rigid at strain zero."""
    write_network(critflow.optimize(VORONOI, "B_0").value, tmp_path / "critical.json")
    module = import_module("critflow.extras.examine.examine")
    monkeypatch.setattr(module, "critical_strain", lambda *_: pytest.fail("search"))
    examination = examine(tmp_path / "critical.json")
    assert examination.order == "critical" and not examination.critical_strains
