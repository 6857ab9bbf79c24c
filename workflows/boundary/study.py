"""How the boundary of a periodic network enters: L = g x + b, with b fixed by the cell images that edges join.

The paper's `BoundaryTerm`, and its affine deformation b → F b up to shears at which nearest images are wrong.
"""

from __future__ import annotations

from itertools import product

import numpy as np

from critflow import CriticalManifold, Status, voronoi_network
from critflow.generators.random_networks import check_voronoi
from critflow.workflow import Axis, Coordinate, Study, Variable, decimals, stable_rng

from ..shared.checks import check_network
from ..shared.reports import PAPER
from .report import boundary_figure, claims, summary
from .verify import verify


def nearest_images(coordinates, edges, cell):
    """The shortest vector from tail to head (N_b, 2) among all images of the head, without the offsets."""
    apart = coordinates[edges[:, 1]] - coordinates[edges[:, 0]]
    # Under shear the nearest image may lie several sheared cells away.
    reach = range(-6, 7)
    images = np.array([apart + image @ cell for image in product(reach, reach)])
    return np.take_along_axis(images, np.linalg.norm(images, axis=2).argmin(axis=0)[None, :, None], axis=0)[0]


def case(parameters, *, seed):
    """One network: boundary term, configuration at a random stress, and configurations with the boundary sheared."""
    network = voronoi_network(parameters["n_vertices"], seed)
    sigma = np.abs(stable_rng(seed, "boundary").standard_normal(network.n_edges))
    critical = CriticalManifold(network).configuration(sigma)
    sheared, cells, wrong = [], [], []
    for shear in parameters["shears"]:
        deformed = network.deformed([[1.0, shear], [0.0, 1.0]])
        solved = CriticalManifold(deformed).configuration(sigma)
        nearest = nearest_images(solved.coordinates, network.edges, deformed.cell)
        sheared.append(solved)
        cells.append(deformed.cell)
        wrong.append(np.count_nonzero(np.abs(nearest - solved.bond_vectors).max(axis=1) > 1e-9))
    return {
        "status": Status.ok,
        "edges": network.edges,
        "offsets": network.offsets,
        "cell": network.cell,
        "incidence": network.incidence.toarray().astype(int),
        "boundary_vectors": network.boundary_vectors,
        "positions": network.positions,
        "sigma": critical.sigma,
        "coordinates": critical.coordinates,
        "bond_vectors": critical.bond_vectors,
        "collapsed_bond_vectors": network.bond_vectors(np.zeros_like(critical.coordinates)),
        "sheared_cell": cells,
        "sheared_coordinates": [solved.coordinates for solved in sheared],
        "sheared_bond_vectors": [solved.bond_vectors for solved in sheared],
        "sheared_boundary_vectors": [solved.network.boundary_vectors for solved in sheared],
        "nearest_image_wrong": wrong,
    }


def check(parameters, axes):
    """Refuse settings that could only fail, before anything runs."""
    check_network(check_voronoi, parameters["n_vertices"])


def table():
    """Names, dimensions, types, units and meanings of the stored variables."""
    sheared = ("seed", "shear")
    yield Variable("edges", ("seed", "edge", "end"), "i4", long_name="vertices at tail and head of each edge")
    yield Variable(
        "offsets", ("seed", "edge", "axis"), "i2", long_name="cell image in which the head of each edge lies"
    )
    yield Variable("cell", ("seed", "axis", "axis_"), "f8", long_name="cell vectors as rows")
    yield Variable("incidence", ("seed", "edge", "vertex"), "i1", long_name="signed incidence, +1 at the head")
    yield Variable("boundary_vectors", ("seed", "edge", "axis"), "f8", long_name="boundary term b of each edge")
    yield Variable("positions", ("seed", "vertex", "axis"), "f8", long_name="vertices of the tessellation")
    yield Variable("sigma", ("seed", "edge"), "f8", long_name="geometric stress, sum of squares N_b")
    yield Variable("coordinates", ("seed", "vertex", "axis"), "f8", long_name="vertex coordinates under that stress")
    yield Variable("bond_vectors", ("seed", "edge", "axis"), "f8", long_name="bond vectors under that stress")
    yield Variable(
        "collapsed_bond_vectors",
        ("seed", "edge", "axis"),
        "f8",
        long_name="bond vectors with all vertices at one point",
    )
    yield Variable("sheared_cell", (*sheared, "axis", "axis_"), "f8", long_name="cell vectors as rows after the shear")
    yield Variable("sheared_coordinates", (*sheared, "vertex", "axis"), "f8", long_name="coordinates after the shear")
    yield Variable("sheared_bond_vectors", (*sheared, "edge", "axis"), "f8", long_name="bond vectors after the shear")
    yield Variable(
        "sheared_boundary_vectors", (*sheared, "edge", "axis"), "f8", long_name="boundary term after the shear"
    )
    yield Variable("nearest_image_wrong", sheared, "i4", long_name="edges whose ends are nearer in another image")
    yield Variable("status", ("seed",), "i1", long_name="outcome", flags=Status)


study = Study(
    name="boundary",
    title="The boundary term of a periodic network",
    references=PAPER,
    axes=(Axis("seed", range(10), "seed of the network", noun="networks"),),
    parameters={"n_vertices": 30, "shears": decimals("0:2:0.5")},
    coordinates=(Coordinate("shear", "shears", "simple shear of the boundary"),),
    case=case,
    check=check,
    variables=tuple(table()),
    verify=verify,
    figures={"boundary": boundary_figure},
    claims=claims,
    summary=summary,
)
