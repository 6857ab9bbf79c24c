"""Examinations of networks with known answers, and their reports."""

import re
from importlib import import_module

import numpy as np
import pytest
from scipy.spatial import ConvexHull
from tissue_patches import tissue

import critflow
import critflow_extras as ce
from critflow import Network, critical_from_lengths, lattice, voronoi_network
from critflow.result import NetworkError
from critflow_extras import examine, network_from, write_network

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
    assert "**floppy**" in str(floppy) and f"{onset.value.strain:.8g}" in str(floppy)
    assert set(floppy.critical_strains) == {"dilation", "simple_shear", "pure_shear", "uniaxial"}
    # The answer and the advice come first.
    assert "uniaxial" in floppy.advice[0] and "critical configuration" in floppy.advice[1]
    assert floppy.advice[0] in str(floppy).split("## ")[0]
    # The floppy modes are orthonormal: their parts add up to their number.
    n_modes = floppy.rigidity.value.n_zero_modes - floppy.rigidity.value.n_trivial
    assert 2 * floppy.participation.sum() == pytest.approx(n_modes)


def test_a_lattice_is_rigid_to_first_order():
    found = examine(lattice("triangular", 4, 4))
    assert (found.order, found.title) == ("first", "rigid to first order")
    assert found.elasticity.value.bulk == pytest.approx(np.sqrt(3) / 2)
    assert found.tension == pytest.approx(1)
    # C_xxxx = 3C_xyxy of isotropy: ν = 1/3, and Young's modulus 2/√3.
    assert "Young's modulus 1.1547005, Poisson's ratio 0.333333" in str(found)
    assert "| xx | 1.29904 | 0.433013 | 0 |" in str(found)
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


def test_every_rule_for_fixed_vertices_is_tried(tmp_path):
    file = tissue(tmp_path, 1e-6)
    with pytest.raises(NetworkError) as question:
        examine(file)
    answers = {rule: answer for rule, answer in re.findall(r"pins='(\w+)' (.*?)\. ", str(question.value))}
    assert list(answers) == ["hull", "outer_face", "two_edges", "box"]
    assert re.search(r"within \de-0[67] of an edge, one self-stress in tension", answers["two_edges"])
    assert answers["box"].startswith("fixes 4: floppy, 0 self-stresses")


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
        # The coordinates have all digits, so that these explain nothing.
        assert "which the digits" not in str(found)
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
    exact = ce.rigidity(network, network.positions).value
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


def test_a_critical_file_needs_no_search_for_onsets(tmp_path, monkeypatch):
    """Its rest lengths are the lengths at its coordinates up to rounding, so that it is rigid at strain zero."""
    write_network(critflow.optimize(VORONOI, "B_0").value, tmp_path / "critical.json")
    module = import_module("critflow_extras.examine.examine")
    monkeypatch.setattr(module, "critical_strain", lambda *_: pytest.fail("search"))
    examination = examine(tmp_path / "critical.json")
    assert examination.order == "critical" and not examination.critical_strains


def test_a_rigid_network_of_longer_springs_has_an_onset():
    """Springs 1.1 times as long are at their lengths where the area is 1.1² times as large."""
    critical = critflow.optimize(VORONOI, "B_0").value
    found = examine(VORONOI, critical.coordinates, 1.1 * critical.lengths, deformations=("dilation",))
    assert found.order == "critical"
    assert found.critical_strains["dilation"].value.strain == pytest.approx(0.21, rel=1e-9)


def test_the_report_says_that_moduli_are_absolute():
    """k = 5 everywhere: the moduli are five times those of k = 1, and the sentence on units says so."""
    network = lattice("triangular", 4, 4)
    one, five = (examine(network.with_stiffness(np.full(network.n_edges, k))) for k in (1.0, 5.0))
    assert five.elasticity.value.bulk == pytest.approx(5 * one.elasticity.value.bulk, rel=1e-12)
    assert "stiffness k 5; moduli are not divided by k, their unit is that of k" in str(five)


@pytest.mark.parametrize(
    "name, counts, title",
    [
        ("triangular", "8 self-stresses, 0 floppy modes (the rank of C is 3 of 3)", "no motion in this cell"),
        ("kagome", "6 self-stresses, 7 floppy modes (the rank of C is 3 of 3)", "a self-stress"),
        ("square", "4 self-stresses, 5 floppy modes (the rank of C is 2 of 3, eigenvalues", "a self-stress"),
        ("honeycomb", "0 self-stresses, 10 floppy modes (the rank of C is 1 of 3, eigenvalues", "one self-stress"),
    ],
)
def test_counts_are_also_those_of_a_cell_that_may_deform(name, counts, title):
    # They differ by N_b − d N_v − d(d + 1)/2, which leaves the translations among the motions.
    found = examine(lattice(name, 3, 3))
    assert f"in a cell that may deform: {counts}" in str(found) and found.headline[1].startswith(title)
