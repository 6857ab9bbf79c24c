"""The network: boundary vectors, copies, parts and faces, in any units."""

import numpy as np
import pytest
from problems import NETWORKS, PERIODIC, dense_incidence, face_areas, oblique, pinned_grid, random_stress
from refusals import refused
from units import same_in_units

from critflow import CriticalManifold, Network, lattice, three_bar_linkage, voronoi_network
from critflow.checks import blocks, doubtful_offsets, opened_edges
from critflow.faces import planar_faces
from critflow.points import near_images, short_cell
from critflow.result import NetworkError


@pytest.mark.parametrize("name", NETWORKS)
def test_bond_vectors_and_incidence_by_definition(name):
    network = NETWORKS[name]()
    x = np.random.default_rng(0).standard_normal((network.n_vertices, network.dimension))
    for vertex, position in network.pins.items():
        x[vertex] = position
    expected = x[network.edges[:, 1]] - x[network.edges[:, 0]]
    if network.cell is not None:
        expected = expected + network.offsets @ network.cell
    np.testing.assert_allclose(network.bond_vectors(x), expected, rtol=0, atol=1e-13)
    g = dense_incidence(network)
    np.testing.assert_array_equal(network.incidence.toarray(), g)
    np.testing.assert_array_equal(network.divergence.toarray(), g[:, network.free].T)
    np.testing.assert_array_equal(np.arange(network.n_vertices)[network.free_rows], network.free)


def test_deformation_maps_boundary_and_pins():
    F = np.array([[1.1, 0.3], [-0.2, 0.9]])
    for network in (voronoi_network(20, seed=1), pinned_grid()):
        np.testing.assert_allclose(
            network.deformed(F).boundary_vectors, network.boundary_vectors @ F.T, rtol=0, atol=1e-14
        )
    assert voronoi_network(20, seed=1).deformed(F).volume == pytest.approx(20 * np.linalg.det(F), rel=1e-14)


def test_networks_are_frozen_and_do_not_share_memory_with_their_input():
    edges = np.array([[0, 1], [1, 0], [0, 1]])
    network = Network(edges, [[0, 0], [1, 0], [0, 1]], np.eye(2))
    edges[:] = 0
    assert network.edges.tolist() == [[0, 1], [1, 0], [0, 1]]
    for array in (network.edges, network.offsets, network.cell, network.stiffness):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 2
    with pytest.raises(AttributeError):
        network.cell = np.eye(2)


def test_part_keeps_its_bond_vectors():
    network = voronoi_network(40, seed=1)
    configuration = CriticalManifold(network).configuration(random_stress(60, 1))
    edge = 7
    kept = np.ones(60, bool)
    kept[edge] = False
    part, vertices = network.part(kept)
    assert part.n_edges == 59
    np.testing.assert_allclose(
        part.bond_vectors(configuration.coordinates[vertices]), configuration.bond_vectors[kept], rtol=0, atol=1e-13
    )


MIRRORED = voronoi_network(40, seed=3)


@pytest.mark.parametrize(
    "network, sizes",
    [
        (lattice("honeycomb", 3, 4), np.full(12, 6)),
        (lattice("honeycomb", 1, 1), np.array([6])),
        (voronoi_network(100, seed=1), None),
        (oblique(voronoi_network(40, seed=2)), None),
        (MIRRORED.deformed(np.diag([-1.0, 1.0])), MIRRORED.faces.sizes),
    ],
    ids=["honeycomb", "one hexagon", "voronoi", "oblique", "mirrored"],
)
def test_faces_are_closed_left_handed_and_fill_the_cell(network, sizes):
    L, faces = network.bond_vectors(network.positions), network.faces
    # Euler on the torus: N_v − N_b + N_f = 0.
    assert faces.n_faces == network.n_edges - network.n_vertices
    assert faces.sizes.sum() == 2 * network.n_edges
    if sizes is not None:
        np.testing.assert_array_equal(faces.sizes, sizes)
    sides, areas = faces.signs[:, None] * L[faces.edges], face_areas(faces, L)
    np.testing.assert_allclose(np.add.reduceat(sides, faces.starts[:-1]), 0, atol=1e-12)
    assert (areas > 0).all() and areas.sum() == pytest.approx(network.volume, rel=1e-12)
    # Each edge is traversed once in each direction.
    for sign in (-1, 1):
        np.testing.assert_array_equal(np.sort(faces.edges[faces.signs == sign]), np.arange(network.n_edges))


CROSSING = voronoi_network(100, seed=4)


def turned(edges):
    """The offsets of CROSSING, of which those of these edges have another sign."""
    offsets = CROSSING.offsets.copy()
    offsets[edges] *= -1
    return offsets


ACROSS = np.flatnonzero(CROSSING.offsets.any(axis=1))


def test_a_graph_without_positions_and_one_long_edge_contradict_nothing():
    Network(CROSSING.edges, turned(ACROSS[::2]), CROSSING.cell)
    Network(CROSSING.edges, turned(ACROSS[:1]), CROSSING.cell, positions=CROSSING.positions)


@pytest.mark.parametrize("name", PERIODIC)
def test_positions_in_other_images_or_sheared_cells_are_accepted(name):
    network = NETWORKS[name]()
    x = CriticalManifold(network).configuration(random_stress(network.n_edges, 1)).coordinates
    for F in (np.eye(network.dimension), np.eye(network.dimension) + 3 * np.eye(network.dimension, k=1)):
        deformed = network.deformed(F)
        moved = np.random.default_rng(1).integers(-2, 3, x.shape)
        tail, head = network.edges.T
        offsets = network.offsets - moved[head] + moved[tail]
        Network(network.edges, offsets, deformed.cell, positions=x @ F.T + moved @ deformed.cell)


def patch(n_pins):
    """Seven hexagons around one, with dangling edges to pins on the outside."""
    ring = np.array([[np.cos(a), np.sin(a)] for a in np.pi / 3 * np.arange(6)])
    x = np.concatenate([ring, 2 * ring, 3 * ring[:n_pins]])
    spokes, sides = [[i, i + 6] for i in range(6)], [[6 + i, 6 + (i + 1) % 6] for i in range(6)]
    inner, outer = [[i, (i + 1) % 6] for i in range(6)], [[6 + i, 12 + i] for i in range(n_pins)]
    edges = np.array([*inner, *spokes, *sides, *outer])
    return edges, x


def test_the_outside_of_a_patch_is_no_face():
    edges, x = patch(3)
    faces = planar_faces(edges, x[edges[:, 1]] - x[edges[:, 0]], len(x))
    assert sorted(faces.sizes) == [4, 4, 4, 4, 4, 4, 6]
    # A second patch apart from the first one has an outside too.
    both = np.concatenate([edges, edges + len(x)])
    assert planar_faces(both, np.tile(x[edges[:, 1]] - x[edges[:, 0]], (2, 1)), 2 * len(x)).n_faces == 14


@pytest.mark.parametrize("depth, crosses", [(1e-3, True), (1e-8, True), (1e-14, False), (-1e-8, False)])
def test_a_spike_through_the_opposite_side_crosses_it_beyond_rounding(units, depth, crosses):
    x = units.length * np.array([[0, 0], [1, 0], [1, 1], [0.55, 1], [0.5, -depth], [0.45, 1], [0, 1]])
    edges = np.stack([np.arange(7), np.roll(np.arange(7), -1)], axis=1)
    sides = x[edges[:, 1]] - x[edges[:, 0]]
    if crosses:
        with pytest.raises(NetworkError, match="cross"):
            planar_faces(edges, sides, 7)
    else:
        assert planar_faces(edges, sides, 7).n_faces == 1


def test_a_network_without_a_cell_has_the_volume_that_is_named():
    free = HUNG
    assert not free.has_volume
    named = free.with_volume(3.0)
    assert named.has_volume and named.volume == 3.0
    assert named.with_stiffness(2.0).volume == 3.0 and named.part(np.ones(2, bool))[0].volume == 3.0
    assert named.deformed(np.diag([2.0, 0.5001])).volume == pytest.approx(3.0006)


def test_edges_are_removed_and_added():
    network = voronoi_network(n_vertices=20, seed=1).with_stiffness(np.arange(1.0, 31.0))
    (tail, head), offset = network.edges[7], network.offsets[7]
    fewer = network.without_edges([7, 20])
    np.testing.assert_array_equal(fewer.edges, np.delete(network.edges, [7, 20], axis=0))
    np.testing.assert_array_equal(fewer.stiffness, np.delete(network.stiffness, [7, 20]))
    assert fewer.faces.n_faces == network.faces.n_faces - 2
    again = network.without_edges(7).with_edge(tail, head, offset, stiffness=8.0)
    np.testing.assert_array_equal(again.bond_vectors(again.positions)[-1], network.bond_vectors(network.positions)[7])
    assert again.stiffness[-1] == 8 and again.faces is None
    linkage = three_bar_linkage().with_volume(2.0).with_edge(0, 2)
    assert linkage.volume == 2 and not linkage.offsets.any()


HUNG = Network([[0, 1], [1, 2]], pins={0: [0.0, 0.0], 2: [1.0, 0.0]}, positions=[[0, 0], [0.5, 0.2], [1, 0]])
STRIP = Network([[0, 1], [1, 0], [1, 2], [2, 1]], [[0, 0], [1, 0], [0, 0], [-1, 0]], np.eye(2))
AROUND = [[0.5, 0.1], [0.5, -0.1], [-0.5, 0.2], [-0.5, -0.2]]


def exchanged(seed):
    """The faces of a network with two vertices at each other's places."""
    network, (i, j) = voronoi_network(40, seed=seed), np.random.default_rng(seed).choice(40, 2, replace=False)
    x = network.positions.copy()
    x[[i, j]] = x[[j, i]]
    return planar_faces(network.edges, network.bond_vectors(x), 40)


def pulled_out(vertex):
    """The faces of a patch with a vertex of its inner hexagon beyond the others."""
    edges, x = patch(2)
    x[vertex] *= 2.9
    return planar_faces(edges, x[edges[:, 1]] - x[edges[:, 0]], len(x))


def with_positions(edges, offsets):
    return Network(edges, offsets, CROSSING.cell, positions=CROSSING.positions)


test_graphs_in_contradiction_are_refused = refused(
    {
        "offsets": (lambda: with_positions(CROSSING.edges, turned(ACROSS[::2])), r"contradict.*positions out"),
        "directions": (lambda: with_positions(CROSSING.edges[:, ::-1], CROSSING.offsets), "contradict"),
        # Nothing is allocated.
        "a mistyped number of vertices": (
            lambda: Network([[0, 1], [1, 2], [2, 0]], [[1, 0], [0, 1], [0, 0]], np.eye(2), n_vertices=10**15),
            "vertex 3",
        ),
        "a mistyped vertex": (
            lambda: Network([[0, 1], [1, 10**15]], pins={0: [0.0, 0.0], 10**15: [1.0, 0.0]}),
            "vertex 2",
        ),
        "a face around the cell": (lambda: planar_faces(STRIP.edges, AROUND, 3), "winds"),
        "no length": (lambda: planar_faces(STRIP.edges, np.zeros((4, 2)), 3), "direction"),
        "no volume": (lambda: HUNG.volume, "with_volume"),
        **{
            f"cell of size {size}": (
                lambda size=size: Network([[0, 1], [1, 0]], [[0, 0], [1, 0]], size * np.eye(2)),
                "finite volume",
            )
            for size in (1e-170, 1e160)
        },
        **{f"vertices exchanged {seed}": (lambda seed=seed: exchanged(seed), "cross") for seed in range(5)},
        **{f"vertex pulled out {n}": (lambda n=n: pulled_out(n), "cross") for n in range(6)},
    },
    NetworkError,
)


def shape(network, units):
    graph = network.edges, network.offsets, network.cell, network.pins, network.n_vertices
    x = np.random.default_rng(0).random((network.n_vertices, network.dimension)) * units.length
    return {
        "number": (opened_edges(*blocks(*graph)), len(network.free)),
        "length": (network.boundary_vectors, network.bond_vectors(x), network.spacing),
        "stiffness": (network.stiffness,),
    }


def periodic(network, units):
    L, (short, rows) = network.bond_vectors(network.positions), short_cell(network.cell)
    faces = planar_faces(network.edges, L, network.n_vertices)
    images = near_images(network.positions @ np.linalg.inv(network.cell), network.cell, 0.3 * units.length)
    doubtful = doubtful_offsets(network.edges, -network.offsets, network.cell, network.positions)
    copy = Network(network.edges, network.offsets, network.cell, positions=network.positions)
    return {
        "number": (faces.edges, faces.signs, faces.starts, rows, *images, *doubtful),
        "length": (short, copy.cell),
        "area": (network.volume,),
    }


test_shapes_in_other_units = same_in_units(
    {name: (shape, make) for name, make in NETWORKS.items()}
    | {
        "faces": (periodic, lambda: voronoi_network(100, seed=1)),
        "few faces": (periodic, lambda: voronoi_network(8, seed=3)),
    },
    rtol=1e-14,  # of the root of a volume
)


def test_pins_far_from_the_origin_are_refused_in_any_unit(units):
    """Their coordinates take the digits of the lengths: an onset in geographic coordinates was called floppy."""
    pins = np.array([[0.0, 0.0], [1.0, 0.5]])
    for distance, far in ((1e3, False), (1e5, True)):
        named = dict(zip((0, 2), units.length * (pins + distance), strict=True))
        if far:
            with pytest.raises(NetworkError, match="subtract their mean"):
                Network([[0, 1], [1, 2]], pins=named)
        else:
            assert Network([[0, 1], [1, 2]], pins=named).dimension == 2
