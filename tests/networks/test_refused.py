"""Values that make no network: one sentence names the fault and the next step."""

import numpy as np
from problems import square_octagon, triangular_lattice
from refusals import refused

from critflow import (
    CriticalManifold,
    Deformation,
    Network,
    delaunay_network,
    lattice,
    three_bar_linkage,
    voronoi_network,
)
from critflow.deformation import deformation_of
from critflow.points import random_sequential_addition

NETWORK = square_octagon()
EDGES, OFFSETS, CELL = NETWORK.edges.copy(), NETWORK.offsets.copy(), NETWORK.cell.copy()


def values(edge, value, n_edges=6):
    array = np.ones(n_edges)
    array[edge] = value
    return array


def extended(edges, offsets=None):
    """The manifold of the square-octagon with more edges."""
    edges = np.asarray(edges)
    offsets = np.zeros_like(edges) if offsets is None else np.asarray(offsets)
    return CriticalManifold(Network(np.concatenate([EDGES, edges]), np.concatenate([OFFSETS, offsets]), CELL))


def soft_beyond_zero(strain):
    return "soft" if strain else np.eye(2)


CASES = {
    # Stiffness and lengths
    "stiffness negative": (lambda: NETWORK.with_stiffness(values(3, -1)), r"stiffness\[3\]"),
    "stiffness zero": (lambda: NETWORK.with_stiffness(0), r"stiffness\[0\]"),
    "stiffness NaN": (lambda: NETWORK.with_stiffness(values(3, np.nan)), r"stiffness\[3\]"),
    "stiffness too short": (lambda: NETWORK.with_stiffness(np.ones(4)), "edge"),
    # Graphs
    "no edges": (lambda: Network(np.zeros((0, 2), int), cell=CELL), "tail"),
    "edges of three": (lambda: Network([[0, 1, 2]], cell=CELL), "tail"),
    "edges not whole": (lambda: Network([[0, 0.5]], cell=CELL), "whole"),
    "missing vertex": (lambda: Network(EDGES, OFFSETS, CELL, n_vertices=3), "edge 2"),
    "negative vertex": (lambda: Network([[0, 1], [1, -1]], cell=CELL), "edge 1"),
    "self-loop": (lambda: extended([[2, 2]]), "edge 6"),
    "two parts": (
        lambda: Network(np.concatenate([EDGES, EDGES + 4]), np.concatenate([OFFSETS, OFFSETS]), CELL),
        "parts",
    ),
    "vertex without edges": (lambda: Network(EDGES, OFFSETS, CELL, n_vertices=5), "vertex 4"),
    "hanging edge": (lambda: extended([[0, 4]]), "vertex 4"),
    "part on a bridge": (lambda: extended([[0, 4], [4, 5], [5, 6], [6, 4]]), "edge 6.*vertex"),
    "nothing wraps around": (lambda: CriticalManifold(Network([[0, 1], [1, 2], [2, 0]], cell=CELL)), "wraps"),
    "one vertex only": (lambda: CriticalManifold(triangular_lattice(1, 1)[0]), "vert"),
    "all vertices pinned": (
        lambda: CriticalManifold(Network([[0, 1]], pins={0: [0.0, 0.0], 1: [1.0, 0.0]})),
        "pin|vert",
    ),
    # Boundary
    "offsets without a cell": (lambda: Network([[0, 1]], [[1, 0]], pins={0: [0, 0], 1: [1, 1]}), "cell"),
    "offsets wrongly sized": (lambda: Network(EDGES, OFFSETS[:3], CELL), "edge"),
    "offsets not whole": (lambda: Network(EDGES, OFFSETS + 0.5, CELL), "whole"),
    "flat cell": (lambda: Network(EDGES, OFFSETS, [[1, 0], [2, 0]]), "volume"),
    "cell NaN": (lambda: Network(EDGES, OFFSETS, [[1, 0], [0, np.nan]]), "finite"),
    "cell not square": (lambda: Network(EDGES, OFFSETS, [[1, 0, 0], [0, 1, 0]]), "square|dimension"),
    "cell one number": (lambda: Network(EDGES, OFFSETS, 3.0), "square|dimension"),
    "pins as a list": (lambda: Network([[0, 1], [1, 2]], pins=[0, 2]), "mapping"),
    "pins as a mask": (lambda: Network([[0, 1], [1, 2]], pins=np.array([True, False, True])), "mapping"),
    "pin named": (lambda: Network([[0, 1], [1, 2]], pins={"a": [0, 0], 2: [1, 0]}), "pin 'a'"),
    "pin between vertices": (lambda: Network([[0, 1], [1, 2]], pins={0.5: [0, 0], 2: [1, 0]}), "pin 0.5"),
    "pin at a word": (lambda: Network([[0, 1], [1, 2]], pins={0: "here", 2: [1, 0]}), "pin 0"),
    "edges ragged": (lambda: Network([[0, 1], [1]], cell=CELL), "edges.*length"),
    "edges huge": (lambda: Network(np.array([[0, 2**63]], np.uint64), cell=CELL), "whole"),
    "offsets ragged": (lambda: Network([[0, 1], [0, 1]], [[0, 1], [1]], CELL), "offsets.*length"),
    "cell ragged": (lambda: Network(EDGES, OFFSETS, [[1, 0], [1]]), "cell.*length"),
    "cell complex": (lambda: Network(EDGES, OFFSETS, np.array([[1, 0], [0, 1j]])), "cell.*real"),
    "stiffness a word": (lambda: Network(EDGES, OFFSETS, CELL, "soft"), "stiffness.*numbers"),
    "stiffness ragged": (lambda: NETWORK.with_stiffness([[1], [1, 2]]), "stiffness.*numbers"),
    "vertices negative": (lambda: Network(EDGES, OFFSETS, CELL, n_vertices=-5), "n_vertices.*-5"),
    "vertices not whole": (lambda: Network(EDGES, OFFSETS, CELL, n_vertices=4.5), "n_vertices.*4.5"),
    "vertices a word": (lambda: Network(EDGES, OFFSETS, CELL, n_vertices="4"), "n_vertices"),
    "positions NaN": (lambda: Network(EDGES, OFFSETS, CELL, positions=np.full((4, 2), np.nan)), r"positions\[0\]"),
    "positions ragged": (lambda: Network(EDGES, OFFSETS, CELL, positions=[[0, 1], [1]]), "positions.*length"),
    "deformation a word": (lambda: NETWORK.deformed("shear"), "deformation.*numbers"),
    "pin no vertex": (lambda: Network([[0, 1], [1, 2]], pins={0: [0, 0], 7: [1, 0]}), "pin 7"),
    "pin before the first": (lambda: Network([[0, 1], [1, 2]], pins={0: [0, 0], -1: [1, 0]}), "pin -1.*from 0 to 2"),
    "pin NaN": (lambda: Network([[0, 1], [1, 2]], pins={0: [0, 0], 2: [np.nan, 0]}), "pin 2"),
    "pins of two dimensions": (lambda: Network([[0, 1], [1, 2]], pins={0: [0, 0], 2: [1, 0, 0]}), "dimension"),
    "positions wrongly sized": (lambda: Network(EDGES, OFFSETS, CELL, positions=np.ones((3, 2))), "positions"),
    "flat deformation": (lambda: NETWORK.deformed([[1, 0], [1, 0]]), "invertible"),
    "deformation NaN": (lambda: NETWORK.deformed([[1, 0], [0, np.nan]]), "invertible"),
    # Copies
    "no such edge": (lambda: NETWORK.without_edges(30), "no edge 30"),
    "edge before the first": (lambda: NETWORK.without_edges([0, -1]), "no edge -1"),
    "half an edge": (lambda: NETWORK.without_edges(0.5), "whole"),
    "edge to no vertex": (lambda: NETWORK.with_edge(0, 20), "no vertex 20"),
    "edge with a short offset": (lambda: NETWORK.with_edge(0, 1, [1]), "2 whole numbers"),
    "edge with half an offset": (lambda: NETWORK.with_edge(0, 1, [0.5, 0]), "whole"),
    "edge to itself": (lambda: NETWORK.with_edge(3, 3), "itself"),
    "edge of two stiffnesses": (lambda: NETWORK.with_edge(0, 1, stiffness=[1, 2]), "stiffness must be a number"),
    "edge from a list": (lambda: NETWORK.with_edge([0], 1), "tail must be a whole number"),
    "volume of a cell": (lambda: NETWORK.with_volume(1.0), "cell"),
    **{
        f"volume {v}": (lambda v=v: three_bar_linkage().with_volume(v), "volume")
        for v in (0, -1.0, np.inf, "much", [1, 2])
    },
    # Deformations
    "deformation of another dimension": (lambda: deformation_of(np.eye(2), 3), "dimensions"),
    "deformation no square": (lambda: deformation_of(np.ones((2, 3)), 2), "square"),
    "strain NaN in a matrix": (lambda: deformation_of([[0, np.nan], [0, 0]], 2), "finite"),
    "deformation none": (lambda: deformation_of(None, 2), "array"),
    "rate of another deformation": (
        lambda: Deformation.path(lambda g: (1 + g) * np.eye(2), 2, lambda g: 2 * np.eye(2)),
        "rate given",
    ),
    "second rate alone": (lambda: Deformation.path(lambda g: np.eye(2), 2, None, lambda g: np.eye(2)), "give rate"),
    "deformation that begins elsewhere": (lambda: deformation_of(lambda g: 2 * np.eye(2), 2), "begin"),
    **{
        f"{path} of {d} dimensions": (lambda path=path, d=d: getattr(Deformation, path)(d), "dimension")
        for path in ("dilation", "simple_shear", "pure_shear", "uniaxial")
        for d in (0, "x", 2.5)
    },
    "path of no dimension": (lambda: Deformation.path(lambda g: np.eye(2), "x"), "dimension"),
    "path that is no function": (lambda: Deformation.path(3, 2), "gradient must be"),
    "path of words": (lambda: Deformation.path(lambda g: "soft", 2), "numbers"),
    "path with a rate of words": (lambda: Deformation.path(lambda g: np.eye(2), 2, lambda g: "soft"), "rate.*numbers"),
    "path with a large rate": (lambda: Deformation.path(lambda g: np.eye(2), 2, lambda g: np.eye(3)), "rate given"),
    "path that ends in words": (lambda: deformation_of(soft_beyond_zero, 2).gradient(0.1), "numbers"),
    "strain of words": (lambda: Deformation.dilation(2).rate("soft"), "strain must be a number"),
    "shear out of the plane": (lambda: Deformation.simple_shear(2, "xz"), "axis"),
    "shear on a line": (lambda: Deformation.simple_shear(1), "two dimensions"),
    "shear along one axis": (lambda: Deformation.pure_shear(2, "xx"), "plane"),
    "free component unknown": (lambda: Deformation.uniaxial(2).freeing("z"), "component"),
    "negative volume": (lambda: Deformation.dilation(2).gradient(-1.5), "strain"),
    "flattened": (lambda: Deformation.uniaxial(2).gradient(-1.0), "flattens"),
    "sheared to nothing": (lambda: Deformation.pure_shear(2).gradient(-1.0), "strain"),
    # Generation
    **{
        f"sizes beyond any memory, {n}": (make, "at most 20,000,000")
        for n, make in enumerate(
            (
                lambda: voronoi_network(10**9),
                lambda: lattice("honeycomb", 10**5, 10**5),
                lambda: random_sequential_addition(10**9, 1e-5, np.random.default_rng(0)),
            )
        )
    },
    **{
        f"lattice of size {n!r}": (lambda n=n: lattice("cubic", n, 3, 3), "whole numbers")
        for n in (0, 1.5, True, "4", np.nan)
    },
    "lattice of few sizes": (lambda: lattice("kagome", 3), "directions"),
    "lattice of one vertex": (lambda: lattice("square", 1, 1), "single"),
    "no such lattice": (lambda: lattice("squares", 3, 3), "honeycomb, square"),
    "one point": (lambda: voronoi_network(points=[[0.1, 0.2]]), "lattice"),
    "points of a lattice": (lambda: voronoi_network(points=np.argwhere(np.ones((4, 4))) / 4 + 0.1), "lattice"),
    "points in other units": (lambda: voronoi_network(points=20 * np.random.default_rng(1).random((30, 2))), "divide"),
    "hard core too large": (lambda: voronoi_network(40, hard_core=1.2), "hard core"),
    "no hard core": (lambda: voronoi_network(40, hard_core=-1), "positive"),
    "no points": (lambda: random_sequential_addition(0, 0.1, np.random.default_rng(1)), "points"),
    "points none": (lambda: voronoi_network(points=np.zeros((0, 2))), "shape"),
    "delaunay of few": (lambda: delaunay_network(3), "at least"),
    "cell of a network flat": (lambda: voronoi_network(100, cell=[[1, 2], [2, 4]]), "volume"),
    "cell of a network no matrix": (lambda: delaunay_network(100, cell=2.0), "matrix"),
    "cell of a network thin": (lambda: delaunay_network(100, cell=[[1e4, 0], [0, 1]]), "thin"),
    "cell of points thin": (
        lambda: delaunay_network(points=np.random.default_rng(0).random((9, 2)), cell=[[1e6, 0], [0, 1]]),
        "few",
    ),
    "points and their number": (lambda: voronoi_network(40, points=np.ones((9, 2))), "follows"),
}

test_values_that_make_no_network_are_refused = refused(CASES)
