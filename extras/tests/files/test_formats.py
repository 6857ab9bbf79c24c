"""Networks that are written are read again, by every format: a table of formats × what they keep."""

import xml.etree.ElementTree as ET
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import ConvexHull

import critflow_extras.files.data as exchange
from critflow import InputError, Network, critical_from_lengths, lattice, voronoi_network
from critflow.result import EnvironmentFailure
from critflow_extras import network_from, write_network
from critflow_extras.files.convert import data_of
from critflow_extras.files.drawings import clipped_segments

networkx = pytest.importorskip("networkx")


def pinned_network():
    whole = voronoi_network(n_vertices=200, seed=2)
    x = whole.positions
    inner = (whole.offsets == 0).all(axis=1) & ((x > 2) & (x < 12)).all(axis=1)[whole.edges].all(axis=1)
    return network_from(edges=whole.edges[inner], positions=x, pins="hull", volume=123.456).network


NETWORKS = {
    "voronoi": voronoi_network(n_vertices=64, seed=1).with_stiffness(np.linspace(1, 3, 96)),
    "sheared": voronoi_network(n_vertices=64, seed=4).deformed([[1.0, 0.3], [0.0, 1.2]]),
    "diamond": lattice("diamond", 3, 3, 3),
    "pinned": pinned_network(),
}
# Error of the coordinates in each format; GSD has single precision and no values of edges.
ERRORS = dict.fromkeys(("csv", "tsv", "graphml", "gml", "json", "data", "vtu"), 1e-14) | {"gsd": 3e-6}


@pytest.mark.parametrize("name", NETWORKS)
@pytest.mark.parametrize("ending", ERRORS)
def test_a_network_survives_its_file(tmp_path, name, ending):
    for package in {"gsd": ["gsd.hoomd"], "vtu": ["meshio"]}.get(ending, []):
        pytest.importorskip(package)
    network, path = NETWORKS[name], tmp_path / f"network.{ending}"
    write_network(network, path)
    found = network_from(path)
    read = found.network
    assert not found.repaired and ("single precision" in str(found)) == (ending == "gsd")
    np.testing.assert_array_equal(read.edges, network.edges)
    assert list(read.pins) == sorted(network.pins) and (read.cell is None) == (network.cell is None)
    there, here = (n.bond_vectors(n.positions) for n in (read, network))
    # Particle formats turn a cell so that its first vector is along x.
    if network.cell is not None and not np.allclose(read.cell, network.cell):
        there, here = there @ there.T, here @ here.T
    np.testing.assert_allclose(there, here, rtol=0, atol=ERRORS[ending])
    assert read.volume == pytest.approx(network.volume, rel=1e-6 if ending == "gsd" else 1e-14)
    if ending != "gsd":
        np.testing.assert_allclose(read.stiffness, network.stiffness, rtol=1e-15)
    if name == "pinned":
        assert read.faces.n_faces == network.faces.n_faces > 20
        # Without a name the volume is that of the hull, as in `examine`; another one is named by the user.
        write_network(replace(network, reference_volume=None), path)
        hull = network_from(path)
        assert hull.network.volume == pytest.approx(ConvexHull(hull.positions).volume) and "convex hull" in str(hull)
        assert network_from(path, volume=7).network.volume == 7


@settings(max_examples=5, deadline=None)
@given(st.integers(0, 2**32 - 1), st.booleans())
def test_random_networks_survive_every_format_with_offsets(tmp_path_factory, seed, pinned):
    """Oblique cells, several edges between two vertices, edges to images of their own tail, all digits."""
    rng, n = np.random.default_rng(seed), 6
    ring = np.stack([np.arange(n), np.roll(np.arange(n), -1)], axis=1)
    edges = np.concatenate([ring, ring[:3], [[2, 2]]])
    offsets = np.zeros((10, 2), int)
    offsets[5:] = [[1, 0], [0, 1], [0, -1], [-1, 0], [2, 0]]
    cell = np.array([[3.0, 0.0], [rng.uniform(-1, 1), 2.0 + rng.random()]])
    pins = {0: 0.2 * rng.random(2), 3: 0.2 * rng.random(2)} if pinned else {}
    x = 0.2 * rng.random((n, 2)) @ cell
    network = Network(edges, offsets, cell, rng.uniform(0.1, 10, 10), pins, positions=x)
    rest, sigma = rng.uniform(0.1, 10, (2, 10))
    folder = tmp_path_factory.mktemp("formats")
    for ending in ("csv", "tsv", "graphml", "gml", "json", "vtu"):
        write_network(network, folder / f"n.{ending}", rest_lengths=rest, force_densities=sigma)
        found = network_from(folder / f"n.{ending}", nearest=True)
        read = found.network
        np.testing.assert_array_equal(read.edges, network.edges)
        np.testing.assert_array_equal(read.offsets, network.offsets)
        expected = ((network.cell, read.cell), (network.stiffness, read.stiffness), (rest, found.rest_lengths))
        for one, other in (*expected, (sigma, found.force_densities)):
            np.testing.assert_array_equal(other, one)
        free = np.delete(np.arange(n), list(pins))
        np.testing.assert_array_equal(found.positions[free], x[free])
        assert list(read.pins) == list(pins)
        np.testing.assert_array_equal(list(read.pins.values()), list(pins.values()))


def test_a_configuration_is_written_with_its_lengths_and_stresses(tmp_path):
    solution = critical_from_lengths(NETWORKS["voronoi"], np.ones(96))
    for thing in (solution, solution.value):
        write_network(thing, tmp_path / "c.csv")
        read = network_from(tmp_path / "c.csv")
        np.testing.assert_array_equal(read.force_densities, solution.value.sigma)
        np.testing.assert_array_equal(read.rest_lengths, solution.value.lengths)
        np.testing.assert_array_equal(read.positions, solution.value.coordinates)
        np.testing.assert_array_equal(network_from(thing).positions, solution.value.coordinates)
    write_network(read, tmp_path / "again.csv")
    np.testing.assert_array_equal(network_from(tmp_path / "again.csv").force_densities, solution.value.sigma)


@pytest.mark.parametrize("name", ["sheared", "diamond"])
def test_copies_of_a_cell_are_one_larger_network(tmp_path, name):
    network = NETWORKS[name].with_stiffness(np.linspace(1, 2, NETWORKS[name].n_edges))
    copies = (2, 1, 3)[: network.dimension]
    write_network(network, tmp_path / "n.csv", copies=copies)
    read = network_from(tmp_path / "n.csv", strict=True).network
    m = int(np.prod(copies))
    assert (read.n_vertices, read.volume) == (m * network.n_vertices, pytest.approx(m * network.volume))
    L = network.bond_vectors(network.positions)
    np.testing.assert_allclose(read.bond_vectors(read.positions), np.tile(L, (m, 1)), rtol=0, atol=1e-13)
    np.testing.assert_array_equal(read.stiffness, np.tile(network.stiffness, m))
    # Each spring pulls at the same force as in one cell: a copy that is joined to a wrong one is out of balance.
    sigma = np.tile(1.0 + np.arange(network.n_edges), m)
    force = read.incidence.T @ (sigma[:, None] * read.bond_vectors(read.positions))
    once = network.incidence.T @ (sigma[: network.n_edges, None] * L)
    np.testing.assert_allclose(force, np.tile(once, (m, 1)), rtol=0, atol=1e-10)


# Drawings and solids


def drawn_length(path):
    """Number and total length of the lines of an SVG drawing."""
    words = ET.parse(path).getroot()[1].get("d").replace("M", " ").replace("L", " ").split()
    ends = np.array(words, float).reshape(-1, 2, 2)
    return len(ends), np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).sum()


@pytest.mark.parametrize(
    ("network", "copies"),
    [(NETWORKS["voronoi"], 1), (NETWORKS["sheared"], 2), (lattice("kagome", 7, 5), 1)],
    ids=["voronoi", "sheared", "edges along the border"],
)
def test_drawings_have_the_requested_size(tmp_path, network, copies):
    write_network(network, tmp_path / "n.svg", size=50.0, width=0.4, copies=copies, by_stiffness=False)
    root = ET.parse(tmp_path / "n.svg").getroot()
    assert max(float(root.get(side).removesuffix("mm")) for side in ("width", "height")) == pytest.approx(50.8)
    extent = np.ptp(np.array([[0, 0], [1, 0], [0, 1], [1, 1]]) @ (copies * network.cell), axis=0).max()
    L = network.bond_vectors(network.positions)
    total = copies**2 * np.linalg.norm(L, axis=1).sum() * 50 / extent
    count, length = drawn_length(tmp_path / "n.svg")
    assert length == pytest.approx(total, rel=1e-5)
    # No edge is cut at a border between two copies.
    assert count <= copies**2 * len(clipped_segments(data_of(network))[0]) - (copies > 1)


def test_a_drawing_has_its_size_wherever_the_network_is(tmp_path):
    x = [[10, 3], [12, 4], [14, 3]]
    write_network(Network([[0, 1], [1, 2]], pins={0: x[0], 2: x[2]}, positions=x), tmp_path / "n.svg", size=40, width=1)
    root = ET.parse(tmp_path / "n.svg").getroot()
    assert [float(root.get(side).removesuffix("mm")) for side in ("width", "height")] == pytest.approx([42, 12])


@pytest.mark.parametrize(("name", "copies"), [("sheared", (2, 2)), ("diamond", 1)])
def test_solids_are_watertight_and_state_their_units(tmp_path, name, copies):
    trimesh = pytest.importorskip("trimesh")
    for file in ("n.stl", "n.3mf"):
        write_network(NETWORKS[name], tmp_path / file, copies=copies, size=120.0, radius=0.5)
        solid = trimesh.load_mesh(tmp_path / file)
        assert solid.is_watertight and solid.is_winding_consistent
        assert max(solid.extents) == pytest.approx(121, rel=1e-3)
        assert all(body.volume > 0 for body in solid.split()[:5])
    assert b"millimetres" in (tmp_path / "n.stl").read_bytes()[:80]
    assert trimesh.load(tmp_path / "n.3mf").units == "millimeter"
    stl, packed = (trimesh.load_mesh(tmp_path / file) for file in ("n.stl", "n.3mf"))
    assert stl.volume == pytest.approx(packed.volume, rel=1e-5) and len(stl.faces) == len(packed.faces)


def test_cross_sections_of_struts_are_those_of_their_stiffness(tmp_path):
    # k = E A/|L|: areas ∝ k|L|, 1 and 6 here, of mean 3.5.
    x = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 2.0]])
    network = Network([[0, 1], [1, 2]], pins={0: x[0], 2: x[2]}, positions=x, stiffness=[1.0, 3.0])
    write_network(network, tmp_path / "n.svg", size=100.0, width=0.7, by_stiffness=True)
    paths = ET.parse(tmp_path / "n.svg").getroot()[1:]
    assert [float(path.get("stroke-width")) for path in paths] == pytest.approx([0.2, 1.2])
    trimesh = pytest.importorskip("trimesh")
    write_network(network, tmp_path / "n.stl", size=100.0, radius=1.0, by_stiffness=True)
    solid = trimesh.load_mesh(tmp_path / "n.stl")
    bodies = sorted(solid.split(), key=lambda body: len(body.faces))
    assert solid.is_watertight and len(bodies) == 5
    radii = np.array([1.0, 6.0]) ** 0.5 / 3.5**0.5
    assert sorted(np.ptp(body.vertices[:, 2]) / 2 for body in bodies[:2]) == pytest.approx(radii, rel=1e-4)
    # Balls are as large as the largest strut that ends there.
    assert sorted(np.ptp(body.vertices[:, 2]) / 2 for body in bodies[2:]) == pytest.approx(radii[[0, 1, 1]], rel=1e-4)


def test_stiffnesses_that_vary_are_seen_without_an_option(tmp_path):
    """Widths and colours of the drawing, and a legend with both ends; one width where none varies, or if requested."""
    x = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 2.0]])
    ends = {"pins": {0: x[0], 2: x[2]}, "positions": x}
    for stiffness, labels in (([1.0, 3.0], ["k = 0", "3"]), ([0.1, 4.0], ["k = 0.1", "4 (log)"])):
        write_network(Network([[0, 1], [1, 2]], stiffness=stiffness, **ends), tmp_path / "n.svg", size=100.0, width=0.7)
        root = ET.parse(tmp_path / "n.svg").getroot()
        paths = [one for one in root if one.tag.endswith("path")]
        widths = np.array([float(path.get("stroke-width")) for path in paths])
        sections = np.array(stiffness) * [1, 2]
        assert widths == pytest.approx(0.7 * sections / sections.mean(), rel=1e-5)
        assert len({path.get("stroke") for path in paths}) == 2 and paths[1].get("stroke") == "#0b1530"
        assert [text.text for text in root.iter() if text.tag.endswith("text")] == labels
        # The legend lies below the lines, which end at 100 mm and half a width, and within the picture.
        legend = [one for one in root.iter() if one.tag.endswith(("rect", "text"))]
        height = float(root.get("viewBox").split()[3])
        assert all(100 + widths.max() / 2 < float(one.get("y")) < height - 0.7 for one in legend)
    for network, option in (
        (Network([[0, 1], [1, 2]], stiffness=[1.0, 3.0], **ends), {"by_stiffness": False}),
        (Network([[0, 1], [1, 2]], stiffness=[3.0, 3.0], **ends), {}),
    ):
        write_network(network, tmp_path / "n.svg", **option)
        drawn = (tmp_path / "n.svg").read_text()
        assert drawn.count("<path") == 1 and "black" in drawn and "<text" not in drawn


def test_solids_of_stiffnesses_that_vary_have_struts_of_several_radii(tmp_path):
    pytest.importorskip("trimesh")
    contents = []
    for option in ({}, {"by_stiffness": True}, {"by_stiffness": False}):
        write_network(NETWORKS["voronoi"], tmp_path / "n.stl", **option)
        contents.append((tmp_path / "n.stl").read_bytes())
    assert contents[0] == contents[1] != contents[2]


@pytest.mark.parametrize("value", [1e300, np.inf, np.nan, -1.0, 0.0])
@pytest.mark.parametrize(
    ("file", "option"), [("n.stl", "radius"), ("n.stl", "size"), ("n.svg", "size"), ("n.svg", "width")]
)
def test_sizes_that_no_drawing_has_are_refused(tmp_path, file, option, value):
    with pytest.raises(InputError, match=f"{option}=.*millimetres"):
        write_network(NETWORKS["voronoi"], tmp_path / file, **{option: value})
    assert not (tmp_path / file).exists()


def far(network):
    """The network with an edge that is no nearest image."""
    return replace(network, offsets=network.offsets + 2 * (np.arange(network.n_edges) == 0)[:, None])


@pytest.mark.parametrize(
    ("thing", "file", "options", "word"),
    [
        *((NETWORKS["voronoi"], "n.csv", {"copies": n}, "copies") for n in (0, -1, 1.5, (2, 2, 2), "2", (2, 0))),
        (NETWORKS["pinned"], "n.svg", {"copies": 2}, "copies"),
        (NETWORKS["diamond"], "n.svg", {}, "two-dimensional"),
        (NETWORKS["voronoi"], "n.csv", {"size": 3.0}, "size= is no option of the format tables"),
        (NETWORKS["voronoi"], "n.stl", {"radius": 0}, "positive"),
        (NETWORKS["voronoi"], "n.ply", {}, "read only"),
        (NETWORKS["voronoi"], "n.xlsx", {}, "n.xlsx is written by pandas, as extras/docs/recipes/workbooks.md shows"),
        (NETWORKS["voronoi"], "n.dxf", {}, "n.dxf is written by ezdxf, as extras/docs/recipes/drawings.md shows"),
        *(
            (far(voronoi_network(n_vertices=64, seed=1)), f"n.{ending}", {}, "nearest images")
            for ending in ("data", "gsd")
        ),
        (3, "n.csv", {}, "written"),
    ],
)
def test_what_a_format_cannot_hold_is_one_sentence(tmp_path, thing, file, options, word):
    with pytest.raises(InputError, match=word):
        write_network(thing, tmp_path / file, **options)


@pytest.mark.parametrize(("ending", "package"), [("graphml", "networkx"), ("json", "networkx"), ("3mf", "trimesh")])
def test_a_missing_package_is_named_with_its_install_command(tmp_path, monkeypatch, ending, package):
    monkeypatch.setattr(exchange, "import_module", lambda name: (_ for _ in ()).throw(ImportError(name)))
    with pytest.raises(EnvironmentFailure, match=rf"{package}, .*critflow-extras\[formats\]"):
        write_network(NETWORKS["voronoi"], tmp_path / f"n.{ending}")
