"""How the boundary of a periodic network enters: L = g x + b, with b fixed by the cell images that edges join.

The paper's `BoundaryTerm`, and its affine deformation b → F b up to shears at which nearest images are wrong.
"""

from __future__ import annotations

from itertools import product

import numpy as np

from critflow import CriticalManifold, Status, voronoi_network
from critflow.workflow import Coordinate, Study, decimals, stable_rng

from ..shared.checks import voronoi_check
from ..shared.reports import PAPER
from ..shared.tables import NETWORK, networks, numbers, outcomes
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


SHEARED = ("seed", "shear")
VARIABLES = (
    *NETWORK,
    *numbers(("seed", "edge", "vertex"), "i1", incidence="signed incidence, +1 at the head"),
    *numbers(("seed", "edge"), sigma="geometric stress, sum of squares N_b"),
    *numbers(
        ("seed", "vertex", "axis"),
        positions="vertices of the tessellation",
        coordinates="vertex coordinates under that stress",
    ),
    *numbers(
        ("seed", "edge", "axis"),
        boundary_vectors="boundary term b of each edge",
        bond_vectors="bond vectors under that stress",
        collapsed_bond_vectors="bond vectors with all vertices at one point",
    ),
    *numbers((*SHEARED, "axis", "axis_"), sheared_cell="cell vectors as rows after the shear"),
    *numbers((*SHEARED, "vertex", "axis"), sheared_coordinates="coordinates after the shear"),
    *numbers(
        (*SHEARED, "edge", "axis"),
        sheared_bond_vectors="bond vectors after the shear",
        sheared_boundary_vectors="boundary term after the shear",
    ),
    *numbers(SHEARED, "i4", nearest_image_wrong="edges whose ends are nearer in another image"),
    *outcomes(("seed",), status="outcome"),
)


study = Study(
    name="boundary",
    title="The boundary term of a periodic network",
    references=PAPER,
    axes=(networks(10),),
    parameters={"n_vertices": 30, "shears": decimals("0:2:0.5")},
    coordinates=(Coordinate("shear", "shears", "simple shear of the boundary"),),
    case=case,
    check=voronoi_check(),
    variables=VARIABLES,
    verify=verify,
    figures={"boundary": boundary_figure},
    claims=claims,
    summary=summary,
)
