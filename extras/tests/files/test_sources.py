"""Files and objects that other libraries or users made."""

import json
import re
from pathlib import Path

import numpy as np
import pandas
import pytest
import xarray as xr
from scipy.spatial import ConvexHull, Delaunay

from critflow import CriticalManifold, InputError, delaunay_network, lattice, voronoi_network
from critflow.command.main import main
from critflow.result import EnvironmentFailure
from critflow_extras import network_from, write_network
from critflow_extras.files.meshes import from_mesh

networkx = pytest.importorskip("networkx")

SHEARED = voronoi_network(n_vertices=64, seed=4).deformed([[1.0, 0.3], [0.0, 1.2]])


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
    for file in tmp_path.iterdir():
        again = network_from(file, pins="hull").network
        np.testing.assert_array_equal(again.positions, read.network.positions)
        assert again.n_edges == 24


def test_json_in_node_link_form(tmp_path):
    path = tmp_path / "n.json"
    write_network(SHEARED, path)
    graph = networkx.node_link_graph(json.loads(path.read_text()), edges="edges")
    assert graph.is_multigraph() and graph.number_of_edges() == SHEARED.n_edges
    # Order and direction are those of the file, also without attributes that say so.
    nodes = [{"id": [n, 0], "pos": [n % 2, n // 2]} for n in range(4)]
    edges = [{"source": [a, 0], "target": [b, 0], "key": 0} for a, b in ((3, 2), (1, 0), (2, 1), (0, 2), (1, 3))]
    path.write_text(json.dumps({"nodes": nodes, "edges": edges}))
    read = network_from(path, pins=["(0, 0)", "(1, 0)"])
    assert read.data.edges.tolist() == [[3, 2], [2, 1], [0, 2], [1, 3]]


def test_lammps_data_of_lammpsio(tmp_path):
    lammpsio = pytest.importorskip("lammpsio")
    # Wrapped positions and atoms in another order, as a simulation leaves them.
    order = np.random.default_rng(1).permutation(64)
    q, r = np.linalg.qr(SHEARED.cell.T)
    sign = np.sign(np.diag(r))
    cell, x = (r * sign[:, None]).T, SHEARED.positions @ (q * sign)
    snapshot = lammpsio.Snapshot(64, lammpsio.Box([0, 0, -0.5], [cell[0, 0], cell[1, 1], 0.5], [cell[1, 0], 0, 0]))
    fraction = x @ np.linalg.inv(cell)
    position = np.zeros((64, 3))
    position[:, :2] = (fraction - np.floor(fraction)) @ cell
    snapshot.id, snapshot.position, snapshot.mass = order + 1, position[order], np.ones(64)
    snapshot.typeid = snapshot.molecule = np.ones(64, int)
    snapshot.bonds = lammpsio.Bonds(SHEARED.n_edges, num_types=1)
    snapshot.bonds.id = np.arange(SHEARED.n_edges) + 1
    snapshot.bonds.typeid = np.ones(SHEARED.n_edges, int)
    snapshot.bonds.members = SHEARED.edges + 1
    lammpsio.DataFile.create(str(tmp_path / "l.data"), snapshot, "molecular")
    read = network_from(tmp_path / "l.data").network
    np.testing.assert_array_equal(read.edges, SHEARED.edges)
    lengths = [np.linalg.norm(n.bond_vectors(n.positions), axis=1) for n in (read, SHEARED)]
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
    header = "a comment\n\n9 atoms\n18 bonds\n4 extra bond per atom\n0 3 xlo xhi\n0 3 ylo yhi\n-.5 .5 zlo zhi\n"
    sections = {f"Atoms {style}": atoms[::-1], "Bonds": bonds, "Bond Coeffs": ["1 0.5 1.5", "2 2 0.25  # soft"]}
    text = "".join(f"\n{title}\n\n" + "\n".join(lines) + "\n" for title, lines in sections.items())
    (tmp_path / "l.data").write_text(header + text)
    if style == "# hybrid":
        with pytest.raises(InputError, match="bond, angle, molecular, full"):
            network_from(tmp_path / "l.data")
        return
    read = network_from(tmp_path / "l.data")
    np.testing.assert_array_equal(read.network.bond_vectors(read.positions), network.bond_vectors(network.positions))
    np.testing.assert_array_equal(read.network.stiffness, [1, 4] * 9)
    np.testing.assert_array_equal(read.rest_lengths, [1.5, 0.25] * 9)
    assert read.vertex_names[0] == "7"


def test_ase_atoms_with_a_neighbour_list():
    ase = pytest.importorskip("ase")
    network = lattice("honeycomb", 4, 4)
    cell = np.zeros((3, 3))
    cell[:2, :2], cell[2, 2] = network.cell, 20
    places = np.column_stack([network.positions, np.zeros(32)])
    atoms = ase.Atoms("C32", positions=places, cell=cell, pbc=(True, True, False))
    read = network_from(atoms, cutoff=1.1)
    assert "neighbour list" in str(read) and (read.network.dimension, read.network.n_edges) == (2, 48)
    np.testing.assert_allclose(np.linalg.norm(read.network.bond_vectors(read.positions), axis=1), 1, rtol=1e-12)
    # Fixed atoms are fixed vertices; other constraints are named.
    constraints = pytest.importorskip("ase.constraints")
    atoms.set_constraint(
        [constraints.FixAtoms([0, 3]), constraints.FixAtoms([3, 5]), constraints.FixedPlane(7, [0, 0, 1])]
    )
    held = network_from(atoms, cutoff=1.1)
    assert sorted(held.network.pins) == [0, 3, 5] and "3 vertices are fixed" in str(held) and "FixedPlane" in str(held)
    # Edges are longer than a thin slab is high, in which no image is nearer.
    atoms.cell[2, 2] = 1.1
    np.testing.assert_array_equal(network_from(atoms, edges=network.edges).network.offsets, network.offsets)


def test_gsd_of_hoomd(tmp_path):
    hoomd = pytest.importorskip("gsd.hoomd")
    network = lattice("honeycomb", 6, 6)
    frame, cell = hoomd.Frame(), network.cell
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


def test_meshes_of_meshio(tmp_path, monkeypatch):
    meshio = pytest.importorskip("meshio")
    x = np.array([[0, 0, 0], [2, 0, 0], [1, 2, 0], [1, 0.7, 0.0]])
    meshio.Mesh(x, [("line", np.array([[0, 3], [1, 3], [2, 3]]))]).write(tmp_path / "star.vtk")
    read = network_from(tmp_path / "star.vtk", pins=[0, 1, 2])
    assert (read.network.dimension, read.network.n_edges) == (2, 3)
    # The border of a sheet is that in its plane.
    assert len(network_from(tmp_path / "star.vtk", pins="hull").network.pins) == 3
    # Lines of four points have their ends first.
    bent = np.array([[0, 0], [3, 0], [1, 1], [2, 1.0]])
    found = network_from(meshio.Mesh(bent, [("line4", np.array([[0, 1, 2, 3]]))]), pins=[0, 1])
    np.testing.assert_array_equal(found.network.edges, [[0, 2], [2, 3], [3, 1]])
    # Lines of an OBJ file, which meshio skips: chains, with textures, or counted from the last vertex.
    (tmp_path / "star.obj").write_text("".join(f"v {a} {b} {c}\n" for a, b, c in x) + "l 1 4/2 2 # bars\nl -2 -1\n")
    assert network_from(tmp_path / "star.obj", pins=[0, 1, 2]).data.edges.tolist() == [[0, 3], [3, 1], [2, 3]]
    # Rhino writes lines as curves, each with vertices of its own.
    ends = [(x[a], x[b]) for a, b in ((0, 3), (1, 3), (2, 3))]
    curves = ["".join(f"v {a} {b} {c}\n" for a, b, c in two) + "deg 1\ncurv 0 2 -2 \\\n-1\nend\n" for two in ends]
    (tmp_path / "rhino.obj").write_text("cstype bspline\n" + "".join(curves))
    read = network_from(tmp_path / "rhino.obj", pins="degree")
    assert read.data.edges.tolist() == [[0, 1], [2, 1], [3, 1]] and "6 vertices that coincide were joined to 4" in str(
        read
    )
    (tmp_path / "rhino.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\ndeg 3\ncurv 0 1 1 2 3\n")
    with pytest.raises(InputError, match="degree 3 are no lines"):
        network_from(tmp_path / "rhino.obj")
    # A package that meshio lacks is named.
    missing = ModuleNotFoundError("No module named 'h5py'", name="h5py")
    monkeypatch.setattr(meshio, "read", lambda path: (_ for _ in ()).throw(missing))
    (tmp_path / "m.xdmf").write_text("<Xdmf/>")
    with pytest.raises(EnvironmentFailure, match="pip install h5py"):
        network_from(tmp_path / "m.xdmf")


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
    x = delaunay_network(60, seed=3).positions
    triangles = Delaunay(x).simplices
    meshio.Mesh(np.column_stack([x, np.zeros(60)]), [("triangle", triangles)]).write(tmp_path / "t.vtu")
    read = network_from(tmp_path / "t.vtu", pins="hull")
    by_hand = network_from(positions=x, polygons=triangles.tolist(), pins="hull")
    # Those with a side between fixed vertices are not whole.
    pinned = np.isin(triangles, ConvexHull(x).vertices)
    assert read.network.faces.n_faces == by_hand.network.faces.n_faces == (pinned.sum(axis=1) < 2).sum() > 80
    # A triangle that is left out is a hole.
    inner = int(np.flatnonzero(~pinned.any(axis=1))[0])
    hollow = network_from(positions=x, polygons=np.delete(triangles, inner, axis=0), pins="hull")
    assert hollow.network.faces.n_faces == read.network.faces.n_faces - 1
    assert hollow.sides.sum(axis=1).max() == 3 and hollow.sides.shape == (len(triangles) - 1, read.network.n_edges)


GRAPH = {
    "node": {"0": {}, "1": {"x": 2.0}, "7": {"x": 1, "y": 2}, "9": {"x": 1, "y": 0.7, "pz": -1.0, "is_anchor": False}},
    "edge": {"0": {"9": {"q": 2.0, "l0": 0.0}}, "1": {"9": {}}, "7": {}, "9": {"7": {"colour": 3}}},
}
COMPAS_1 = {**GRAPH, "dna": {"x": 0.0, "y": 0.0, "z": 0.0, "is_anchor": True}, "dea": {"q": 1.0, "l0": 0.0}}
COMPAS_2 = {
    "dtype": "compas.datastructures/Graph",
    "data": {**GRAPH, "default_node_attributes": COMPAS_1["dna"], "default_edge_attributes": COMPAS_1["dea"]},
}
CELLS = {  # as COMPAS writes it; 1-2 is no edge
    "dtype": "compas.datastructures/Mesh",
    "data": {
        "default_vertex_attributes": {"is_support": False},
        "default_edge_attributes": {"q": 0.0},
        "vertex": {str(n): {"x": n % 3, "y": n // 3, "z": 0.0, "is_support": n != 1} for n in range(6)},
        "face": {"0": [0, 1, 4, 3], "1": [1, 2, 5, 4]},
        "edgedata": {"(2, 1)": {"is_edge": False}, "1-4": {"q": 3.0}},
    },
}


@pytest.mark.parametrize(("content", "edges"), [(COMPAS_1, 3), (COMPAS_2, 3), (CELLS, 2)])
def test_json_of_compas(tmp_path, content, edges):
    path = tmp_path / "net.json"
    path.write_text(json.dumps(content))
    read = network_from(path)
    assert read.network.n_edges == edges and read.rest_lengths is None and "COMPAS net.json" in str(read)
    if edges == 3:
        assert sorted(read.network.pins) == [0, 1, 2] and read.vertex_names == ("0", "1", "7", "9")
        assert read.force_densities.tolist() == [2.0, 1.0, 1.0]
        assert "loads of 1 vertex" in str(read) and "colour" in str(read)
    else:
        assert read.force_densities.tolist() == [0.0, 3.0] and read.data.sides.tolist() == [[0, -1], [0, 1]]


def outlines(size):
    """16 hexagons of three rows, each with corners of its own, (6, 2)."""
    turn = np.arange(6) * np.pi / 3
    hexagon = size * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    return [hexagon + np.array([1.5 * i, np.sqrt(3) * (j + 0.5 * (i % 2))]) for i in range(4) for j in range(4)]


def geojson(polygons):
    rings = [[*corners.tolist(), corners[0].tolist()] for corners in polygons]
    features = [{"type": "Feature", "geometry": {"type": "Polygon", "coordinates": [ring]}} for ring in rings]
    return {"type": "FeatureCollection", "features": [*features, {"type": "Feature", "geometry": None}]}


def test_polygons_with_corners_of_their_own_are_welded(tmp_path):
    whole, apart = outlines(1.0), outlines(0.97)
    read = network_from(polygons=whole, pins="hull")
    assert (read.network.n_edges, read.network.faces.n_faces) == (55, 10) and "96 corners were welded to 48" in str(
        read
    )
    numbered = network_from(positions=np.concatenate(whole), polygons=np.arange(96).reshape(16, 6), pins="hull")
    np.testing.assert_array_equal(numbered.network.edges, read.network.edges)
    # Corners that are apart are so in a sentence, whose distance joins them.
    gaps = network_from(polygons=apart, pins="hull")
    assert "16 of 16 polygons share no side" in str(gaps) and gaps.network.n_edges == 28
    weld = float(re.search(r"weld=([\d.]+)", str(gaps))[1])
    np.testing.assert_array_equal(
        network_from(polygons=apart, weld=weld, pins="hull").network.edges, read.network.edges
    )
    assert "share no side" not in str(read)
    path = tmp_path / "cells.geojson"
    path.write_text(json.dumps(geojson(apart)))
    assert main(["convert", str(path), str(tmp_path / "c.csv"), "--weld", "0.08", "--pins", "hull"]) == 0
    assert network_from(tmp_path / "c.csv").network.n_edges == 55
    assert "1 of type None" in str(network_from(path, pins="hull"))


def test_corners_on_sides_of_other_polygons_split_them():
    """A wall of 4 × 4 bricks, whose rows are shifted by half a brick."""
    at = [(2 * i + j % 2, j) for j in range(4) for i in range(4)]
    bricks = np.array(at)[:, None] + np.array([[0, 0], [2, 0], [2, 1], [0, 1]], float)
    read = network_from(polygons=bricks, pins="hull")
    assert (read.network.n_edges, read.network.faces.n_faces) == (43, 6) and "24 corners are on sides" in str(read)
    noisy = bricks + 0.01 * np.random.default_rng(1).normal(size=bricks.shape)
    assert network_from(polygons=noisy, pins="outer_face", weld=0.1).network.faces.n_faces == 4
    x, index = np.unique(bricks.reshape(-1, 2), axis=0, return_inverse=True)
    shared = {"positions": x, "polygons": index.reshape(-1, 4), "pins": "hull"}
    named = network_from(**shared)
    assert named.network.faces is None and "24 vertices lie on an edge" in str(named)
    assert network_from(**shared, weld=0.1).network.n_edges == 43


def test_polygons_of_shapely():
    shapely = pytest.importorskip("shapely")
    cells, whole = (
        [shapely.Polygon(corners) for corners in outlines(1.0)],
        network_from(polygons=outlines(1.0), pins="hull"),
    )
    for found in (network_from(polygons=cells, pins="hull"), network_from(shapely.MultiPolygon(cells), pins="hull")):
        np.testing.assert_array_equal(found.network.edges, whole.network.edges)


RING = [[0, 0], [4, 0], [4, 4], [0, 4], [0, 0]]
HOLE = [[1, 1], [2, 1], [2, 2], [1, 1]]
BAD_POLYGONS = {
    "hole": {"type": "Polygon", "coordinates": [RING, HOLE]},
    "only 1 of type Point": {"type": "Point", "coordinates": [0, 0]},
    "no polygons": {"type": "FeatureCollection", "features": []},
    "points": {"type": "Polygon", "coordinates": [[0, 1, 2]]},
    "one object": [RING],
}


@pytest.mark.parametrize("word", BAD_POLYGONS)
def test_bad_polygons_are_one_sentence(tmp_path, word):
    path = tmp_path / "bad.geojson"
    path.write_text(json.dumps(BAD_POLYGONS[word]))
    with pytest.raises(InputError, match=word) as raised:
        network_from(path, pins="hull")
    assert "\n" not in str(raised.value)


STAR = [[0, 0], [4, 0], [0, 3], [1, 1.5]]
QUOTED = '"id","x","y","fixed"\n7,0,0,yes\n8,4,0,1\n9,0,3,true\n5,1,1.5,0'
TABLES = {  # vertices, edges, fixed vertices
    "decimal commas": ("id;x;y\nA;0;0\nB;4;0\nC;0;3\nD;1;1,5", "from;to\nA;D\nB;D\nC;D", ["A", "B", "C"]),
    "names in blanks": ("id x y\n1 0 0\n2 4 0\n3 0 3\n4 1 1.5", "i j\n1 4\n2 4\n3 4", ["1", "2", "3"]),
    "aligned, comments": (
        *("id  x  y\n1   0  0\n\n2   4  0\n3   0  3  # corner\n4   1  1.5", "# ends\n  u v\n  1 4\n  2 4\n  3 4"),
        ["1", "2", "3"],
    ),
    "from one": ("x y\n0 0\n4 0\n0 3\n1 1.5", "i j\n1 4\n2 4\n3 4", [1, 2, 3]),
    "commas in blanks": ("x y\n0,0 0\n4,0 0,0\n0 3\n1,0 1,5", "i j\n1 4\n2 4\n3 4", [1, 2, 3]),
    "tabs": ("x\ty\n0,0\t0\n4,0\t0\n0\t3\n1\t1,5", "i\tj\n0\t3\n1\t3\n2\t3", [0, 1, 2]),
    "capitals": ("X,Y\n0,0\n4,0\n0,3\n1,1.5e0", "From,To\n0,3\n1,3\n2,3", [0, 1, 2]),
    "quotes": (QUOTED, "edge,head,tail\n0,5,7\n1,5,8\n2,5,9", None),
}


@pytest.mark.parametrize("kind", TABLES)
def test_tables_of_every_kind(tmp_path, kind):
    vertices, edges, pins = TABLES[kind]
    (tmp_path / "a_nodes.txt").write_text(vertices + "\n", encoding="utf-8-sig")
    (tmp_path / "a_edges.txt").write_text(edges + "\n")
    read = network_from(tmp_path / "a_edges.txt", pins=pins)
    np.testing.assert_array_equal(read.positions, STAR)
    assert read.network.edges.tolist() == [[0, 3], [1, 3], [2, 3]] and sorted(read.network.pins) == [0, 1, 2]
    assert ("from 1" in str(read)) == (pins == [1, 2, 3]) and "not read" not in str(read)
    # Two tables as two files, in any order where headers say which is which.
    for names in [("a_edges.txt", "a_nodes.txt"), ("a_nodes.txt", "a_edges.txt")][: 1 + ("x;" in vertices)]:
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


@pytest.mark.parametrize("names", [["A", "B", "C", "D"], [7, 8, 9, 10], [7.0, 8.0, 9.0, 10.0], None])
def test_data_frames_of_pandas(names):
    ends = np.array(names or range(4))
    vertices = {"X": [0, 4.0, 0, 1], "y": [0, 0, 3, 1 / 3], "fixed": [1, True, 1.0, None]}
    vertices = pandas.DataFrame(vertices if names is None else {"id": names, **vertices})
    edges = pandas.DataFrame({"tail": ends[:3], "head": ends[3], "k": [1.0, 2.0, 0.1], "colour": "red"})
    for pair in ([edges, vertices], (vertices, edges)):
        read = network_from(pair)
        assert read.positions.tolist() == [[0, 0], [4, 0], [0, 3], [1, 1 / 3]] and list(read.network.pins) == [0, 1, 2]
        assert read.network.edges.tolist() == [[0, 3], [1, 3], [2, 3]] and "not read: colour" in str(read)
        assert read.network.stiffness.tolist() == [1, 2, 0.1]
        assert read.vertex_names[2] == {"A": "C", 7: "9"}.get(None if names is None else names[0], "2")
    arrays = (
        network_from(edges=edges[["tail", "head"]], positions=vertices[["X", "y"]], pins=[0, 1]) if not names else read
    )
    assert arrays.network.n_edges == (3 if names else 2)


def test_broken_data_frames_are_one_sentence():
    vertices = pandas.DataFrame({"x": [0, 1.0, None], "y": [0, 0, 1]})
    edges = pandas.DataFrame({"tail": [0], "head": [1]})
    for source, word in (
        (edges, "two tables"),
        ([edges, vertices], "row 3 of the second table has '', which is no number"),
        ([edges, vertices[:0]], "no rows"),
        ([edges.rename(columns={"head": "nach"}), vertices[:2]], "the first table has no columns for tail and head"),
    ):
        with pytest.raises(InputError, match=word):
            network_from(source)


@pytest.mark.parametrize(
    ("file", "word"),
    [
        ("fibres.png", "fibres.png is read by scikit-image and skan, as extras/docs/recipes/pictures.md .*labels="),
        ("fibres.npy", "recipes/pictures.md"),
        ("network.xlsx", "network.xlsx is read by pandas, as extras/docs/recipes/workbooks.md shows"),
        ("network.DXF", "network.DXF is read by ezdxf, as extras/docs/recipes/drawings.md shows"),
    ],
)
def test_what_other_libraries_read_has_a_recipe(tmp_path, file, word):
    (tmp_path / file).write_bytes(b"")
    with pytest.raises(InputError, match=word) as refusal:
        network_from(tmp_path / file)
    (page,) = re.findall(r"extras/docs/recipes/\w+\.md", str(refusal.value))
    assert (Path(__file__).parents[3] / page).exists()


def test_a_picture_is_no_keyword():
    with pytest.raises(InputError, match=r"recipes/pictures\.md"):
        network_from(picture=np.eye(9))


def test_edges_that_cross_are_reported():
    x = [[0.0, 0.0], [2, 2], [0, 2], [2, 0], [1, 0.3], [1, 2]]
    read = network_from(edges=[[0, 4], [1, 4], [2, 4], [3, 5], [5, 0], [5, 4]], positions=x, pins=[0, 1, 2, 3])
    assert read.network.faces is None and "the network has no faces" in str(read) and "some of them cross" in str(read)
    assert not read.repaired


def test_values_that_are_not_read_are_named(tmp_path):
    graph = networkx.path_graph(3)
    networkx.set_node_attributes(graph, {n: (n, n**2) for n in range(3)}, "pos")
    networkx.set_edge_attributes(graph, 2.0, "weight")
    assert "not read: weight" in str(network_from(graph, pins=[0, 2]))
    (tmp_path / "a_vertices.csv").write_text("x,y\n0,0\n1,1\n2,0\n")
    (tmp_path / "a_edges.csv").write_text("tail,head,colour,k\n0,1,3,1\n1,2,4,1\n")
    assert "not read: colour" in str(network_from(tmp_path / "a.csv", pins=[0, 2]))


def test_a_case_of_a_dataset(tmp_path):
    network, sigma = SHEARED, np.linspace(1, 2, 96)
    x = CriticalManifold(network).configuration(sigma).coordinates
    arrays = {
        "edges": network.edges,
        "offsets": network.offsets,
        "cell": network.cell,
        "position": x,
        "sigma": sigma,
    }
    dims = {
        "edges": ("edge", "end"),
        "offsets": ("edge", "axis"),
        "cell": ("cell_vector", "axis"),
        "position": ("vertex", "axis"),
        "sigma": ("edge",),
    }
    variables = {name: (("seed", *dims[name]), array[None]) for name, array in arrays.items()}
    xr.Dataset(variables, coords={"seed": [3]}).to_netcdf(tmp_path / "cases.nc")
    dataset = xr.load_dataset(tmp_path / "cases.nc")
    read = network_from(dataset.sel(seed=3))
    assert not read.repaired
    for name in ("edges", "offsets", "cell"):
        np.testing.assert_array_equal(getattr(read.network, name), arrays[name])
    np.testing.assert_array_equal(read.positions, x)
    np.testing.assert_array_equal(read.force_densities, sigma)
    critical = read.configuration
    np.testing.assert_array_equal(critical.sigma, sigma)
    assert critical.network is read.network and critical.residual < 1e-12
    with pytest.raises(InputError, match="one seed"):
        network_from(dataset)
    with pytest.raises(InputError, match="force densities"):
        _ = network_from(dataset.sel(seed=3).drop_vars("sigma")).configuration
    with pytest.raises(InputError, match="lacks"):
        network_from(dataset.sel(seed=3).drop_vars("edges"))


# Broken sources


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
        ("0,0\n1,0\n", "tail,head\n0,1\n", "t_vertices.csv has no header"),
        ("x,y\n0,0\n1,0\n", "0,1\n1,0\n", "t_edges.csv has no header: name the columns tail and head"),
        ("id,x,y\nA,0,0\nA,1,0\n", "tail,head\nA,A\n", "twice"),
        ("id,x,y\nA,0,0\nB,1,0\n", "von,nach\nA,B\n", "no columns for tail and head"),
        ("id,x,y\nA,0,0\nB,1,0\n", "from,to\nA,C\n", "'C', which the vertex table lacks"),
        ("x,y\n0,0\n1,0\n", "tail,head\nA,C\n", "column id"),
        ("x,y\nzero,0\none,0\n", "tail,head\n0,1\n", "no number"),
        ("x,y\n0,0\n1,0\n# cell 1 2 3\n", "tail,head\n0,1\n", "cell"),
    ],
)
def test_a_broken_table_is_one_sentence(tmp_path, vertices, edges, word):
    (tmp_path / "t_vertices.csv").write_text(vertices)
    (tmp_path / "t_edges.csv").write_text(edges)
    with pytest.raises(InputError, match=word):
        network_from(tmp_path / "t.csv")


def graph_text(nodes, edges, **more):
    return json.dumps({"nodes": nodes, "edges": edges, **more})


def offset(value):
    """A graph of one vertex whose edge has an offset."""
    edges = [{"source": 0, "target": 0, "offset": o, "key": key} for key, o in enumerate([[value, 0], [0, 1]])]
    cell = {"graph": {"cell": [[1, 0], [0, 1]]}}
    return graph_text([{"id": 0, "pos": [0.5, 0.5]}], edges, directed=False, multigraph=True, **cell)


LAMMPS = "\n0 8 xlo xhi\n0 9 ylo yhi\n-1 1 zlo zhi\n\nAtoms # bond\n\n1 1 1 1 1 0\n\nBonds\n\n1 1 1 1\n"
NONSENSE = b"\x93not a network\x00\xff"
DAMAGED = {
    **{f"broken.{ending}": (NONSENSE, "broken") for ending in ("graphml", "gml", "json", "data", "gsd", "vtu")},
    "broken_vertices.csv": (NONSENSE, "broken"),
    "digits.data": (
        "\n0 1_0 xlo xhi\n0 9 ylo yhi\n-1 1 zlo zhi\n\nAtoms # bond\n\n1 1 1 0 0 0\n\nBonds\n\n1 1 1 1\n",
        "1_0",
    ),
    "script.data": (
        "\n0 9 xlo xhi\n0 9 ylo yhi\n-1 1 zlo zhi\n\nAtoms # bond\n\n1 1 1 ٢ 0 0\n\nBonds\n\n1 1 1 1\n",
        "٢",
    ),
    "empty.data": ("", "no Bonds section"),
    "stiffness.json": (
        graph_text([{"id": n, "pos": [n, 0]} for n in (0, 1)], [{"source": 0, "target": 1, "stiffness": "1_0"}]),
        "neither a number",
    ),
    "one_edges.csv": ("tail,head\n0,1\n", "is one of two tables: give the other one after it"),
    "centres.csv": ("x,y\n0,1\n2,3\n", "the cell, if its rows are centres of cells"),
    "deep.json": ("[" * 100_000 + "]" * 100_000, "cannot be read as graph: maximum recursion"),
    "deep.gml": ("graph [ " * 3000 + "]" * 3000, "cannot be read as graph: maximum recursion"),
    "deep.graphml": ("<graphml>" * 20_000 + "</graphml>" * 20_000, "graphml"),
    "entity.xdmf": ('<!DOCTYPE x [<!ENTITY a "b">]><Xdmf>&c;</Xdmf>', "entity"),
    "nan.json": (offset(float("nan")), "whole"),
    "large.json": (offset(1e19), "whole"),
    "own.json": ("[1, 2]", "needs nodes"),
    "without_an_end.json": (graph_text([{"id": 1}], [{"source": 1, "target": 2}]), "ids"),
    "twice.json": (graph_text([{"id": 1}, {"id": 1}], []), "ids"),
    "open.json": (graph_text([{"id": 1}], [{"source": 1}]), "target"),
    "numbers.json": (graph_text([1, 2], []), "needs nodes"),
}


@pytest.mark.parametrize("name", DAMAGED)
def test_a_damaged_file_is_one_sentence(tmp_path, capsys, name):
    content, word = DAMAGED[name]
    (tmp_path / name).write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(InputError, match=word):
        network_from(tmp_path / name)
    assert main(["convert", str(tmp_path / name), str(tmp_path / "out.json")]) == 2
    error = capsys.readouterr().err
    assert word in error and error.count("\n") == 1


CENTRES = np.random.default_rng(3).random((20, 2))
OBLIQUE = np.array([[5.0, 0.0], [1.0, 4.0]])


@pytest.mark.parametrize("cell", [5.0, (5.0, 4.0), OBLIQUE], ids=["a side", "sides", "vectors"])
def test_centres_of_cells_are_read_as_their_voronoi_network(tmp_path, cell):
    vectors = cell if np.ndim(cell) == 2 else np.diag(np.broadcast_to(cell, 2))
    x = (CENTRES - 0.3) @ vectors
    path = tmp_path / "centres.csv"
    path.write_text("x,y,area\n" + "".join(f"{a!r},{b!r},1\n" for a, b in x.tolist()))
    expected = voronoi_network(points=CENTRES, cell=vectors)
    lengths = np.sort(np.linalg.norm(expected.bond_vectors(expected.positions), axis=1))
    for source in (path, pandas.read_csv(path), x):
        read = network_from(source, voronoi=True, cell=cell)
        assert (read.network.n_vertices, read.network.n_edges) == (40, 60) and "20 centres" in str(read)
        found = np.linalg.norm(read.network.bond_vectors(read.positions), axis=1)
        np.testing.assert_allclose(np.sort(found), lengths, rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    ("source", "options", "word"),
    [
        (CENTRES, {}, "need the periodic cell"),
        (CENTRES[:, 0], {"cell": 1.0}, "two or three columns"),
        (CENTRES, {"cell": np.ones((3, 2))}, "side lengths or as many vectors"),
        (12 * CENTRES, {"cell": 1.0}, "span 10.7 cells: give the cell that they lie in"),
        ("nowhere.csv", {"cell": 1.0}, "there is no file nowhere.csv"),
        (CENTRES, {"cell": 1.0, "weld": 0.1}, "weld= belongs to polygons"),
    ],
)
def test_centres_that_make_no_network_are_one_sentence(source, options, word):
    with pytest.raises(InputError, match=word):
        network_from(source, voronoi=True, **options)
