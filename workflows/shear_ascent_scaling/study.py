"""Compressed edges of the unconstrained ascent against the size of the network (`ShearModulusSteepestDescent` F, G).

Networks of all sizes are compared at the end of the paper's method, FIRE, after the same number of steps, and with
L-BFGS at the same part of the closed-form bound: the same number of steps reaches a larger part in small networks.
"""

from __future__ import annotations

from critflow import CriticalManifold, StudyError, voronoi_network
from critflow.critical.quantity import pure_shear
from critflow.generators.random_networks import check_voronoi
from critflow.quantities.largest_modulus import least_compressed_length
from critflow.result import Status
from critflow.workflow import Axis, Coordinate, Study, Variable

from ..shared.ascent import ascend, check_ascent
from ..shared.checks import check_network
from ..shared.reports import PAPER
from .report import claims, scaling_figure, summary


def case(parameters, *, n_vertices, algorithm, seed):
    """One ascent, measured at its end and where it first reaches each part of the bound."""
    manifold = CriticalManifold(voronoi_network(n_vertices, seed, parameters["hard_core"]))
    steps, fractions = (0, parameters["n_steps"]), parameters["fractions"]
    ascent = ascend(manifold, algorithm, steps, fractions, stop_at_last=algorithm != "fire")
    return {
        # A stop at the largest part of the bound is the requested end.
        "status": Status.ok if (ascent.first >= 0).all() else ascent.solution.status,
        "bound": ascent.bound,
        "step": ascent.first,
        "compressed_edges": ascent.reached[3],
        "compressed_length": ascent.reached[4],
        "shear_modulus_end": ascent.end[0],
        "longest_edge_end": ascent.end[1],
        "compressed_edges_end": ascent.end[3],
        "compressed_length_end": ascent.end[4],
        "least_compressed_length": least_compressed_length(manifold, pure_shear(2)),
        "crossings": len(ascent.solution.crossings),
    }


def check(parameters, axes):
    """Refuse settings that could only fail, before anything runs."""
    check_ascent(parameters)
    if parameters["n_steps"] < 1:
        raise StudyError(f"n_steps={parameters['n_steps']} must be at least 1")
    for n_vertices in axes["n_vertices"]:
        check_network(check_voronoi, n_vertices, parameters["hard_core"])


EACH = ("algorithm", "n_vertices", "seed")

study = Study(
    name="shear_ascent_scaling",
    title="Compressed edges of the unconstrained shear ascent against the size of the network",
    references=f"{PAPER}, figure ShearModulusSteepestDescent F, G",
    axes=(
        Axis("seed", range(12), "seed of the network", noun="networks"),
        Axis("algorithm", ("fire", "lbfgs"), "algorithm of the ascent", choices=("newton",)),
        Axis("n_vertices", (50, 100, 200, 500, 1000), "number of vertices", key="n_vertices"),
    ),
    parameters={"hard_core": 0.82, "n_steps": 10000, "fractions": (0.5, 0.8, 0.95)},
    coordinates=(Coordinate("fraction", "fractions", "part of the closed-form bound that is reached"),),
    case=case,
    check=check,
    variables=(
        Variable("bound", EACH, "f8", long_name="largest shear modulus of any stress, in units of k"),
        Variable("step", (*EACH, "fraction"), "i4", long_name="step that first reached this part; -1: none", fill=-2),
        Variable("compressed_edges", (*EACH, "fraction"), "f8", long_name="number of compressed edges there"),
        Variable("compressed_length", (*EACH, "fraction"), "f8", long_name="total length of compressed edges there"),
        Variable("shear_modulus_end", EACH, "f8", long_name="shear modulus at the end, in units of k"),
        Variable("longest_edge_end", EACH, "f8", long_name="longest edge at the end over the side of the box"),
        Variable("compressed_edges_end", EACH, "f8", long_name="number of compressed edges at the end"),
        Variable("compressed_length_end", EACH, "f8", long_name="total length of compressed edges at the end"),
        Variable(
            "least_compressed_length", EACH, "f8", long_name="least compressed length of configurations at the bound"
        ),
        Variable("crossings", EACH, "i4", long_name="steps across a singular prestress matrix", fill=-1),
        Variable("status", EACH, "i1", long_name="outcome of the ascent", flags=Status),
    ),
    figures={"compression": scaling_figure},
    claims=claims,
    summary=summary,
)
