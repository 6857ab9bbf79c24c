"""Seven populations of critical configurations on the same networks, strained past the transition.

The paper's main ensemble: `StructuralMetrics`, `ResponseMetrics` and the claims around them.  Random rest lengths come
twice, with the spread that the paper prints (0.3, `random_lengths_wide`) and with the largest one that leaves every
edge of these networks stressed (0.1, `random_lengths`).

With `network=FILE` the network is that of a file; seeds are then those of random populations and of random starts.
"""

from __future__ import annotations

from critflow import StudyError
from critflow.generators.random_networks import check_voronoi
from critflow.paths.strain_path import check_strains
from critflow.workflow import Axis, Coordinate, Study, decimals

from ..shared.checks import check_deformation, check_network, check_positive
from ..shared.measurements import DRAWN, planar_member, table, verify
from ..shared.own_network import check_own, own_network, with_digest
from ..shared.population_reports import summary
from ..shared.populations import POPULATIONS
from ..shared.reports import PAPER
from .report import RESPONSE, STRUCTURE, claims, gallery, response_figure, structure_figure


def case(parameters, *, seed, population, wanted):
    """A critical configuration, its structure, and its moduli at the transition and along the strain path."""
    return planar_member(parameters, seed=seed, population=population, wanted=wanted)


def check(parameters, axes):
    """Refuse settings that could only fail, before anything runs."""
    check_strains(parameters["strains"])
    check_positive(parameters, "threshold", "spread", "spread_wide", "hard_core", "fit_window")
    if parameters["protocol"] not in ("conic", "strain"):
        raise StudyError(f"protocol={parameters['protocol']} must be conic (exact) or strain (the paper's steps)")
    check_deformation(parameters["deformation"])
    if network := own_network(parameters):
        check_own(network)
    else:
        check_network(check_voronoi, parameters["n_vertices"], parameters["hard_core"])


study = Study(
    name="ensemble",
    version=2,
    title="Populations of critical configurations, strained past the rigidity transition",
    references=PAPER,
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
        "deformation": "dilation",
        "network": "",
    },
    coordinates=(
        Coordinate("strain", "strains", "strain |γ| past the transition, of the deformation and sign that tightens"),
    ),
    case=case,
    check=check,
    complete=with_digest,
    variables=tuple(table(planar=True)),
    figures={"gallery": gallery, "structure": structure_figure, "response": response_figure},
    needs={
        "gallery": (*DRAWN, "bulk_modulus_0"),
        "structure": (*DRAWN, *STRUCTURE, "stressed_fraction"),
        "response": (*DRAWN, *RESPONSE, "stressed_fraction"),
        "claims": (*STRUCTURE, *RESPONSE, "C_G_exact", "C_B", "stressed_fraction"),
        "summary": ("max_force",),
    },
    claims=claims,
    summary=summary,
    verify=verify,
)
