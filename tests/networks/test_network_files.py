"""Networks of tables, graphs and cases of datasets: nothing is lost there and back, every fault is named."""

import sys
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from refusals import refused

import critflow as cf
from critflow import InputError, Network, extensions

SIX = np.random.default_rng(5).random((6, 2))
NETWORKS = {
    "plane": cf.voronoi_network(32, seed=1).with_stiffness(np.linspace(1, 3, 48)),
    "oblique": cf.voronoi_network(32, seed=4).deformed([[1.0, 0.3], [0.0, 1.2]]),
    "space": cf.lattice("diamond", 2, 2, 2),
    "pinned": Network(
        *([[0, 3], [1, 3], [2, 3]], None, None, [1.0, 0.1, 1 / 3], {0: [0, 0], 1: [4, 0], 2: [0, 3]}),
        positions=[[0, 0], [4, 0], [0, 3], [1, 1 / 3]],
        reference_volume=2.5,
    ),
    "pinned in a cell": Network(
        *([[0, 1], [1, 0], [1, 1]], [[0, 0], [1, 0], [0, 1]], [[2.0, 0.1], [0, 3]], 1.0, {0: [0.2, 0.1]}),
        positions=[[0.2, 0.1], [1.1, 0.4]],
    ),
    # Several edges between two vertices, and edges to images of their own tail.
    "images": Network(
        [[0, 1], [1, 2], [2, 3], [3, 4], [4, 5], [5, 0], [0, 1], [1, 0], [3, 2], [2, 2]],
        [[0, 0]] * 5 + [[1, 0], [0, 1], [0, -1 - 1], [-1, 0], [2, 0]],
        [[3.0, 0.0], [-0.7, 2.3]],
        positions=SIX,
    ),
    "line": Network([[0, 1], [1, 0]], [[0], [1]], [[2.0]], positions=[[0.1], [0.9]]),
}


def same(one, other):
    """Whether two networks have the same bits."""
    for name in ("edges", "offsets", "stiffness", "positions", "cell"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)
    assert list(one.pins) == sorted(other.pins) and one.reference_volume == other.reference_volume
    np.testing.assert_array_equal(list(one.pins.values()), [other.pins[vertex] for vertex in sorted(other.pins)])
    return True


def through_a_file(thing, ending="csv"):
    def form(tmp_path):
        cf.write_network(thing, tmp_path / f"n.{ending}")
        return tmp_path / f"n.{ending}"

    return form


FORMS = {
    "csv": lambda thing, folder: through_a_file(thing)(folder),
    "tsv": lambda thing, folder: str(through_a_file(thing, "tsv")(folder)),
    "tables": lambda thing, folder: cf.to_tables(thing),
    "tables in the other order": lambda thing, folder: list(reversed(cf.to_tables(thing))),
    "graph": lambda thing, folder: cf.to_graph(thing),
}


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("name", NETWORKS)
def test_a_network_comes_back_with_all_bits(tmp_path, name, form):
    if form == "graph":
        pytest.importorskip("networkx")
    network = NETWORKS[name]
    read = cf.read_network(FORMS[form](network, tmp_path))
    assert same(read, network)
    assert (read.faces is None) == (name in ("space", "images", "line"))
    if network.faces is not None:
        np.testing.assert_array_equal(read.faces.edges, network.faces.edges)


@pytest.mark.parametrize("form", FORMS)
def test_a_critical_configuration_comes_back_with_all_bits(tmp_path, form):
    if form == "graph":
        pytest.importorskip("networkx")
    critical = cf.optimize(NETWORKS["plane"], "B_0").value
    read = cf.read_critical(FORMS[form](critical, tmp_path))
    np.testing.assert_array_equal(read.sigma, critical.sigma)
    np.testing.assert_array_equal(read.coordinates, critical.coordinates)
    assert read.rest_lengths is None and read.residual < 1e-13
    # In the scale in which the stresses are stored; rest lengths that are the lengths are those of cables.
    for rest in (critical.lengths, critical.lengths + 1):
        larger = replace(critical, sigma=3 * critical.sigma, rest_lengths=rest)
        read = cf.read_critical(FORMS[form](larger, tmp_path))
        np.testing.assert_array_equal(read.sigma, larger.sigma)
        np.testing.assert_array_equal(read.rest_lengths, rest)


HUNG = {0: [0.0, 0.0], 2: [3.0, 0.0], 3: [0.0, 3.0]}
MEANT = {
    "parallel springs": (Network([[0, 1], [0, 1], [1, 2], [1, 3]], pins=HUNG), "edge 1 is edge 0 again"),
    "a plane in space": (
        Network([[0, 1], [1, 2], [1, 3]], pins={vertex: [*place, 0.0] for vertex, place in HUNG.items()}),
        "in one plane",
    ),
    "edges beyond the cell": (
        Network([[0, 1]] * 3, [[0, 0], [3, 0], [0, 3]], np.eye(2)),
        "contradict the offsets",
    ),
}


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("name", MEANT)
def test_what_looks_like_a_mistake_comes_back_where_it_is_meant(tmp_path, name, form):
    if form == "graph":
        pytest.importorskip("networkx")
    network, word = MEANT[name]
    critical = cf.CriticalManifold(network).configuration(np.arange(1.0, 1 + network.n_edges))
    read = cf.read_critical(FORMS[form](critical, tmp_path))
    np.testing.assert_array_equal(read.sigma, critical.sigma)
    assert same(read.network, network._copied(positions=critical.coordinates))
    edges, vertices = cf.to_tables(critical)
    vertices.attrs.pop("critflow")
    with pytest.raises(InputError, match=word):
        cf.read_network((edges, vertices))


def test_pins_are_written_where_they_are():
    pinned = Network([[0, 1], [1, 0]], [[0], [1]], [[2.0]], pins={0: [0.25]}, positions=[[0.1], [0.9]])
    assert cf.read_network(cf.to_tables(pinned)).pins[0] == 0.25


def test_a_solution_is_written_as_its_value():
    solution = cf.optimize(NETWORKS["plane"], "B_0")
    for one, other in zip(cf.to_tables(solution), cf.to_tables(solution.value), strict=True):
        pd.testing.assert_frame_equal(one, other)


DIMS = {
    "edges": ("edge", "end"),
    "offsets": ("edge", "axis"),
    "cell": ("cell_vector", "axis"),
    "position": ("vertex", "axis"),
    "sigma": ("edge",),
}


def dataset():
    """A dataset of a case of NETWORKS["plane"] for each of two populations, as it is read from a file."""
    critical = cf.optimize(NETWORKS["plane"].with_stiffness(1), "B_0").value
    network = critical.network
    arrays = (network.edges, network.offsets, network.cell, critical.coordinates, critical.sigma)
    dims = ("seed", "population")
    variables = {
        name: ((*dims, *DIMS[name]), np.stack([[array, array]])) for name, array in zip(DIMS, arrays, strict=True)
    }
    made = xr.Dataset(variables, coords={"seed": [3], "population": ["min_V_L", "max_B_0"]})
    with TemporaryDirectory() as folder:
        made.to_netcdf(file := Path(folder) / "cases.nc", encoding={"population": {"dtype": "S1"}})
        return critical, xr.load_dataset(file)


def test_a_case_of_a_dataset_is_its_network_and_its_configuration():
    critical, cases = dataset()
    case = cases.sel(seed=3, population="max_B_0")
    read = cf.read_critical(case)
    np.testing.assert_array_equal(read.sigma, critical.sigma)
    np.testing.assert_array_equal(read.coordinates, critical.coordinates)
    np.testing.assert_array_equal(cf.read_network(case).edges, critical.network.edges)


def test_tables_of_own_columns():
    """Names of vertices in place of numbers, columns in any order, a cell as an argument."""
    edges = {"stiffness": [1, 2, 3], "head": ["b", "a", "a"], "tail": ["a", "b", "b"]}
    edges |= {"offset_y": [0, 0, 1.0], "offset_x": [0, 1, 0]}
    vertices = {"y": [0.5, 1], "x": [0.2, 1], "id": ["a", "b"]}
    network = cf.read_network((edges, vertices), cell=[[2, 0], [0.5, 2]])
    assert network.edges.tolist() == [[0, 1], [1, 0], [1, 0]] and network.stiffness.tolist() == [1, 2, 3]
    assert network.offsets.tolist() == [[0, 0], [1, 0], [0, 1]] and network.positions.tolist() == [[0.2, 0.5], [1, 1]]


def test_a_graph_of_a_user():
    networkx = pytest.importorskip("networkx")
    graph = networkx.Graph()
    for node, x, y, fixed in (("a", 0, 0, True), ("b", 4, 0, 1), ("c", 0, 3, True), ("d", 1, 1, False)):
        graph.add_node(node, x=x, y=y, fixed=fixed)
    graph.add_edges_from([("d", "a"), ("b", "d"), ("d", "c")], stiffness=2.0)
    network = cf.read_network(graph)
    assert {frozenset(edge) for edge in network.edges.tolist()} == {frozenset((k, 3)) for k in range(3)}
    assert sorted(network.pins) == [0, 1, 2] and network.stiffness.tolist() == [2, 2, 2]
    graph.edges["d", "a"]["offset"] = (1, 0)
    with pytest.raises(InputError, match="no tail"):
        cf.read_network(graph)
    del graph.edges["d", "a"]["offset"], graph.edges["d", "c"]["stiffness"]
    with pytest.raises(InputError, match=r"row \d of column stiffness has nan"):
        cf.read_network(graph)


EDGES = {"tail": [0, 1, 2], "head": [3, 3, 3]}
VERTICES = {"x": [0, 4, 0, 1], "y": [0, 0, 3, 1], "fixed": [1, 1, 1, 0]}
CELL = 9 * np.eye(2)


def given(edges=(), vertices=(), cell=None):
    """Two tables with some columns in place of the right ones, None: without."""
    tables = [{**EDGES, **dict(edges)}, {**VERTICES, **dict(vertices)}]
    return [{name: values for name, values in table.items() if values is not None} for table in tables], cell


FAULTS = {
    "no tail": (given({"tail": None}), "no column tail"),
    "no x": (given(vertices={"x": None, "y": None}), "no column x"),
    "no y": (given(vertices={"y": None, "z": [0, 1, 2, 0]}), "x, z have no common dimension"),
    "another name": (given({"k": [1, 1, 1]}), "no column 'k' of edges is read.*stiffness"),
    "another name of vertices": (given(vertices={"pinned": [1, 1, 1, 0]}), "no column 'pinned'.*fixed"),
    "text": (given(vertices={"y": [0, 0, 3, "one"]}), "row 4 of column y has 'one', which is no number"),
    "NaN position": (given(vertices={"y": [0, 0, 3, np.nan]}), "row 4 of column y has nan"),
    "infinite stiffness": (given({"stiffness": [1, np.inf, 1]}), "row 2 of column stiffness"),
    "negative stiffness": (given({"stiffness": [1, -1, 1]}), r"stiffness\[1\]"),
    "missing vertex": (given({"head": [3, 3, 4]}), "edge 2 joins vertices"),
    "missing name": (given(vertices={"id": list("abcd")}), "edge 0 ends at '0', which is no id"),
    "the same name": (given(vertices={"id": list("abca")}), "id 'a' is that of two"),
    "half a vertex": (given({"head": [3, 3, 0.5]}), "whole"),
    "columns of several lengths": (given({"head": [3, 3]}), "same length"),
    "no rows": (given({"tail": [], "head": []}), "tail and head"),
    "isolated vertex": (
        given(vertices={"x": [0, 4, 0, 1, 7], "y": [0, 0, 3, 1, 7], "fixed": [1, 1, 1, 0, 0]}),
        "vertex 4 hangs on no edge",
    ),
    "loop": (given({"head": [3, 3, 2]}), "edge 2 joins vertex 2 to itself"),
    "neighbour list": (given({"tail": [0, 1, 2, 3], "head": [3, 3, 3, 0]}), "edge 3 is edge 0 again"),
    "fixed in words": (given(vertices={"fixed": ["yes"] * 4}), "row 1 of column fixed has 'yes'"),
    "fixed twice": (given(vertices={"fixed": [1, 1, 2, 0]}), "must be 1 for fixed"),
    "nothing is fixed": (given(vertices={"fixed": None}), "cell or pins"),
    "offsets without a cell": (given({"offset_x": [0, 0, 1], "offset_y": [0, 0, 0]}), "line '# cell'"),
    "a cell without offsets": (given(cell=CELL), "needs the columns offset_x, offset_y"),
    "one offset": (given({"offset_x": [0, 0, 1]}, cell=CELL), "x, y, offset_x have no common dimension"),
    "offsets not whole": (given({"offset_x": [0, 0, 0.5], "offset_y": [0, 0, 0]}, cell=CELL), "whole"),
    "cell in space": (given({"offset_x": [0] * 3, "offset_y": [0] * 3}, cell=np.eye(3)), "4 numbers.*not 9"),
    "flat cell": (given({"offset_x": [0] * 3, "offset_y": [0] * 3}, cell=np.ones((2, 2))), "span"),
    "a word as cell": (given(cell="wide"), "cell must be real numbers"),
    "a plane in space": (given(vertices={"z": [1, 1, 1, 1]}), "one plane"),
    "no table": (([EDGES, 3], None), "table must be"),
    "one table": ((EDGES, None), "two tables"),
    "two tables of edges": (([EDGES, EDGES], None), "no column 'tail' of vertices"),
    "a network": ((NETWORKS["plane"], None), "a Network: it is no network"),
    "no file": (("missing.csv", None), "no file missing_edges.csv"),
    "no ending": (("mine", None), "ending of mine"),
    "a dataset": (("ensemble.nc", None), "one case"),
    "another format": (("mine.graphml", None), "none of .csv"),
}


@pytest.mark.parametrize("name", FAULTS)
@pytest.mark.parametrize("installed", [True, False])
def test_a_fault_is_one_sentence_that_names_what_repairs_it(name, installed, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("critflow.network_files.has_extras", lambda: installed)
    (source, cell), word = FAULTS[name]
    with pytest.raises(InputError, match=word) as refusal:
        cf.read_network(source, cell)
    sentence = str(refusal.value)
    assert "\n" not in sentence and len(sentence) < 450
    assert ("network_from of critflow-extras repairs" if installed else extensions.INSTALL) in sentence


@pytest.mark.parametrize(
    ("vertices", "edges", "word"),
    [
        ("", "tail,head\n0,1\n", "No columns"),
        ("x,y\n0,0\n1\n", "tail,head\n0,1\n", "row 2 of column y"),
        ("x,y\n0,0\n1,2,3\n", "tail,head\n0,1\n", "line 3"),
        ("x,y\n0,0,1\n1,2,3\n", "tail,head\n0,1\n", "more values than its header"),
        ("x,y\n0,0\n1,one\n", "tail,head\n0,1\n", "row 2 of column y has 'one'"),
        ("x,y\n0,0\nNA,1\n", "tail,head\n0,1\n", "row 2 of column x has 'NA'"),
        ("x;y\n0;0\n1;1\n", "tail,head\n0,1\n", "'x;y'"),
        ("0,0\n1,0\n", "tail,head\n0,1\n", "no column '0'"),
        ("# cell 1 2 3\nx,y\n0,0\n1,0\n", "tail,head\n0,1\n", "cell must have 4 numbers"),
        ("# volume\nx,y\n0,0\n1,0\n", "tail,head\n0,1\n", "volume must have 1 number"),
        ("# cell 2 0 0 two\nx,y\n0,0\n1,0\n", "tail,head\n0,1\n", "cell must be real numbers"),
        ("\xff", "tail,head\n0,1\n", "utf-8"),
    ],
)
def test_a_broken_file_is_one_sentence(tmp_path, vertices, edges, word):
    (tmp_path / "t_vertices.csv").write_text(vertices, encoding="latin-1")
    (tmp_path / "t_edges.csv").write_text(edges)
    with pytest.raises(InputError, match=word) as refusal:
        cf.read_network(tmp_path / "t.csv")
    assert "\n" not in str(refusal.value)


BALANCED, CASES = dataset()
CASE = CASES.sel(seed=3, population="max_B_0")
ROWS, PLACES = cf.to_tables(BALANCED)


def rounded(vertices):
    """The table with five digits of the coordinates."""
    found = vertices.round({"x": 5, "y": 5})
    found.attrs = vertices.attrs
    return found


test_sources_that_contradict_themselves_are_refused = refused(
    {
        "two cells": (
            lambda: cf.read_network(cf.to_tables(NETWORKS["plane"]), cell=CELL),
            "a cell of its own: leave cell= out",
        ),
        "many cases": (lambda: cf.read_network(CASES), r"dataset\.sel\(seed=3, population='min_V_L'\)"),
        "two cases": (lambda: cf.read_network(CASES.sel(seed=3)), r"choose one population .*\(population='min_V_L'\)"),
        "unnamed cases": (lambda: cf.read_network(CASE.expand_dims("seed").drop_vars("seed")), r"isel\(seed=0\)"),
        "no edges": (lambda: cf.read_network(CASE.drop_vars("edges")), "lacks edges"),
        "a failed case": (lambda: cf.read_network(CASE * np.nan), "no configuration"),
        "no stresses": (lambda: cf.read_critical(CASE.drop_vars("sigma")), "no force densities"),
        "rounded": (lambda: cf.read_critical((ROWS, rounded(PLACES))), r"do not balance.*all digits"),
        "stresses NaN": (
            lambda: cf.read_critical((ROWS.assign(force_density=np.nan), PLACES)),
            "row 1 of column force_density",
        ),
        "a rest length below zero": (
            lambda: cf.read_critical((ROWS.assign(rest_length=-1.0), PLACES)),
            r"rest_length\[0\] = -1",
        ),
        "stresses of zero": (lambda: cf.read_critical((ROWS.assign(force_density=0.0), PLACES)), "do not balance"),
    },
    InputError,
)

BARE = Network(NETWORKS["plane"].edges, NETWORKS["plane"].offsets, NETWORKS["plane"].cell)


@pytest.mark.parametrize(
    ("thing", "file", "word"),
    [
        (BARE, "n.csv", "no positions"),
        (3, "n.csv", "neither a network nor a critical configuration"),
        (cf.spring_state(NETWORKS["plane"], np.ones(48), NETWORKS["plane"].positions), "n.csv", "SpringState"),
        (NETWORKS["plane"], "n.svg", "none of .csv"),
        (NETWORKS["plane"], "missing/n.csv", "no folder missing"),
    ],
)
def test_what_cannot_be_written_is_one_sentence(thing, file, word, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match=word):
        cf.write_network(thing, file)
    assert not list(tmp_path.iterdir())


def test_a_graph_without_networkx_is_one_sentence(monkeypatch):
    monkeypatch.setitem(sys.modules, "networkx", None)
    with pytest.raises(cf.CritflowError, match="pip install networkx"):
        cf.to_graph(NETWORKS["plane"])
