"""From arrays to networks: every repair is reported, ambiguous input is a question, and strict reading refuses both."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from refusals import refused_changes

from critflow import (
    CritflowError,
    InputError,
    Network,
    critical_from_lengths,
    elasticity,
    lattice,
    stiffening,
    strain_path,
    voronoi_network,
)
from critflow.result import NetworkError
from critflow_extras import network_from, write_network
from critflow_extras.files.data import NetworkData
from critflow_extras.files.repair import ImportedNetwork, in_its_plane

HONEYCOMB = lattice("honeycomb", 4, 4)
E, X, O, C = HONEYCOMB.edges, HONEYCOMB.positions, HONEYCOMB.offsets, HONEYCOMB.cell
N = len(X)
ARRAYS = {"edges": E, "positions": X, "offsets": O, "cell": C}


def with_extra(edges, offsets=None, positions=None):
    edges = np.array(edges)
    offsets = np.zeros((len(edges), 2), int) if offsets is None else np.array(offsets)
    return {
        "edges": np.concatenate([E, edges]),
        "offsets": np.concatenate([O, offsets]),
        "positions": X if positions is None else np.concatenate([X, positions]),
        "cell": C,
    }


REPAIRS = {
    "loop": (with_extra([[3, 3]]), "itself"),
    "repeat": (with_extra([E[5]], [O[5]]), "repeated"),
    "reversed repeat": (with_extra([E[5, ::-1]], [-O[5]]), "repeated"),
    "both directions": (with_extra(E[:, ::-1], -O), "neighbour list"),
    "bare vertex": (with_extra(E[:0], positions=[[0.1, 0.1]]), "without edges"),
    "separate piece": (with_extra([[N, N + 1], [N + 1, N + 2], [N, N + 2]], positions=np.eye(3)[:, :2]), "piece"),
    "hanging tree": (with_extra([[2, N], [N, N + 1]], positions=[[1, 1], [1, 2]]), "dangling"),
    "reversed offsets": ({**ARRAYS, "offsets": np.where(np.arange(len(E))[:, None] % 2, O, -O)}, "reversed"),
}


@pytest.mark.parametrize(("source", "word"), REPAIRS.values(), ids=REPAIRS)
def test_a_repair_restores_the_network_and_is_reported(source, word):
    read = network_from(**source)
    assert word in str(read)
    assert read.repaired
    assert read.value.n_edges == HONEYCOMB.n_edges
    with pytest.raises(NetworkError, match=f"strict.*{word}"):
        network_from(**source, strict=True)
    # Which of two directions is kept is arbitrary: lengths are not.
    np.testing.assert_allclose(np.linalg.norm(read.value.bond_vectors(read.positions), axis=1), 1, rtol=1e-12)
    np.testing.assert_array_equal(
        np.sort(source["edges"][read.data.edge_numbers]), np.sort(read.data.vertex_numbers[read.value.edges])
    )


def test_a_sound_source_is_unchanged_and_not_repaired():
    read = network_from(**ARRAYS, strict=True)
    assert isinstance(read, ImportedNetwork) and not read.repaired
    np.testing.assert_array_equal(read.network.edges, E)
    np.testing.assert_array_equal(read.network.offsets, O)
    assert "32 vertices, 48 edges, 2D, periodic, z = 3" in str(read)


def test_offsets_follow_from_bond_vectors_and_from_nearest_images():
    network = voronoi_network(n_vertices=64, seed=3)
    L = network.bond_vectors(network.positions)
    for given_ in ({"bond_vectors": L}, {}):
        read = network_from(edges=network.edges, positions=network.positions, cell=network.cell, **given_)
        np.testing.assert_array_equal(read.network.offsets, network.offsets)


def test_long_edges_have_ambiguous_images():
    small = voronoi_network(n_vertices=8, seed=1)
    source = {"edges": small.edges, "positions": small.positions, "cell": small.cell}
    with pytest.raises(InputError, match="ambiguous"):
        network_from(**source)
    assert network_from(**source, nearest=True).ok


@pytest.mark.parametrize("make", [lambda: voronoi_network(n_vertices=64, seed=3), lambda: lattice("honeycomb", 2, 2)])
def test_a_few_edges_longer_than_the_cell_are_kept_with_a_sentence(tmp_path, make):
    network = make()
    offsets = network.offsets.copy()
    crossing = int(np.flatnonzero(offsets.any(axis=1))[0])
    for factor in (3, -1):
        offsets[crossing] = factor * network.offsets[crossing]
        source = {"edges": network.edges, "positions": network.positions, "offsets": offsets, "cell": network.cell}
        read = network_from(**source, strict=True)
        assert "1 edge is longer than the cell" in str(read) and not read.repaired
        np.testing.assert_array_equal(read.network.offsets, offsets)
        write_network(read, tmp_path / "long.csv")
        np.testing.assert_array_equal(network_from(tmp_path / "long.csv").network.offsets, offsets)


def test_reversed_offsets_of_a_narrow_cell_are_turned_on_every_edge():
    # Across its width no edge is longer than the diagonal, so that lengths show the mistake on two edges of 32 only.
    network = lattice("honeycomb", 30, 2)
    source = {"edges": network.edges, "positions": network.positions, "cell": network.cell}
    read = network_from(**source, offsets=-network.offsets)
    assert "reversed" in str(read) and read.repaired
    np.testing.assert_array_equal(read.network.offsets, network.offsets)


def test_rounded_coordinates_are_reported_with_their_decimals():
    network = voronoi_network(n_vertices=64, seed=3)
    rounded = np.round(network.positions, 6)
    read = network_from(edges=network.edges, positions=rounded, offsets=network.offsets, cell=network.cell)
    assert read.data.digits.decimals == 6 and "6 decimals" in str(read)
    assert network_from(network).data.digits.error == 0


def square_patch():
    """A square of 5 × 5 vertices without a cell."""
    whole = lattice("square", 5, 5)
    return {"edges": whole.edges[~whole.offsets.any(axis=1)], "positions": whole.positions}


def test_a_free_patch_is_a_question_with_proposals():
    with pytest.raises(NetworkError, match="pins='hull' fixes 16"):
        network_from(**square_patch())


@pytest.mark.parametrize(
    ("pins", "count"),
    # Corners of the patch hang on edges between fixed vertices, and leave with them.
    [("hull", 12), ("box", 12), ([0, 4, 20, 24], 4), (np.arange(25) % 6 == 0, 5)],
)
def test_fixed_vertices_by_rule_list_or_mask(pins, count):
    assert len(network_from(**square_patch(), pins=pins).network.pins) == count


def test_what_takes_the_place_of_values_of_the_source_is_reported(tmp_path):
    read = network_from(**square_patch(), pins="hull", volume=16.0)
    write_network(read, tmp_path / "n.csv")
    same = network_from(tmp_path / "n.csv", pins=sorted(read.network.pins), volume=16.0)
    assert not [note for note in same.notes if "in place of" in note]
    free = next(iter(set(range(read.network.n_vertices)) - set(read.network.pins)))
    notes = network_from(tmp_path / "n.csv", pins=[*read.network.pins, free], volume=15.0).notes
    assert any("13 vertices are fixed, in place of the 12 of the source" in note for note in notes)
    assert "V = 15 in place of the 16 of the source" in notes


def test_chains_are_contracted_on_request():
    # Each edge of the honeycomb in three parts, with springs in series.
    m = len(E)
    L = HONEYCOMB.bond_vectors(X)
    first = N + 2 * np.arange(m)
    # The second vertex of each chain lies in the cell of its head.
    middle = np.stack([X[E[:, 0]] + L / 3, X[E[:, 1]] - L / 3], axis=1).reshape(-1, 2)
    zero = np.zeros_like(O)
    source = {
        "edges": np.concatenate(
            [np.stack([E[:, 0], first], 1), np.stack([first + 1, first], 1), np.stack([first + 1, E[:, 1]], 1)]
        ),
        "offsets": np.concatenate([zero, -O, zero]),
        "positions": np.concatenate([X, middle]),
        "cell": C,
        "stiffness": np.repeat([1.0, 2.0, 4.0], m),
        "rest_lengths": np.repeat([0.1, 0.2, 0.3], m),
    }
    assert "contract=True" in str(network_from(**source))
    read = network_from(**source, contract=True)
    assert (read.network.n_vertices, read.network.n_edges) == (N, m)
    np.testing.assert_allclose(read.network.stiffness, 1 / (1 + 1 / 2 + 1 / 4))
    np.testing.assert_allclose(read.rest_lengths, 0.6)
    np.testing.assert_allclose(np.linalg.norm(read.network.bond_vectors(X), axis=1), 1, rtol=1e-12)


def test_fixed_vertices_of_two_edges_are_no_part_of_a_chain():
    # Two stars of three edges that share a fixed end.
    x = [[0, 0], [-1, 1], [-1, -1], [1, 0], [2, 0], [3, 1], [3, -1]]
    source = {"edges": [[0, 1], [0, 2], [0, 3], [4, 3], [4, 5], [4, 6]], "positions": x, "pins": [1, 2, 3, 5, 6]}
    read = network_from(**source, contract=True)
    assert (read.network.n_vertices, read.network.n_edges, read.repaired) == (7, 6, False)


def test_the_hull_of_a_turned_patch_without_its_bare_vertices():
    source = square_patch()
    turn = np.array([[0.8, 0.6], [-0.6, 0.8]])
    source["positions"] = np.concatenate([source["positions"] @ turn / 3, [[90.0, 90.0]]])
    read = network_from(**source, pins="hull")
    # Of 16 on the sides of the square, four corners hang on edges between fixed vertices.
    assert len(read.network.pins) == 12 and read.network.n_vertices == 21


def test_a_sheet_is_read_in_its_plane_unless_edges_leave_it():
    x = np.column_stack([np.full(4, 2.0), np.random.default_rng(1).random((4, 2))])
    edges = np.array([[0, 1], [1, 2], [2, 3], [3, 0]])
    cell, offsets, bonds = np.diag([3.0, 2.0, 2.0]), np.zeros((4, 3), int), x[edges[:, 1]] - x[edges[:, 0]]
    plane = in_its_plane(NetworkData(edges, x, cell=cell, offsets=offsets, bond_vectors=bonds))
    np.testing.assert_array_equal(plane.positions, x[:, 1:])
    np.testing.assert_array_equal(plane.bond_vectors, bonds[:, 1:])
    np.testing.assert_array_equal(plane.cell, 2 * np.eye(2))
    out, oblique, long = offsets.copy(), cell.copy(), bonds.copy()
    out[1, 0], oblique[0, 1], long[1, 0] = 1, 0.5, 3.0
    for change in ({"offsets": out}, {"cell": oblique}, {"cell": oblique.T}, {"bond_vectors": long}):
        given = {"cell": cell, "offsets": offsets, "bond_vectors": bonds, **change}
        assert in_its_plane(NetworkData(edges, x, **given)).dimension == 3


test_bad_input_is_one_sentence = refused_changes(
    network_from,
    ({}, "source"),
    ({"edges": E}, "positions"),
    ({"edges": "many", "positions": X}, "numbers"),
    ({"edges": E, "positions": np.where(X == X[3], np.nan, X), "cell": C}, "positions.*finite"),
    ({"edges": E + 7, "positions": X, "cell": C}, "counting"),
    ({**ARRAYS, "stiffness": [1, 2]}, "row"),
    ({**ARRAYS, "colour": 3}, "keyword"),
    ({**ARRAYS, "offsets": O + 0.5}, "whole"),
    ({**ARRAYS, "offsets": O[:, 0]}, "shape"),
    ({**ARRAYS, "offsets": None, "bond_vectors": np.where(X[E[:, 0]] == X[3], np.nan, 1.0)}, "bond_vectors"),
    ({**ARRAYS, "offsets": None, "bond_vectors": np.ones((len(E), 3))}, "shape"),
    ({**ARRAYS, "rest_lengths": -np.ones(len(E))}, "rest_lengths"),
    ({**ARRAYS, "force_densities": np.full(len(E), np.nan)}, "force_densities"),
    ({**ARRAYS, "cell": [[1, 1], [1, 1]]}, "span"),
    ({**ARRAYS, "cell": [[1, np.nan], [0, 1]]}, "span"),
    ({**ARRAYS, "cell": 0.0}, "span"),
    ({**ARRAYS, "edges": E + 0.5}, "whole"),
    ({**ARRAYS, "edges": np.where(E == 3, np.nan, E)}, "whole"),
    ({**ARRAYS, "positions": 1j * X}, "numbers"),
    ({**ARRAYS, "positions": 1e200 * X}, "units"),
    ({"edges": E, "positions": np.column_stack([X, X]), "pins": [0]}, "columns"),
    ({"polygons": [[0, 1]], "positions": X}, "three"),
    ({"polygons": [["a", "b", "c"]], "positions": X}, "polygons"),
    ({"polygons": [[0, 1, 2]]}, "positions"),
    ({"polygons": 3}, "polygons"),
    ({"polygons": [X[:4]], "weld": -1}, "weld"),
    ({"polygons": [X[:4]], "weld": 99}, "smaller"),
    ({"polygons": [[[1, 1], [2, 2], [1, 1], [1, 1]], X[:4]]}, "polygon 0, or it has a corner twice"),
    ({"polygons": [[[0, 0], [1, 0], [1, 1]], [[0, 0], [1, 1], [0, 1]]], "cell": 9.0}, "across a periodic cell"),
    ({"labels": np.eye(9, dtype=int), "pixel": 0}, "pixel"),
    ({**ARRAYS, "cell": np.eye(4)}, "cell"),
    ({"source": "network.xyzzy"}, "ending"),
    ({"source": "missing.graphml"}, "no file"),
    ({"source": 3.5}, "source"),
    ({"source": "many.nc"}, "one case"),
    ({"edges": [[0, 1], [1, 2]], "positions": np.eye(3)[:, :2], "pins": [0]}, "tension"),
    ({**square_patch(), "pins": "border"}, "rule"),
    ({**square_patch(), "pins": "degree"}, "no vertex"),
    ({**square_patch(), "pins": [99]}, "exist"),
    ({**square_patch(), "pins": [True]}, "mask"),
)


@settings(max_examples=40, deadline=None)
@given(
    st.lists(st.tuples(st.integers(-1, 9), st.integers(0, 9)), min_size=0, max_size=30),
    st.integers(1, 9),
    st.integers(1, 3),
    st.integers(0, 2**32 - 1),
    st.booleans(),
    st.sampled_from([None, "hull", "degree", "box", [0, 1]]),
)
def test_broken_input_is_a_network_or_a_sentence(edges, n_vertices, d, seed, periodic, pins):
    rng = np.random.default_rng(seed)
    x = np.round(rng.normal(size=(n_vertices, d)), 2)
    try:
        read = network_from(
            edges=np.array(edges).reshape(-1, 2), positions=x, cell=5.0 * np.eye(d) if periodic else None, pins=pins
        )
    except CritflowError as error:
        assert len(str(error)) < 700 and "\n" not in str(error)
        return
    assert isinstance(read.network, Network) and read.ok


def test_pinned_patches_follow_strain_paths_with_moduli_per_named_volume():
    whole = voronoi_network(n_vertices=40, seed=1)
    inner = (whole.offsets == 0).all(axis=1)
    source = {"edges": whole.edges[inner], "positions": whole.positions, "pins": "hull"}
    patch = network_from(**source, volume=20.0).network
    critical = critical_from_lengths(patch, np.ones(patch.n_edges), throw=False).value
    strains = np.array([0.5e-4, 1e-4, 1.5e-4])
    path = strain_path(critical, strains).value
    moduli, exact = elasticity(critical).value, stiffening(critical).value
    # One formula per volume: with the pins, Σσ L·A L over the edges is the work of the boundary.
    work = critical.sigma @ critical.lengths**2
    assert moduli.bulk == pytest.approx(work**2 / (4 * 20.0 * (critical.tensions**2).sum()), rel=1e-12)
    np.testing.assert_allclose(path.bulk_modulus, moduli.bulk + exact.C_B * strains, rtol=3e-4)
    np.testing.assert_allclose(path.modulus, path.energy * 2 / strains**2 / 20.0, rtol=5e-2)
    half = strain_path(replace(critical, network=patch.with_volume(10.0)), strains).value
    np.testing.assert_allclose(half.bulk_modulus, 2 * path.bulk_modulus, rtol=1e-12)
