"""Messages of a tab and the replies, without a browser."""

import contextlib
import json

import numpy as np
import pytest
import xarray as xr

from critflow import elasticity
from critflow_extras import network_from
from critflow_extras.explore.datasets import Dataset, Filter
from critflow_extras.explore.exports import network_file, picture_file
from critflow_extras.explore.page import Page
from critflow_extras.explore.picture import SHADES
from critflow_extras.explore.source import Random
from critflow_extras.explore.view import WAITS, packed


@pytest.fixture
def page():
    return Page(Random(64, 3))


@pytest.fixture
def data(dataset):
    return Page(Dataset(dataset))


def header(page, **message):
    return page.handle(message).header


def precise(page):
    """The stage with error bounds, which comes after the first numbers."""
    page.refine()
    return page.refine().header


def test_a_reply_has_all_that_is_shown(page):
    reply = page.handle({"do": "look"})
    assert {"network", "forces"} == set(reply.drawings)
    size = int.from_bytes(packed(reply)[:4], "little")
    read = json.loads(packed(reply)[4 : 4 + size])
    assert read["sizes"] == "64 vertices, 96 edges, 32 faces"
    n = sum(5 * drawing["n"] for drawing in read["drawings"].values())
    assert len(packed(reply)) == 4 + size + 4 * (n + 96)
    tensions = page.session.state.critical.tensions
    sent = np.frombuffer(packed(reply)[-4 * 96 :], "<f4")
    np.testing.assert_allclose(sent, tensions / tensions.mean(), rtol=1e-6)
    stages = [page.refine().header for _ in range(3)]
    assert page.refine() is None
    shown = {number["key"] for part in stages for number in part["numbers"]}
    assert set(reply.header["due"]) <= shown


def test_edges_are_coloured_by_a_quantity_that_stays(page):
    scale = header(page, do="look")["scale"]
    assert scale["name"].startswith("tension") and scale["low"] == "0"
    first = page.view.drawings["network"].shades
    scale = header(page, do="colour", by="length")["scale"]
    lengths = page.session.state.critical.lengths
    assert [scale["low"], scale["high"]] == [f"{value:#.4g}" for value in np.percentile(lengths, [1, 99])]
    shades = page.view.drawings["network"].shades
    assert not np.array_equal(shades, first) and len(page.view.drawings["forces"].shades) > 0
    assert header(page, do="open", n_vertices=36, seed=1)["scale"]["colour"] == "length"
    wrong = header(page, do="colour", by="weight")
    assert wrong["error"] and "tension, length, stress" in wrong["sentence"] and wrong["scale"]["colour"] == "length"


def test_numbers_and_limits_follow_the_picture(page):
    page.handle({"do": "select", "face": 4})
    before = precise(page)["face"]
    picture = header(page, do="change", change=["edge", 5, 2.0])
    assert "numbers" not in picture and picture["face"] == before and page.wait == WAITS[0]
    first = page.refine().header
    assert {number["key"] for number in first["numbers"]} == {"B_0", "G_0", "V_L", "V_tau", "residual"}
    assert page.wait > 0 and page.refine().header["face"]["high"] != before["high"]
    # The same configuration past the transition has the same numbers, and they are not computed again.
    known = page.view._known["quick"][1]
    header(page, do="change", change=["strain", "dilation", 0.01])
    page.refine()
    assert page.view._known["quick"][1] is known


def test_picking_and_keys(page):
    page.handle({"do": "look"})
    segment = 7
    x, y = page.view.drawings["network"].segments[segment].mean(axis=0)
    edge = int(page.view.drawings["network"].edges[segment])
    assert header(page, do="pick", panel="network", x=x, y=y, tool="edge")["edge"]["number"] == edge
    assert header(page, do="select", edge=95)["edge"]["number"] == 95
    found = header(page, do="pick", panel="network", x=x, y=y, tool="face")
    assert found["face"]["low"] < 0 < found["face"]["high"]
    face, high = found["face"]["number"], found["face"]["high"]
    found = header(page, do="change", change=["face", face, high])
    assert not found["error"] and found["face"]["value"] == high and found["face"]["high"] == high
    cut = header(page, do="pick", panel="network", x=x, y=y, tool="cut")
    assert "95 edges" in cut["sizes"] and cut["edge"] is None
    assert header(page, do="undo")["sizes"].startswith("64 vertices, 96 edges")


def test_the_curve_past_the_transition(page):
    for gamma in (0.01, 0.02):
        page.handle({"do": "change", "change": ["strain", "dilation", gamma]})
        reply = precise(page)
    assert reply["curve"]["x"] == (0.01, 0.02)
    values = {number["key"]: number["text"] for number in reply["numbers"]}
    assert abs(float(values["B(γ)"]) - reply["curve"]["y"][1]) < 1e-12
    # B_0 + C_B γ is the tangent at the transition, so its error falls with the square of γ.
    zero, slope = float(values["B_0"]), float(values["C_B"])
    errors = [abs(b - zero - slope * g) for g, b in zip(reply["curve"]["x"], reply["curve"]["y"], strict=True)]
    assert 3 < errors[1] / errors[0] < 5


WRONG = {
    "unknown": ({"do": "fly"}, "fly"),
    "nothing": ({}, "None"),
    "no change": ({"do": "change"}, "incomplete"),
    "bad panel": ({"do": "pick", "panel": "sky", "x": 0, "y": 0}, "incomplete"),
    "far edge": ({"do": "select", "edge": 99999}, "no edge 99999: choose one from 0 to 94"),
    "negative edge": ({"do": "select", "edge": -1}, "no edge -1"),
    "face without faces": ({"do": "select", "face": 99999}, "no face 99999"),
    "face after a cut": ({"do": "change", "change": ["face", 0, 0.1]}, "three edges"),
    "case without dataset": ({"do": "case", "case": 0}, "dataset"),
    "size": ({"do": "open", "n_vertices": 7, "seed": 0}, "even"),
    "stolen file": ({"do": "file", "name": "/etc/passwd"}, "incomplete"),
}


@pytest.mark.parametrize(("message", "word"), WRONG.values(), ids=WRONG)
def test_a_wrong_message_is_a_sentence(page, message, word):
    page.session.apply(("cut", 0))
    before = page.session.state
    found = page.handle(message).header
    assert found["error"] and word in found["sentence"]
    assert page.session.state is before


def test_tables_open_with_fixed_vertices_and_a_volume(page, tmp_path):
    for table, text in {
        "edges": "tail,head\nA,D\nB,D\nC,D\n",
        "vertices": "id,x,y\nA,0,0\nB,4,0\nC,0,3\nD,1,1\n",
    }.items():
        page.uploads[f"t_{table}.csv"] = tmp_path / f"t_{table}.csv"
        page.uploads[f"t_{table}.csv"].write_text(text)
    refused = header(page, do="file", name="t_edges.csv")
    assert refused["error"] and "neither a cell nor fixed vertices" in refused["sentence"]
    assert refused["random"] == [64, 3]
    opened = header(page, do="file", name="t_edges.csv", pins="A, B, C", volume="6")
    assert not opened["error"] and opened["random"] is None and len(opened["marks"]["pins"]) == 3
    network = page.session.state.model.network
    assert network.volume == 6 and "pins=['A', 'B', 'C'], volume=6.0)" in page.script()


RIGID = {
    "edges": "tail,head\nA,D\nB,D\nC,D\n",
    "vertices": "id,x,y,fixed\nA,0,0,1\nB,4,0,1\nC,0,3,1\nD,3,2,0\n",
}

# A square grid of nine vertices, which lacks its cell, 3 × 3.
_NODES = [{"id": 3 * i + j, "x": i, "y": j} for i in range(3) for j in range(3)]
_LINKS = [(3 * i + j, end) for i in range(3) for j in range(3) for end in ((3 * i + 3) % 9 + j, 3 * i + (j + 1) % 3)]
GRID = json.dumps({"nodes": _NODES, "links": [{"source": a, "target": b} for a, b in _LINKS]})


def uploaded(page, folder, tables):
    for table, text in tables.items():
        page.uploads[f"t_{table}.csv"] = folder / f"t_{table}.csv"
        page.uploads[f"t_{table}.csv"].write_text(text)


def test_a_file_without_force_densities_is_shown_as_given(page, tmp_path):
    """Coordinates and moduli of the file, by how much a change would move them, and no change without a word."""
    uploaded(page, tmp_path, RIGID)
    opened = header(page, do="file", name="t_edges.csv", volume="6")
    network = page.session.state.model.network
    # By hand: equal stress moves D from (3, 2), outside of the triangle, to (4/3, 1), and the mean length is 3.0.
    assert not opened["error"] and "shown as given, with springs at rest" in opened["sentence"]
    assert "starts from equal stress, which changes edges by up to 0.65 of" in opened["sentence"]
    rows = {row["key"]: row for row in page.refine().header["numbers"]}
    expected = elasticity(network, network.positions).value
    assert float(rows["B"]["text"]) == pytest.approx(expected.bulk, rel=1e-12) and expected.bulk > 0
    assert rows["floppy modes"]["text"] == "0" and set(rows) == set(opened["rows"]) and page.refine() is None
    segments = page.view.drawings["network"].segments
    assert [3.0, 2.0] in segments.reshape(-1, 2).tolist()
    assert "elasticity(network, imported.positions)" in page.script()
    assert header(page, do="look")["sentence"] == opened["sentence"]
    changed = header(page, do="change", change=["edge", 0, 0.5])
    assert "no longer those of the file" in changed["sentence"] and "B_0" in changed["rows"]
    assert [3.0, 2.0] not in page.view.drawings["network"].segments.reshape(-1, 2).tolist()
    assert header(page, do="undo")["rest"]
    equal = header(page, do="change", change=["equal_stress"])
    np.testing.assert_allclose(page.session.state.critical.coordinates[3], [4 / 3, 1], rtol=1e-14)
    assert not equal["rest"] and "B" not in equal["rows"]


def test_a_file_as_given_is_exported_as_given(page, tmp_path):
    uploaded(page, tmp_path, RIGID)
    header(page, do="file", name="t_edges.csv", volume="6")
    name, content = network_file(page.session, ".json")
    (tmp_path / name).write_bytes(content)
    assert network_from(tmp_path / name).positions[3].tolist() == [3.0, 2.0]
    assert picture_file(page.session, ".png")[1].startswith(b"\x89PNG")


def test_a_designed_sheet_is_coloured_by_its_stiffness(page, tmp_path):
    """Springs at rest with force densities of zero in the file, as `make --change stiffness` writes them."""
    rows = zip(RIGID["edges"].split(), ("stiffness,force_density", "1,0", "30,0", "2,0"), strict=True)
    uploaded(page, tmp_path, {**RIGID, "edges": "\n".join(map(",".join, rows))})
    opened = header(page, do="file", name="t_edges.csv", volume="6")
    assert "has no force densities" in opened["sentence"] and "starts from equal stress" in opened["sentence"]
    scale, shades = opened["scale"], page.view.drawings["network"].shades
    assert scale["colour"] == "stiffness" and "logarithmic" in scale["name"] and shades.max() == SHADES - 1
    assert picture_file(page.session, ".svg", page.shown_colour)[1].count(b"stiffness k") == 1
    assert header(page, do="colour", by="length")["scale"]["colour"] == "length"
    assert page.view.drawings["network"].shades.max() == SHADES - 1
    assert header(page, do="open", n_vertices=36, seed=1)["scale"]["colour"] == "length"


def test_centres_of_cells_open_by_their_box(page, tmp_path):
    page.uploads["c.csv"] = tmp_path / "c.csv"
    places = np.random.default_rng(1).random((12, 2)) * [3, 2]
    np.savetxt(page.uploads["c.csv"], places, delimiter=",", header="x,y", comments="")
    refused = header(page, do="file", name="c.csv")
    assert refused["error"] and 'the field "centres of cells"' in refused["sentence"]
    assert "--" not in refused["sentence"] and "True" not in refused["sentence"]
    assert not header(page, do="file", name="c.csv", voronoi="yes", cell="3 2")["error"]
    assert page.session.state.model.network.n_vertices == 24


def test_a_file_near_a_critical_configuration_says_by_how_much_it_moves(page, tmp_path):
    near = {"edges": "tail,head\nA,D\nB,D\n", "vertices": RIGID["vertices"].replace("D,3,2", "D,2,0.001")}
    uploaded(page, tmp_path, near)
    opened = header(page, do="file", name="t_edges.csv", volume="6")
    assert not opened["rest"] and "nearest to the positions" in opened["sentence"]
    assert "changes edges by up to 0.0005 of the mean" in opened["sentence"]


def test_a_refusal_speaks_of_the_fields_of_the_page(page, tmp_path):
    uploaded(page, tmp_path, {**RIGID, "vertices": RIGID["vertices"].replace(",1\n", ",0\n")})
    refused = header(page, do="file", name="t_edges.csv")["sentence"]
    assert '"hull" in the field "fixed vertices"' in refused and "pins=" not in refused and "examine(" not in refused
    wrong = header(page, do="file", name="t_edges.csv", cell="ten")["sentence"]
    assert 'the field "cell" must be numbers' in wrong and "--" not in wrong
    page.uploads["grid.json"] = tmp_path / "grid.json"
    page.uploads["grid.json"].write_text(GRID)
    assert not header(page, do="file", name="grid.json", cell="3 3")["error"]
    assert page.session.state.model.network.cell.tolist() == [[3, 0], [0, 3]]


def test_a_dataset_shows_its_cases(data, dataset):
    stored = xr.open_dataset(dataset)
    for case in (0, 3):
        assert not header(data, do="case", case=case)["error"]
        where = data.dataset.position(case)
        moduli = {number["key"]: number for number in precise(data)["numbers"]}
        assert float(moduli["B_0"]["text"]) == pytest.approx(float(stored.B_0.sel(where)), rel=1e-11)
        assert np.allclose(data.session.state.critical.sigma, stored.sigma.sel(where), rtol=1e-12, atol=0)
    # The exported lines run where the dataset lies.
    with contextlib.chdir(dataset.parent):
        scope = {}
        exec(data.script(), scope)
    assert np.array_equal(scope["critical"].sigma, data.session.state.critical.sigma)


def test_filters_of_a_dataset(data):
    found = data.dataset
    assert found.variables(Filter()) == ("B_0", "C_B")
    assert {s["label"] for s in found.points(Filter())} == {"max B_0", "random σ"}
    assert found.description()["statuses"] == {"ok": 4}
    assert found.mask(Filter(status="floppy")).sum() == 0 and found.points(Filter(status="floppy")) == []
    plane = header(data, do="filter", x="C_B", y="G_0")["plane"]
    assert plane["x"] == "C_B" and not plane["own"] and len(plane["series"]) == 2
    assert "series" not in header(data, do="look", series=plane["key"])["plane"]
