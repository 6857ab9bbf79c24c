"""Files of other programs: networks that are written are read again, and so are files of the other library."""

import json
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import ConvexHull, Delaunay

import critflow.exchange.packages as packages
from critflow import (
    CriticalManifold,
    InputError,
    Network,
    critical_from_lengths,
    delaunay_network,
    lattice,
    network_from,
    voronoi_network,
    write_network,
)
from critflow.command.main import main
from critflow.exchange.data import data_of
from critflow.exchange.drawings import clipped_segments
from critflow.exchange.meshes import from_mesh
from critflow.explore.source import File
from critflow.result import EnvironmentFailure

networkx = pytest.importorskip("networkx")


def pinned_network():
    whole = voronoi_network(n_vertices=200, seed=2)
    x = whole.positions
    inner = (whole.offsets == 0).all(axis=1) & ((x > 2) & (x < 12)).all(axis=1)[whole.edges].all(axis=1)
    return network_from(edges=whole.edges[inner], positions=x, pins="hull").network


def sheared_network():
    return voronoi_network(n_vertices=64, seed=4).deformed([[1.0, 0.3], [0.0, 1.2]])


NETWORKS = {
    "voronoi": voronoi_network(n_vertices=64, seed=1).with_stiffness(np.linspace(1, 3, 96)),
    "sheared": sheared_network(),
    "diamond": lattice("diamond", 3, 3, 3),
    "pinned": pinned_network(),
}
EXACT = ("csv", "tsv", "graphml", "gml", "json", "data", "vtu")


def assert_same(read: Network, network: Network, digits=0.0):
    np.testing.assert_array_equal(read.edges, network.edges)
    assert list(read.pins) == sorted(network.pins)
    there, here = (n.bond_vectors(n.positions) for n in (read, network))
    # Particle formats turn a cell so that its first vector is along x.
    if network.cell is not None and not np.allclose(read.cell, network.cell):
        there, here = there @ there.T, here @ here.T
    np.testing.assert_allclose(there, here, rtol=0, atol=digits or 1e-14)


@pytest.mark.parametrize("name", NETWORKS)
@pytest.mark.parametrize("ending", EXACT)
def test_a_network_survives_its_file(tmp_path, name, ending):
    network, path = NETWORKS[name], tmp_path / f"network.{ending}"
    write_network(network, path)
    read = network_from(path)
    assert_same(read.network, network)
    assert not read.repaired
    np.testing.assert_allclose(read.network.stiffness, network.stiffness, rtol=1e-15)


@pytest.mark.parametrize("ending", [*EXACT, "xlsx", "gsd"])
def test_a_named_volume_and_faces_survive_their_file(tmp_path, ending):
    for package in {"xlsx": ["openpyxl"], "gsd": ["gsd.hoomd"]}.get(ending, []):
        pytest.importorskip(package)
    network, path = NETWORKS["pinned"].with_volume(123.456), tmp_path / f"network.{ending}"
    write_network(network, path)
    read = network_from(path).network
    assert read.volume == 123.456 and read.faces.n_faces == network.faces.n_faces > 20
    # Without a name it is that of the hull, as in `examine`; another one is named by the user.
    write_network(replace(network, reference_volume=None), path)
    hull = network_from(path)
    assert hull.network.volume == pytest.approx(ConvexHull(hull.positions).volume) and "convex hull" in str(hull)
    assert network_from(path, volume=7).network.volume == 7


@pytest.mark.parametrize("name", NETWORKS)
def test_gsd_keeps_seven_digits_and_reports_it(tmp_path, name):
    pytest.importorskip("gsd.hoomd")
    write_network(NETWORKS[name], tmp_path / "n.gsd")
    read = network_from(tmp_path / "n.gsd")
    assert_same(read.network, NETWORKS[name], digits=3e-6)
    assert (read.network.cell is None) == (NETWORKS[name].cell is None)
    assert "single precision" in str(read)


# Files and objects that other libraries made


def test_networkx_graphs_and_files(tmp_path):
    grid = networkx.grid_2d_graph(5, 5)
    read = network_from(grid, positions={node: node for node in grid}, pins="hull")
    assert read.network.n_edges == 24
    named = networkx.relabel_nodes(grid, {node: f"v{node[0]}{node[1]}" for node in grid})
    for node in named:
        named.nodes[node].update(x=float(node[1]), y=float(node[2]))
    networkx.write_graphml(named, tmp_path / "grid.graphml")
    networkx.write_gml(named, tmp_path / "grid.gml")
    (tmp_path / "grid.json").write_text(json.dumps(networkx.node_link_data(named, edges="edges")))
    (tmp_path / "links.JSON").write_text(json.dumps(networkx.node_link_data(named, edges="links")))
    (tmp_path / "adjacency.json").write_text(json.dumps(networkx.adjacency_data(named)))
    (tmp_path / "own.json").write_text("[1, 2]")
    with pytest.raises(InputError, match="node_link_data"):
        network_from(tmp_path / "own.json")
    for name in ("grid.graphml", "grid.gml", "grid.json", "links.JSON", "adjacency.json"):
        again = network_from(tmp_path / name, pins="hull").network
        np.testing.assert_array_equal(again.positions, read.network.positions)
        assert again.n_edges == 24


def test_json_in_node_link_form(tmp_path):
    path = tmp_path / "n.json"
    write_network(sheared_network(), path)
    graph = networkx.node_link_graph(json.loads(path.read_text()), edges="edges")
    assert graph.is_multigraph() and graph.number_of_edges() == sheared_network().n_edges
    # Order and direction are those of the file, also without attributes that say so.
    nodes = [{"id": [n, 0], "pos": [n % 2, n // 2]} for n in range(4)]
    edges = [{"source": [a, 0], "target": [b, 0], "key": 0} for a, b in ((3, 2), (1, 0), (2, 1), (0, 2), (1, 3))]
    path.write_text(json.dumps({"nodes": nodes, "edges": edges}))
    read = network_from(path, pins=["(0, 0)", "(1, 0)"])
    assert read.data.edges.tolist() == [[3, 2], [2, 1], [0, 2], [1, 3]]
    for nodes, edges, word in (
        ([{"id": 1}], [{"source": 1, "target": 2}], "lacks"),
        ([{"id": 1}, {"id": 1}], [], "same id"),
        ([{"id": 1}], [{"source": 1}], "target"),
        ([1, 2], [], "objects"),
    ):
        path.write_text(json.dumps({"nodes": nodes, "edges": edges}))
        with pytest.raises(InputError, match=word):
            network_from(path)


def test_a_mesh_that_needs_another_package_names_it(tmp_path, monkeypatch):
    meshio = pytest.importorskip("meshio")
    (tmp_path / "m.xdmf").write_text("<Xdmf/>")

    def read(path):
        raise ModuleNotFoundError("No module named 'h5py'", name="h5py")

    monkeypatch.setattr(meshio, "read", read)
    with pytest.raises(EnvironmentFailure, match="pip install h5py"):
        network_from(tmp_path / "m.xdmf")


def test_lammps_data_of_lammpsio(tmp_path):
    lammpsio = pytest.importorskip("lammpsio")
    network = sheared_network()
    # Wrapped positions and atoms in another order, as a simulation leaves them.
    order = np.random.default_rng(1).permutation(64)
    q, r = np.linalg.qr(network.cell.T)
    sign = np.sign(np.diag(r))
    cell, x = (r * sign[:, None]).T, network.positions @ (q * sign)
    snapshot = lammpsio.Snapshot(64, lammpsio.Box([0, 0, -0.5], [cell[0, 0], cell[1, 1], 0.5], [cell[1, 0], 0, 0]))
    fraction = x @ np.linalg.inv(cell)
    position = np.zeros((64, 3))
    position[:, :2] = (fraction - np.floor(fraction)) @ cell
    snapshot.id = order + 1
    snapshot.position = position[order]
    snapshot.typeid = np.ones(64, int)
    snapshot.molecule = np.ones(64, int)
    snapshot.mass = np.ones(64)
    snapshot.bonds = lammpsio.Bonds(network.n_edges, num_types=1)
    snapshot.bonds.id = np.arange(network.n_edges) + 1
    snapshot.bonds.typeid = np.ones(network.n_edges, int)
    snapshot.bonds.members = network.edges + 1
    lammpsio.DataFile.create(str(tmp_path / "l.data"), snapshot, "molecular")
    read = network_from(tmp_path / "l.data").network
    np.testing.assert_array_equal(read.edges, network.edges)
    lengths = [np.linalg.norm(n.bond_vectors(n.positions), axis=1) for n in (read, network)]
    np.testing.assert_allclose(*lengths, rtol=0, atol=1e-7)


STYLES = {
    "# bond": "{n} 1 1 {x} {y} 0",
    "# angle": "{n} 1 1 {x} {y} 0 0 0 0",
    "# molecular": "{n} 1 1 {x} {y} 0",
    "# full": "{n} 1 1 -0.5 {x} {y} 0",
    "": "{n} 1 1 -0.5 {x} {y} 0 0 0 0",
    "# hybrid": "{n} 1 {x} {y} 0 1",
}


@pytest.mark.parametrize(("style", "row"), STYLES.items(), ids=STYLES)
def test_lammps_data_of_every_style_with_bonds(tmp_path, style, row):
    network = lattice("square", 3, 3)
    atoms = [row.format(n=n + 7, x=x, y=y) for n, (x, y) in enumerate(network.positions.tolist())]
    bonds = [f"{n + 1} {1 + n % 2} {i + 7} {j + 7}" for n, (i, j) in enumerate(network.edges.tolist())]
    limits = ["0 3 xlo xhi", "0 3 ylo yhi", "-.5 .5 zlo zhi"]
    lines = [
        "a comment",
        "",
        "9 atoms",
        "18 bonds",
        "4 extra bond per atom",
        *limits,
        "",
        f"Atoms {style}",
        "",
        *atoms[::-1],
    ]
    lines += ["", "Bonds", "", *bonds, "", "Bond Coeffs", "", "1 0.5 1.5", "2 2 0.25  # soft"]
    (tmp_path / "l.data").write_text("\n".join(lines))
    if style == "# hybrid":
        with pytest.raises(InputError, match="bond, angle, molecular, full"):
            network_from(tmp_path / "l.data")
        return
    read = network_from(tmp_path / "l.data")
    np.testing.assert_array_equal(read.network.bond_vectors(read.positions), network.bond_vectors(network.positions))
    np.testing.assert_array_equal(read.network.stiffness, [1, 4] * 9)
    np.testing.assert_array_equal(read.rest_lengths, [1.5, 0.25] * 9)
    assert read.vertex_names[0] == "7"


@pytest.mark.parametrize("ending", ["data", "gsd"])
def test_edges_that_are_no_nearest_images_are_refused_by_formats_of_particles(tmp_path, ending):
    small = voronoi_network(n_vertices=8, seed=1)
    offsets = small.offsets + 2 * (np.arange(small.n_edges) == 0)[:, None]
    with pytest.raises(InputError, match="nearest images"):
        write_network(Network(small.edges, offsets, small.cell, positions=small.positions), tmp_path / f"n.{ending}")


def test_ase_atoms_with_a_neighbour_list():
    ase = pytest.importorskip("ase")
    network = lattice("honeycomb", 4, 4)
    cell = np.zeros((3, 3))
    cell[:2, :2], cell[2, 2] = network.cell, 20
    atoms = ase.Atoms(
        "C32", positions=np.column_stack([network.positions, np.zeros(32)]), cell=cell, pbc=(True, True, False)
    )
    read = network_from(atoms, cutoff=1.1)
    assert "neighbour list" in str(read) and read.network.dimension == 2
    # Edges are longer than a thin slab is high, in which no image is nearer.
    i, j = network.edges.T
    atoms.cell[2, 2] = 1.1
    thin = network_from(atoms, edges=np.stack([i, j], axis=1))
    np.testing.assert_array_equal(thin.network.offsets, network.offsets)
    assert read.network.n_edges == 48
    lengths = np.linalg.norm(read.network.bond_vectors(read.positions), axis=1)
    np.testing.assert_allclose(lengths, 1, rtol=1e-12)


def test_gsd_of_hoomd(tmp_path):
    hoomd = pytest.importorskip("gsd.hoomd")
    network = lattice("honeycomb", 6, 6)
    frame = hoomd.Frame()
    cell = network.cell
    frame.configuration.box = [cell[0, 0], cell[1, 1], 0, cell[1, 0] / cell[1, 1], 0, 0]
    frame.configuration.dimensions = 2
    frame.particles.N = 72
    frame.particles.position = np.column_stack([network.positions - cell.sum(axis=0) / 2, np.zeros(72)])
    frame.bonds.N, frame.bonds.group = 108, network.edges
    with hoomd.open(tmp_path / "h.gsd", "w") as file:
        file.append(frame)
    read = network_from(tmp_path / "h.gsd").network
    # The cell begins at the origin, as in critflow.
    np.testing.assert_allclose(read.positions, network.positions, rtol=0, atol=1e-5)
    np.testing.assert_allclose(np.linalg.norm(read.bond_vectors(read.positions), axis=1), 1, rtol=1e-5)


def test_meshes_of_meshio(tmp_path):
    meshio = pytest.importorskip("meshio")
    x = np.array([[0, 0, 0], [2, 0, 0], [1, 2, 0], [1, 0.7, 0.0]])
    meshio.Mesh(x, [("line", np.array([[0, 3], [1, 3], [2, 3]]))]).write(tmp_path / "star.vtk")
    read = network_from(tmp_path / "star.vtk", pins=[0, 1, 2])
    assert (read.network.dimension, read.network.n_edges) == (2, 3)
    # Lines of four points have their ends first.
    bent = np.array([[0, 0], [3, 0], [1, 1], [2, 1.0]])
    found = network_from(meshio.Mesh(bent, [("line4", np.array([[0, 1, 2, 3]]))]), pins=[0, 1])
    np.testing.assert_array_equal(found.network.edges, [[0, 2], [2, 3], [3, 1]])
    # The border of a sheet is that in its plane.
    assert len(network_from(tmp_path / "star.vtk", pins="hull").network.pins) == 3
    with pytest.raises(InputError, match="read only"):
        write_network(read, tmp_path / "star.ply")


CUBE = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1.0]])
BLOCKS = {
    "triangle": ([[0, 1, 2], [0, 2, 3]], 5),
    "quad": ([[0, 1, 2, 3]], 4),
    "polygon": ([[0, 1, 2, 3]], 4),
    "tetra": ([[0, 1, 2, 4], [1, 2, 4, 6]], 9),
    "pyramid": ([[0, 1, 2, 3, 6]], 8),
    "wedge": ([[0, 1, 2, 4, 5, 6]], 9),
    "hexahedron": ([list(range(8))], 12),
    "triangle6": ([[0, 1, 2, 4, 5, 6]], 3),
    "tetra10": ([[0, 1, 2, 4, 3, 3, 5, 5, 6, 7]], 6),
}


@pytest.mark.parametrize("kind", BLOCKS)
def test_cells_of_a_mesh_give_their_edges(kind):
    meshio = pytest.importorskip("meshio")
    cells, count = BLOCKS[kind]
    edges = from_mesh(meshio.Mesh(CUBE, [(kind, cells)])).edges
    assert len({*map(frozenset, edges.tolist())}) == len(edges) == count
    lengths = np.linalg.norm(CUBE[edges[:, 0]] - CUBE[edges[:, 1]], axis=1)
    assert kind not in ("quad", "hexahedron", "polygon") or (lengths == 1).all()
    assert not kind.startswith("tetra") or np.isin(edges, cells[0][:4] + cells[-1][:4]).all()
    # Programs that make meshes write their border as lines.
    border = [(kind, cells), ("line", edges[:1]), ("line3", np.zeros((0, 3), int)), ("vertex", [[0]])]
    assert len(from_mesh(meshio.Mesh(CUBE, border)).edges) == count
    bars = [(kind, cells), ("line", [[3, 7], [2, 7]])]
    assert from_mesh(meshio.Mesh(CUBE, bars)).edges.tolist() == [[3, 7], [2, 7]]


def test_a_mesh_of_polygons_has_them_as_faces(tmp_path):
    meshio = pytest.importorskip("meshio")
    whole = delaunay_network(60, seed=3)
    triangles = Delaunay(whole.positions).simplices
    meshio.Mesh(np.column_stack([whole.positions, np.zeros(60)]), [("triangle", triangles)]).write(tmp_path / "t.vtu")
    read = network_from(tmp_path / "t.vtu", pins="hull")
    by_hand = network_from(positions=whole.positions, polygons=triangles.tolist(), pins="hull")
    # Those with a side between fixed vertices are not whole.
    pinned = np.isin(triangles, [p for p in range(60) if p in set(ConvexHull(whole.positions).vertices)])
    assert read.network.faces.n_faces == by_hand.network.faces.n_faces == (pinned.sum(axis=1) < 2).sum() > 80
    # A triangle that is left out is a hole.
    inner = int(np.flatnonzero(~pinned.any(axis=1))[0])
    hollow = network_from(positions=whole.positions, polygons=np.delete(triangles, inner, axis=0), pins="hull")
    assert hollow.network.faces.n_faces == read.network.faces.n_faces - 1
    assert hollow.sides.sum(axis=1).max() == 3 and hollow.sides.shape == (len(triangles) - 1, read.network.n_edges)


STAR = [[0, 0], [4, 0], [0, 3], [1, 1.5]]


@pytest.mark.parametrize(
    ("vertices", "edges", "pins"),
    [
        ("id;x;y\nA;0;0\nB;4;0\nC;0;3\nD;1;1,5", "from;to\nA;D\nB;D\nC;D", ["A", "B", "C"]),
        ("1 0 0\n2 4 0\n3 0 3\n4 1 1.5", "1 4\n2 4\n3 4", ["1", "2", "3"]),
        ("1   0  0\n\n2   4  0\n3   0  3  # corner\n4   1  1.5", "# ends\n  1 4\n  2 4\n  3 4", ["1", "2", "3"]),
        ("0 0\n4 0\n0 3\n1 1.5", "1 4\n2 4\n3 4", [1, 2, 3]),
        ("0,0 0\n4,0 0,0\n0 3\n1,0 1,5", "1 4\n2 4\n3 4", [1, 2, 3]),
        ("0,0\t0\n4,0\t0\n0\t3\n1\t1,5", "0\t3\n1\t3\n2\t3", [0, 1, 2]),
        ("X,Y\n0,0\n4,0\n0,3\n1,1.5e0", "a,b\n0,3\n1,3\n2,3", [0, 1, 2]),
        (
            '"id","x","y","fixed"\n7,0,0,yes\n8,4,0,1\n9,0,3,true\n5,1,1.5,0',
            "edge,head,tail\n0,5,7\n1,5,8\n2,5,9",
            None,
        ),
    ],
    ids=[
        "decimal commas",
        "names in blanks",
        "aligned, comments",
        "from one",
        "commas in blanks",
        "tabs",
        "unknown header",
        "quotes",
    ],
)
def test_tables_of_every_kind(tmp_path, vertices, edges, pins):
    (tmp_path / "a_nodes.txt").write_text(vertices + "\n", encoding="utf-8-sig")
    (tmp_path / "a_edges.txt").write_text(edges + "\n")
    read = network_from(tmp_path / "a_edges.txt", pins=pins)
    np.testing.assert_array_equal(read.positions, STAR)
    assert read.network.edges.tolist() == [[0, 3], [1, 3], [2, 3]] and sorted(read.network.pins) == [0, 1, 2]
    assert ("from 1" in str(read)) == (pins == [1, 2, 3]) and "not read" not in str(read)
    # Two tables as two files, in any order where headers say which is which.
    orders = [("a_edges.txt", "a_nodes.txt"), ("a_nodes.txt", "a_edges.txt")][: 1 + ("x;" in vertices)]
    for names in orders:
        again = network_from([tmp_path / name for name in names], pins=pins)
        np.testing.assert_array_equal(again.positions, read.positions)
        np.testing.assert_array_equal(again.network.edges, read.network.edges)


@pytest.mark.parametrize("line", ["# cell 1,5 0 0 2,5", "# cell;1,5;0;0;2,5", "# cell 1.5,0,0,2.5"])
def test_cells_in_comments_with_every_kind_of_comma(tmp_path, line):
    (tmp_path / "a_vertices.csv").write_text(f"{line}\nid;x;y\n0;0;0\n1;0,5;0,5\n")
    (tmp_path / "a_edges.csv").write_text("tail;head;offset_x;offset_y;k\n0;1;0;0;1,5\n1;0;1;0;1\n1;0;0;1;1\n")
    network = network_from(tmp_path / "a.csv").network
    np.testing.assert_array_equal(network.cell, np.diag([1.5, 2.5]))
    np.testing.assert_array_equal(network.stiffness, [1.5, 1, 1])


def test_workbooks_of_two_sheets(tmp_path):
    openpyxl = pytest.importorskip("openpyxl")
    network, path = NETWORKS["voronoi"], tmp_path / "n.xlsx"
    write_network(network, path, force_densities=np.linspace(1, 2, 96) / 3)
    read = network_from(path)
    assert_same(read.network, network)
    # Workbooks keep 16 digits.
    np.testing.assert_allclose(read.positions, network.positions, rtol=5e-16)
    np.testing.assert_allclose(read.force_densities, np.linspace(1, 2, 96) / 3, rtol=5e-16)
    # As a user writes one: names, empty cells, other sheets and titles.
    book = openpyxl.Workbook()
    for title, rows in {
        "points": [["name", "x", "y", "fixed"], *(["ABCD"[n], *x, n < 3 or None] for n, x in enumerate(STAR))],
        "bonds": [["from", "to"], *([name, "D"] for name in "ABC")],
        "remarks": [["measured on Monday"]],
    }.items():
        sheet = book.create_sheet(title)
        for row in rows:
            sheet.append(row)
    book.remove(book["Sheet"])
    book.save(path)
    read = network_from(path)
    np.testing.assert_array_equal(read.positions, STAR)
    assert read.network.edges.tolist() == [[0, 3], [1, 3], [2, 3]] and sorted(read.network.pins) == [0, 1, 2]
    book.remove(book["points"])
    book.remove(book["remarks"])
    book.save(path)
    with pytest.raises(InputError, match="two tables"):
        network_from(path)


def test_commands_take_two_tables(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Path("ends.csv").write_text("from;to\nA;D\nB;D\nC;D\n")
    Path("places.csv").write_text("id;x;y\nA;0;0\nB;4;0\nC;0;3\nD;1;1\n")
    for first, second in (("ends.csv", "places.csv"), ("places.csv", "ends.csv")):
        assert main(["examine", first, second, "--pins", "A,B,C"]) == 0
        assert "4 vertices, 3 edges" in capsys.readouterr().out
        assert main(["convert", first, second, "n.json", "--pins", "A,B,C"]) == 0
        assert main(["make", first, second, "--out", "m.csv", "--pins", "A,B,C"]) == 0
        assert network_from("n.json").network.n_edges == network_from("m.csv").network.n_edges == 3
        pinned = Path(first if first == "places.csv" else second)
        given = pinned.read_text()
        pinned.write_text("id;x;y;fixed\nA;0;0;1\nB;4;0;1\nC;0;3;1\nD;1;1;0\n")
        source = File(Path(first), Path(second))
        assert source.title == f"{first} and {second}" and source.open()[1].network.n_edges == 3
        assert f"network_from({(first, second)!r})" in source.lines(source.open()[1])[0]
        pinned.write_text(given)
    for words in (["convert", "ends.csv"], ["examine", "ends.csv", "places.csv", "n.json"]):
        assert main(words) == 2


def test_values_that_are_not_read_are_named(tmp_path):
    graph = networkx.path_graph(3)
    networkx.set_node_attributes(graph, {n: (n, n**2) for n in range(3)}, "pos")
    networkx.set_edge_attributes(graph, 2.0, "weight")
    assert "not read: weight" in str(network_from(graph, pins=[0, 2]))
    (tmp_path / "a_vertices.csv").write_text("x,y\n0,0\n1,1\n2,0\n")
    (tmp_path / "a_edges.csv").write_text("tail,head,colour,k\n0,1,3,1\n1,2,4,1\n")
    assert "not read: colour" in str(network_from(tmp_path / "a.csv", pins=[0, 2]))


def with_positions(*positions):
    graph = networkx.path_graph(len(positions))
    networkx.set_node_attributes(graph, dict(enumerate(positions)), "pos")
    return graph


@pytest.mark.parametrize(
    ("graph", "given", "word"),
    [
        (with_positions("north", (1, 2)), {}, "vector"),
        (with_positions((0, 0), (1, 2, 3)), {}, "coordinates"),
        (networkx.path_graph(3), {"positions": [[0, 0]]}, "one row"),
        (networkx.path_graph(3), {}, "position"),
        (networkx.Graph(), {}, "no edges"),
    ],
)
def test_a_broken_graph_is_one_sentence(graph, given, word):
    with pytest.raises(InputError, match=word):
        network_from(graph, **given)


@pytest.mark.parametrize(
    ("vertices", "edges", "word"),
    [
        ("x,y\n", "tail,head\n0,1\n", "no rows"),
        ("", "tail,head\n0,1\n", "empty"),
        ("x,y\n0,0\n1\n", "tail,head\n0,1\n", "row 2"),
        ("x,y\n0,0\n1,2,3\n", "tail,head\n0,1\n", "t_vertices.* 2 fields in line 3"),
        ("x,y\n0,0\n1,one\n", "tail,head\n0,1\n", "row 2 .*'one'"),
        ("x,y\n0,0\n1_0,0\n", "tail,head\n0,1\n", "1_0"),
        ("x,y\n0,0\n٢,0\n", "tail,head\n0,1\n", "٢"),
        ("x,y\n0,0\n1,0\n", "tail,head\n0,1.5\n", "whole"),
        ("x,y\n0,0\n1,0\n", "tail\n0\n", "tail and head"),
        ("a,b,c,d,e\n0,0,1,2,3\n", "tail,head\n0,1\n", "no columns x"),
        ("id,x,y\nA,0,0\nA,1,0\n", "tail,head\nA,A\n", "twice"),
        ("id,x,y\nA,0,0\nB,1,0\n", "tail,head\nA,C\n", "lacks"),
        ("x,y\n0,0\n1,0\n", "tail,head\nA,C\n", "column id"),
        ("p,q\nzero,0\none,0\n", "tail,head\n0,1\n", "no number"),
        ("x,y\n0,0\n1,0\n# cell 1 2 3\n", "tail,head\n0,1\n", "cell"),
    ],
)
def test_a_broken_table_is_one_sentence(tmp_path, vertices, edges, word):
    (tmp_path / "t_vertices.csv").write_text(vertices)
    (tmp_path / "t_edges.csv").write_text(edges)
    with pytest.raises(InputError, match=word):
        network_from(tmp_path / "t.csv")


@pytest.mark.parametrize("ending", ["csv", "graphml", "gml", "json", "data", "gsd", "vtu"])
def test_a_broken_file_is_one_sentence(tmp_path, ending):
    path = tmp_path / f"broken.{ending}"
    path.with_stem("broken_vertices").write_bytes(b"\x93not a network\x00\xff")
    path.write_bytes(b"\x93not a network\x00\xff")
    with pytest.raises(InputError, match="broken"):
        network_from(path)


def test_a_case_of_a_dataset():
    network = NETWORKS["voronoi"]
    sigma = np.linspace(1, 2, 96)[None]
    x = CriticalManifold(network).configuration(sigma[0]).coordinates
    dataset = xr.Dataset(
        {
            "edges": (("seed", "edge", "end"), network.edges[None]),
            "offsets": (("seed", "edge", "axis"), network.offsets[None]),
            "cell": (("seed", "vector", "axis"), network.cell[None]),
            "coordinates": (("seed", "vertex", "axis"), x[None]),
            "sigma": (("seed", "edge"), sigma),
        },
        coords={"seed": [3]},
    )
    read = network_from(dataset.sel(seed=3))
    assert not read.repaired
    assert_same(read.network, replace(network, positions=x))
    np.testing.assert_array_equal(read.force_densities, sigma[0])
    with pytest.raises(InputError, match="choose one case"):
        network_from(dataset)
    with pytest.raises(InputError, match="lacks"):
        network_from(dataset.sel(seed=3).drop_vars("edges"))


# Drawings and solids


def test_drawings_have_the_requested_size(tmp_path):
    network = NETWORKS["voronoi"]
    write_network(network, tmp_path / "n.svg", size=50.0, width=0.4)
    root = ET.parse(tmp_path / "n.svg").getroot()
    assert float(root.get("width").removesuffix("mm")) == pytest.approx(50.8)
    total = np.linalg.norm(network.bond_vectors(network.positions), axis=1).sum() * 50 / network.cell[0, 0]
    words = root[1].get("d").replace("M", " ").replace("L", " ").split()
    ends = np.array(words, float).reshape(-1, 2, 2)
    assert np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).sum() == pytest.approx(total, rel=1e-5)
    ezdxf = pytest.importorskip("ezdxf")
    write_network(network, tmp_path / "n.dxf", size=50.0)
    lines = ezdxf.readfile(tmp_path / "n.dxf").modelspace().query("LINE")
    assert sum((line.dxf.end - line.dxf.start).magnitude for line in lines) == pytest.approx(total, rel=1e-9)


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


@pytest.mark.parametrize("copies", [0, -1, 1.5, (2, 2, 2), "2", (2, 0)])
def test_copies_are_whole_numbers_of_a_periodic_cell(tmp_path, copies):
    with pytest.raises(InputError, match="copies"):
        write_network(NETWORKS["voronoi"], tmp_path / "n.csv", copies=copies)


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


def test_tiled_drawings_are_cut_at_the_border_of_all_copies(tmp_path):
    network = NETWORKS["sheared"]
    with pytest.raises(InputError, match="copies"):
        write_network(NETWORKS["pinned"], tmp_path / "n.svg", copies=2)
    # None is cut at a border between two of them.
    write_network(network, tmp_path / "n.svg", copies=(2, 2), size=100.0)
    words = ET.parse(tmp_path / "n.svg").getroot()[1].get("d").replace("M", " ").replace("L", " ").split()
    ends = np.array(words, float).reshape(-1, 2, 2)
    L = network.bond_vectors(network.positions)
    extent = np.ptp(np.array([[0, 0], [1, 0], [0, 1], [1, 1]]) @ (2 * network.cell), axis=0).max()
    total = 4 * np.linalg.norm(L, axis=1).sum() * 100 / extent
    assert np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).sum() == pytest.approx(total, rel=1e-5)
    assert len(ends) < 4 * len(clipped_segments(data_of(network))[0])


@pytest.mark.parametrize(("ending", "extra"), [("graphml", "graphs"), ("json", "graphs"), ("3mf", "solids")])
def test_a_missing_package_is_named_with_its_install_command(tmp_path, monkeypatch, ending, extra):
    monkeypatch.setattr(packages, "import_module", lambda name: (_ for _ in ()).throw(ImportError(name)))
    with pytest.raises(EnvironmentFailure, match=rf"critflow\[{extra}\]"):
        write_network(NETWORKS["voronoi"], tmp_path / f"n.{ending}")


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
        read = network_from(folder / f"n.{ending}", nearest=True)
        np.testing.assert_array_equal(read.network.edges, network.edges)
        np.testing.assert_array_equal(read.network.offsets, network.offsets)
        np.testing.assert_array_equal(read.network.cell, network.cell)
        np.testing.assert_array_equal(read.network.stiffness, network.stiffness)
        np.testing.assert_array_equal(read.rest_lengths, rest)
        np.testing.assert_array_equal(read.force_densities, sigma)
        free = np.delete(np.arange(n), list(pins))
        np.testing.assert_array_equal(read.positions[free], x[free])
        assert {i: p.tolist() for i, p in read.network.pins.items()} == {i: p.tolist() for i, p in pins.items()}


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
    with pytest.raises(InputError, match="written"):
        write_network(3, tmp_path / "c.csv")
