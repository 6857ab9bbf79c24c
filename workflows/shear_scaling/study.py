"""The shear modulus at the transition against size, threshold and number of starts (`ShearModulusScaling`).

The shear modulus of populations that are not optimised for it falls as 1/N_v; that of max G_0 is independent of size,
with aligned edges that align further at a lower threshold r.  The constrained objective has many local optima.
"""

from __future__ import annotations

import numpy as np

from critflow import Status, StudyError, elasticity, modulus_bound, optimize, voronoi_network
from critflow.critical.quantity import pure_shear
from critflow.generators.random_networks import check_voronoi
from critflow.workflow import Axis, Coordinate, Study, Variable, stable_rng

from ..shared.checks import check_network
from ..shared.populations import POPULATIONS, configuration, prepared
from ..shared.reports import PAPER
from .report import claims, scaling_figure, summary


def case(parameters, *, n_vertices, seed):
    """G_0 of every population; for the first networks also max G_0 at each threshold and from several starts."""
    manifold = prepared(voronoi_network, n_vertices, seed, parameters["hard_core"])
    populations = np.full(len(parameters["populations"]), np.nan)
    statuses = np.full(len(populations), int(Status.failed))
    for n, population in enumerate(parameters["populations"]):
        found = configuration(manifold, parameters, seed, population)
        statuses[n] = found.status
        if np.isfinite(found.value.coordinates).all():
            populations[n] = elasticity(found.value).value.shear

    detailed = np.full((3, len(parameters["thresholds"])), np.nan)
    starts = np.full(parameters["n_starts"], np.nan)
    # The thresholds and starts cost ten times as much, and differ little between networks.
    if seed < parameters["detailed_seeds"]:
        for n, r in enumerate(parameters["thresholds"]):
            found = optimize(manifold, "shear_modulus", threshold=r, throw=False)
            size = found.value.lengths.max() / np.sqrt(manifold.network.volume)
            detailed[:, n] = elasticity(found.value).value.shear, size, found.status
        rng = stable_rng(seed, "starts", str(n_vertices))
        several = optimize(
            manifold, "shear_modulus", threshold=parameters["threshold"], starts=len(starts), rng=rng, throw=False
        )
        starts[:] = several.starts
    return {
        "status": Status.ok,
        "shear_modulus_0": populations,
        "population_status": statuses,
        "shear_modulus_of_threshold": detailed[0],
        "longest_edge_of_threshold": detailed[1],
        "threshold_status": np.where(np.isnan(detailed[2]), Status.missing, detailed[2]).astype(int),
        "objective_of_start": starts,
        "bound": modulus_bound(manifold, pure_shear(2)),
    }


def check(parameters, axes):
    """Refuse settings that could only fail, before anything runs."""
    if unknown := sorted(set(parameters["populations"]) - set(POPULATIONS)):
        raise StudyError(f"there is no population {unknown[0]!r}: choose among {', '.join(POPULATIONS)}")
    if not all(r > 0 for r in (*parameters["thresholds"], parameters["threshold"])):
        raise StudyError("thresholds must be positive, such as 0.1")
    if parameters["n_starts"] < 1:
        raise StudyError(f"n_starts={parameters['n_starts']} must be at least 1")
    for n_vertices in axes["n_vertices"]:
        check_network(check_voronoi, n_vertices, parameters["hard_core"])


EACH = ("n_vertices", "seed")

study = Study(
    name="shear_scaling",
    version=2,
    title="The shear modulus at the transition against size, threshold and number of starts",
    references=f"{PAPER}, figure ShearModulusScaling",
    axes=(
        Axis("seed", range(60), "seed of the network", noun="networks"),
        Axis("n_vertices", (100, 200, 500, 1000), "number of vertices", key="n_vertices"),
    ),
    parameters={
        "populations": POPULATIONS,
        "thresholds": (0.01, 0.02, 0.03, 0.05, 0.1, 0.2, 0.3, 0.5, 0.7),
        "n_starts": 12,
        "detailed_seeds": 12,
        "hard_core": 0.82,
        "threshold": 0.1,
        "spread": 0.1,
        "spread_wide": 0.3,
        "protocol": "conic",
    },
    coordinates=(
        Coordinate("population", "populations", "population of critical configurations"),
        Coordinate("threshold", "thresholds", "least stress r that the penalty allows, where the mean square is one"),
    ),
    case=case,
    check=check,
    variables=(
        Variable("shear_modulus_0", (*EACH, "population"), "f8", long_name="shear modulus at the transition [k]"),
        Variable("population_status", (*EACH, "population"), "i1", long_name="outcome by population", flags=Status),
        Variable("shear_modulus_of_threshold", (*EACH, "threshold"), "f8", long_name="G_0 of max G_0, from σ = 1 [k]"),
        Variable("longest_edge_of_threshold", (*EACH, "threshold"), "f8", long_name="its longest edge over the side"),
        Variable("threshold_status", (*EACH, "threshold"), "i1", long_name="outcome by threshold", flags=Status),
        Variable("objective_of_start", (*EACH, "start"), "f8", long_name="penalised G_0 of each start, σ = 1 first"),
        Variable("bound", EACH, "f8", long_name="largest shear modulus of any stress, in closed form [k]"),
        Variable("status", EACH, "i1", long_name="whether the case was computed", flags=Status),
    ),
    figures={"shear_scaling": scaling_figure},
    claims=claims,
    summary=summary,
)
