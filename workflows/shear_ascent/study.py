"""Maximising the shear modulus without any constraint on the signs of the stress (`ShearModulusSteepestDescent`).

From σ = 1 every network climbs towards the closed-form bound.  Edges along the shear grow to the size of the box,
others come under compression, and the prestress matrix becomes indefinite.
"""

from __future__ import annotations

import numpy as np

from critflow import CriticalManifold, StudyError, voronoi_network
from critflow.critical.quantity import pure_shear
from critflow.generators.random_networks import check_voronoi
from critflow.quantities.largest_modulus import largest_modulus, least_compressed_length
from critflow.result import Status
from critflow.workflow import Axis, Coordinate, Study, Variable

from ..shared.ascent import MEASURES, ascend, check_ascent
from ..shared.checks import check_network
from ..shared.reports import PAPER
from .report import animation, ascent_figure, claims, summary
from .verify import verify

# Every step at first, then about eight a factor of ten.
STEPS = tuple(int(step) for step in np.unique(np.round(np.concatenate([[0, 1], 10 ** np.arange(0.3, 3.71, 0.1)]))))


def case(parameters, *, seed):
    """One ascent: measures and configurations at the recorded steps, and the bound with its closed form."""
    network = voronoi_network(parameters["n_vertices"], seed, parameters["hard_core"])
    manifold = CriticalManifold(network)
    steps = parameters["steps"]
    ascent = ascend(manifold, parameters["method"], steps, (0.9,))
    found = ascent.solution
    shared = {"edges": network.edges, "offsets": network.offsets, "cell": network.cell, "status": found.status}
    exact = largest_modulus(manifold, pure_shear(2))
    # Coordinates whose bond vectors are those of the record, to single precision, which is enough to draw.
    stored = len(ascent.sigmas)
    sigma = np.full((len(steps), network.n_edges), np.nan)
    sigma[:stored] = ascent.sigmas
    coordinates = np.full((len(steps), *network.positions.shape), np.nan)
    coordinates[:stored] = [network.all_coordinates(manifold.balance(s).coordinates) for s in ascent.sigmas]
    return {
        **shared,
        **dict(zip(MEASURES, ascent.recorded, strict=True)),
        "sigma": sigma,
        "coordinates": coordinates,
        "bound": ascent.bound,
        "last_step": found.stats.steps,
        "shear_modulus_end": found.objective,
        "closed_form": exact.objective,
        "closed_form_gap": exact.gap,
        "least_compressed_length": least_compressed_length(manifold, pure_shear(2)),
        "crossings": len(found.crossings),
        "negative_pivots": found.negative_pivots,
        "nearest_singular": found.nearest_singular,
        "residual": found.value.residual,
    }


def check(parameters, axes):
    """Refuse settings that could only fail, before anything runs."""
    check_ascent(parameters)
    if list(parameters["steps"]) != sorted(set(parameters["steps"])) or parameters["steps"][0] < 0:
        raise StudyError("steps must be increasing whole numbers from 0 on, such as 0,1,10,100")
    check_network(check_voronoi, parameters["n_vertices"], parameters["hard_core"])


def table():
    """Names, dimensions, types and meanings of the stored variables."""
    network, recorded = ("seed",), ("seed", "step")
    yield Variable("edges", (*network, "edge", "end"), "i4", long_name="vertices at tail and head of each edge")
    yield Variable("offsets", (*network, "edge", "axis"), "i2", long_name="cell image in which each head lies")
    yield Variable("cell", (*network, "axis", "axis_"), "f8", long_name="cell vectors as rows")
    yield Variable("shear_modulus", recorded, "f8", long_name="shear modulus at the transition, in units of k")
    yield Variable("longest_edge", recorded, "f8", long_name="length of the longest edge over the side of the box")
    yield Variable("least_tension", recorded, "f8", long_name="least tension over the largest magnitude of a tension")
    yield Variable("compressed_edges", recorded, "f8", long_name="number of edges under compression")
    yield Variable("compressed_length", recorded, "f8", long_name="total length of the edges under compression")
    yield Variable("sigma", (*recorded, "edge"), "f4", long_name="geometric stress, sum of squares N_b")
    yield Variable("coordinates", (*recorded, "vertex", "axis"), "f4", long_name="vertex coordinates")
    yield Variable("bound", network, "f8", long_name="largest shear modulus of any stress, in closed form")
    yield Variable("last_step", network, "i4", long_name="step that ended the ascent", fill=-1)
    yield Variable("shear_modulus_end", network, "f8", long_name="shear modulus there, or its limit, in units of k")
    yield Variable("closed_form", network, "f8", long_name="shear modulus of the closed form's configuration")
    yield Variable("closed_form_gap", network, "f8", long_name="relative distance of that modulus from the bound")
    yield Variable(
        "least_compressed_length", network, "f8", long_name="least compressed length of any configuration at the bound"
    )
    yield Variable("crossings", network, "i4", long_name="steps across a singular prestress matrix", fill=-1)
    yield Variable("negative_pivots", network, "i4", long_name="negative eigenvalues of the last prestress matrix")
    yield Variable("nearest_singular", network, "f8", long_name="smallest over largest pivot during the ascent")
    yield Variable("residual", network, "f8", long_name="largest unbalanced force over the mean tension at the end")
    yield Variable("status", network, "i1", long_name="outcome of the ascent", flags=Status)


study = Study(
    name="shear_ascent",
    title="Unconstrained ascent of the shear modulus over stresses of both signs",
    references=f"{PAPER}, figure ShearModulusSteepestDescent A-E and Movie 1",
    axes=(Axis("seed", range(100), "seed of the network", noun="networks"),),
    parameters={"n_vertices": 1000, "hard_core": 0.82, "method": "lbfgs", "steps": STEPS},
    coordinates=(Coordinate("step", "steps", "step of the ascent"),),
    case=case,
    check=check,
    variables=tuple(table()),
    verify=verify,
    figures={"shear_ascent": ascent_figure},
    animations={"shear_ascent": animation},
    claims=claims,
    summary=summary,
)
