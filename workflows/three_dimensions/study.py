"""Six populations of critical configurations of networks in three dimensions, strained past the transition.

The study tests which findings of the paper on planar populations (`ResponseMetrics`) are valid for periodic Voronoi
networks in three dimensions, where four edges meet at every vertex.  Equal lengths often leave edges slack, so that the
least length variance is not attained; the population then contains the configuration of the cone program, with equal
lengths on all stressed edges.  The least tension variance is not attained either, because edges shrink to zero length:
the stored configuration is a near one, with edges of a hundredth of the mean length.
"""

from __future__ import annotations

import numpy as np

from critflow import foam_network
from critflow.generators.random_networks import FOAM_HARD_CORE, check_foam
from critflow.paths.strain_path import check_strains
from critflow.workflow import Axis, Coordinate, Study, decimals

from ..shared.checks import check_network, check_positive
from ..shared.measurements import DRAWN, identified, measured, table, verify
from ..shared.population_reports import summary
from ..shared.populations import PAPER_POPULATIONS, configuration, prepared
from ..shared.reports import PAPER
from .report import PANELS, claims, response_figure


def case(parameters, *, seed, population, wanted):
    """A critical configuration, and its moduli at the transition and along the strain path."""
    manifold = prepared(foam_network, parameters["n_vertices"], seed, parameters["hard_core"])
    # The least length variance of most foams is not attained: its limit is the optimum of the cone program.
    method = "conic" if population == "length_variance" else "auto"
    found = configuration(manifold, parameters, seed, population, method)
    if not np.isfinite(found.value.coordinates).all():
        return identified(manifold.network, found)
    return measured(manifold, found, parameters, wanted)


def check(parameters, axes):
    """Refuse settings that could only fail, before anything runs."""
    check_strains(parameters["strains"])
    check_positive(parameters, "threshold", "spread", "hard_core", "fit_window")
    check_network(check_foam, parameters["n_vertices"], parameters["hard_core"])


study = Study(
    name="three_dimensions",
    version=2,
    title="Populations of critical configurations in three dimensions, strained past the rigidity transition",
    references=f"{PAPER}, whose networks are planar",
    axes=(
        Axis("seed", range(20), "seed of the network", noun="networks"),
        Axis("population", PAPER_POPULATIONS, "population of critical configurations"),
    ),
    parameters={
        "n_vertices": 400,
        "hard_core": FOAM_HARD_CORE,
        "threshold": 0.1,
        "spread": 0.1,
        "strains": decimals("0.001:0.010:0.001"),
        "fit_window": 0.01,
    },
    coordinates=(Coordinate("strain", "strains", "volumetric strain past the transition"),),
    case=case,
    check=check,
    variables=tuple(table(planar=False)),
    figures={"response": response_figure},
    needs={
        "response": (*DRAWN, *PANELS),
        "claims": (*PANELS, "C_G_exact", "C_B", "length_variance", "tension_variance", "stressed_fraction"),
        "summary": ("max_force",),
    },
    claims=claims,
    summary=summary,
    verify=verify,
)
