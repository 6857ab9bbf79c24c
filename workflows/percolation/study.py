"""Random rest lengths: stressed edges, bulk modulus and C_B against their spread, by the cone program and by strain.

Rest lengths of one network are the same random numbers for every spread, scaled.  The paper prints a spread of 0.3 for
populations in which every edge is stressed and whose bulk modulus is about 10 % below the largest.  The cone program
gives the configuration exactly at the transition; the protocol of the paper strains springs until their energy is 1e-4.
"""

import numpy as np

from critflow import CriticalManifold, Status, critical_from_lengths, upper_bound, voronoi_network
from critflow.generators.random_networks import check_voronoi
from critflow.workflow import Axis, Coordinate, Study, Variable, stable_rng

from ..shared.checks import check_network
from ..shared.measurements import coefficients, moduli_with_bounds, stressed_fraction
from ..shared.populations import random_lengths
from ..shared.reports import PAPER
from ..shared.strain_protocol import critical_by_strain
from ..shared.tables import bounded, numbers, outcomes
from .report import claims, percolation_figure, spread_figure

MEASURED = ("solve_status", "stressed_fraction", "bulk", "bulk_error_bound", "C_B", "C_B_error_bound")
NOT_COMPUTED = (Status.missing, *[np.nan] * 5)


def case(parameters, *, seed, n_vertices):
    """Stressed edges and moduli of one network at every spread, by both methods."""
    manifold = CriticalManifold(voronoi_network(n_vertices, seed))
    rows, strained = [], []
    for spread in parameters["spreads"]:
        lengths = random_lengths(stable_rng(seed, "percolation", str(n_vertices)), manifold.network.n_edges, spread)
        rows.append(measured(manifold, critical_from_lengths(manifold, lengths, throw=False)))
        protocol = seed < parameters["protocol_networks"]
        strained.append(measured(manifold, critical_by_strain(manifold, lengths)) if protocol else NOT_COMPUTED)
    return {
        "status": Status.ok,
        **{name: [row[n] for row in rows] for n, name in enumerate(MEASURED)},
        **{f"strained_{name}": [row[n] for row in strained] for n, name in enumerate(MEASURED)},
    }


def measured(manifold, solution):
    """`MEASURED` of the configuration of one set of rest lengths."""
    if solution.status not in (Status.ok, Status.slack_edges):
        return (solution.status, *NOT_COMPUTED[1:])
    critical = solution.value
    bulk = moduli_with_bounds(critical)[:, 0] / upper_bound(manifold, "B_0")
    C_B = [values[2] for values in coefficients(critical)]
    return solution.status, stressed_fraction(critical.sigma), *bulk, *C_B


def check(parameters, axes):
    """Refuse sizes without a network, before anything runs."""
    for n_vertices in axes["n_vertices"]:
        check_network(check_voronoi, n_vertices)


EACH = ("seed", "n_vertices")
SPREAD = (*EACH, "spread")

study = Study(
    name="percolation",
    title="Percolation of stress against the spread of the rest lengths and the size of the network",
    references=PAPER,
    axes=(
        Axis("seed", range(80), "seed of the network", noun="networks"),
        Axis("n_vertices", (50, 100, 200, 400, 1000), "number of vertices", key="n_vertices"),
    ),
    parameters={
        "protocol_networks": 20,
        "spreads": (0.0, 0.02, 0.04, 0.06, 0.08, 0.1, 0.12, 0.14, 0.16, 0.18, 0.2, 0.25, 0.3, 0.4, 0.5),
    },
    coordinates=(Coordinate("spread", "spreads", "spread s of the rest lengths"),),
    case=case,
    check=check,
    variables=(
        *numbers(
            SPREAD,
            stressed_fraction="part of the edges under tension",
            strained_stressed_fraction="part of the edges under tension by the strain protocol",
        ),
        *bounded(
            SPREAD,
            bulk="B_0 over the largest possible on the network",
            C_B="C_B of the stressed part [k]",
            strained_bulk="B_0 by the strain protocol, over the largest possible",
            strained_C_B="C_B by the strain protocol [k]",
        ),
        *outcomes(SPREAD, solve_status="outcome by spread", strained_solve_status="outcome of the strain protocol"),
        Variable("status", EACH, "i1", long_name="whether the case was computed", flags=Status),
    ),
    figures={"percolation": percolation_figure, "spread": spread_figure},
    claims=claims,
)
