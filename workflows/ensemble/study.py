"""Seven populations of critical configurations on the same networks, strained past the transition.

The paper's main ensemble: `StructuralMetrics`, `ResponseMetrics` and the claims around them.  Random rest lengths come
twice, with the spread that the paper prints (0.3, `random_lengths_wide`) and with the largest one that leaves every
edge of these networks stressed (0.1, `random_lengths`).
"""

from __future__ import annotations

import numpy as np

from critflow import (
    Status,
    StudyError,
    voronoi_network,
)
from critflow.mechanics.strain_path import check_strains
from critflow.rigidity.structure import face_anisotropy, force_anisotropy
from critflow.workflow import Axis, Coordinate, Study, decimals

from ..shared.checks import check_network, check_positive
from ..shared.measurements import measured, table
from ..shared.populations import POPULATIONS, configuration, prepared
from .report import claims, gallery, response_figure, structure_figure, summary
from .verify import verify


def case(parameters, *, seed, population, wanted):
    """A critical configuration, its structure, and its moduli at the transition and along the strain path."""
    manifold = prepared(parameters["n_vertices"], seed, parameters["hard_core"])
    network = manifold.network
    found = configuration(manifold, parameters, seed, population)
    shared = {"edges": network.edges, "offsets": network.offsets, "cell": network.cell, "status": found.status}
    if not np.isfinite(found.value.coordinates).all():
        return shared
    # Where an edge collapses the infimum has no configuration, so the coefficients of a near one mean nothing.
    undefined = np.nan if found.status is Status.edge_collapse else 1.0
    result = shared | measured(manifold, found, parameters, wanted, undefined)
    for name, anisotropy in (("anisotropy_physical", face_anisotropy), ("anisotropy_force", force_anisotropy)):
        if name in wanted:
            result[name] = np.nanmean(anisotropy(found.value))
    return result


def check(parameters, axes):
    """Refuse settings that could only fail, before anything runs."""
    check_strains(parameters["strains"])
    check_positive(parameters, "threshold", "spread", "spread_wide", "hard_core", "fit_window")
    if parameters["protocol"] not in ("conic", "strain"):
        raise StudyError(f"protocol={parameters['protocol']} must be conic (exact) or strain (the paper's steps)")
    check_network(voronoi_network, parameters["n_vertices"], axes["seed"][0], parameters["hard_core"])


study = Study(
    name="ensemble",
    version=2,
    title="Populations of critical configurations, strained past the rigidity transition",
    references="Hain, Santangelo and Manning, Optimizing properties on the critical rigidity manifold of "
    "underconstrained central-force networks (arXiv:2407.13939)",
    axes=(
        Axis("seed", range(100), "seed of the network", noun="networks"),
        Axis("population", POPULATIONS, "population of critical configurations"),
    ),
    parameters={
        "n_vertices": 1000,
        "hard_core": 0.82,
        "threshold": 0.1,
        "spread": 0.1,
        "spread_wide": 0.3,
        "protocol": "conic",
        "strains": decimals("0.001:0.010:0.001"),
        "fit_window": 0.01,
    },
    coordinates=(Coordinate("strain", "strains", "volumetric strain past the transition"),),
    case=case,
    check=check,
    variables=tuple(table(planar=True)),
    figures={"gallery": gallery, "structure": structure_figure, "response": response_figure},
    claims=claims,
    summary=summary,
    verify=verify,
)
