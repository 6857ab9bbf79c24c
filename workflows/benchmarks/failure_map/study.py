"""Where methods fail: error, claimed bound and status of every answer against the strength of a difficulty.

No answer may be silently wrong.  Every point is correct within its claimed bound, returns a status, or raises an error
with the reason; every other outcome is a violation.

With `network=FILE` the difficulties are those of the network of a file; those with their own networks stay empty.
"""

from __future__ import annotations

import numpy as np

from critflow import Status, StudyError, voronoi_network
from critflow.generators.random_networks import check_voronoi
from critflow.workflow import Axis, Coordinate, Study, Variable

from ...shared.checks import check_network
from ...shared.own_network import check_own, own_network, with_digest
from .assembly import ASSEMBLIES, DIFFICULT, errors, seconds
from .outcomes import Outcome, Violation
from .percolation import percolation
from .percolation_report import percolation_figure
from .problems import DIFFICULTIES, GENERATED, QUANTITIES
from .quantities import finding
from .report import assembly_figure, bound_figure, claims, map_figure, summary

PERCOLATION = "percolation"
MOST_VERTICES = 64


def case(parameters, *, difficulty, seed):
    """All quantities at all strengths of one difficulty, for one network; or the percolation curve."""
    quantities, n_steps = parameters["quantities"], parameters["n_steps"]
    sizes, spreads = parameters["sizes"], parameters["spreads"]
    shape = len(quantities), n_steps
    strength, error, bound = np.full(n_steps, np.nan), np.full(shape, np.nan), np.full(shape, np.nan)
    outcome, violation = np.zeros(shape, int), np.zeros(shape, int)
    status = np.full(shape, int(Status.missing))
    assemblies = parameters["assemblies"]
    assembly_error, assembly_seconds = np.full((len(assemblies), n_steps), np.nan), np.full(len(assemblies), np.nan)
    curve = np.zeros((len(sizes), len(spreads)), int), *np.full((2, len(sizes), len(spreads)), np.nan)
    own = own_network(parameters)
    source = own or parameters["n_vertices"]
    if own and difficulty in (PERCOLATION, *GENERATED):
        pass
    elif difficulty == PERCOLATION:
        curve = percolation(sizes, spreads, parameters["networks"], seed)
    else:
        strengths = chosen(DIFFICULTIES[difficulty].strengths, n_steps)
        strength[: len(strengths)] = strengths
        for row, quantity in enumerate(quantities):
            if quantity not in DIFFICULTIES[difficulty].quantities:
                continue
            for step, value in enumerate(strengths):
                problem = DIFFICULTIES[difficulty].problem(value, seed, source)
                found = finding(quantity, problem)
                error[row, step], bound[row, step] = found.error, found.bound
                outcome[row, step], violation[row, step] = found.outcome, found.violation
                status[row, step] = found.status
        if difficulty in DIFFICULT:
            for step, value in enumerate(strengths):
                problem = DIFFICULTIES[difficulty].problem(value, seed, source)
                assembly_error[:, step] = errors(problem, assemblies)
            assembly_seconds[:] = seconds(voronoi_network(parameters["timed_vertices"], seed), assemblies)
    return {
        "status": Status.ok,
        "strength": strength,
        "error": error,
        "bound": bound,
        "outcome": outcome,
        "violation": violation,
        "answer_status": status,
        "assembly_error": assembly_error,
        "assembly_seconds": assembly_seconds,
        "networks_solved": curve[0],
        "percolating": curve[1],
        "stressed_fraction": curve[2],
    }


def chosen(strengths, n_steps):
    """At most `n_steps` of the strengths, evenly spread."""
    if len(strengths) <= n_steps:
        return strengths
    return tuple(strengths[n] for n in np.round(np.linspace(0, len(strengths) - 1, n_steps)).astype(int))


def check(parameters, axes):
    """Refuse settings that could only fail, before anything runs."""
    if unknown := sorted(set(parameters["quantities"]) - set(QUANTITIES)):
        raise StudyError(f"there is no quantity {unknown[0]!r}: choose among {', '.join(QUANTITIES)}")
    if len(parameters["sizes"]) != len(parameters["networks"]) or min(parameters["networks"]) < 1:
        raise StudyError("every one of `sizes` needs a number of `networks` of at least 1")
    if parameters["n_steps"] < 2:
        raise StudyError(f"n_steps={parameters['n_steps']} must be at least 2")
    if unknown := sorted(set(parameters["assemblies"]) - set(ASSEMBLIES)):
        raise StudyError(f"there is no assembly {unknown[0]!r}: choose among {', '.join(ASSEMBLIES)}")
    if own := own_network(parameters):
        check_own(own)
        if own.n_vertices > MOST_VERTICES:
            raise StudyError(
                f"network: the references in many digits are for at most {MOST_VERTICES} vertices, not "
                f"{own.n_vertices}: give a smaller network"
            )
    for n_vertices in (parameters["n_vertices"], parameters["timed_vertices"], *parameters["sizes"]):
        check_network(check_voronoi, n_vertices, 0.82)


POINT = ("difficulty", "seed", "quantity", "step")
CURVE = ("difficulty", "seed", "size", "spread")

study = Study(
    name="failure_map",
    title="Where methods fail: error, claimed bound and status over the strength of every difficulty",
    axes=(
        Axis("difficulty", (PERCOLATION, *DIFFICULTIES), "difficulty", key="difficulties"),
        Axis("seed", range(2), "seed of the network", noun="networks"),
    ),
    parameters={
        "quantities": QUANTITIES,
        "assemblies": ASSEMBLIES,
        "timed_vertices": 256,
        "n_vertices": 16,
        "n_steps": 16,
        "sizes": (50, 100, 200, 400, 1000),
        "networks": (40, 40, 24, 12, 6),
        "spreads": (0.02, 0.04, 0.06, 0.08, 0.1, 0.12, 0.14, 0.16, 0.18, 0.2, 0.25, 0.3, 0.4, 0.5),
        "network": "",
    },
    coordinates=(
        Coordinate("quantity", "quantities", "computed quantity, and the method"),
        Coordinate("assembly", "assemblies", "method for a configuration of positive stress"),
        Coordinate("size", "sizes", "number of vertices of the percolation curve"),
        Coordinate("spread", "spreads", "spread s of the rest lengths of the percolation curve"),
    ),
    case=case,
    check=check,
    complete=with_digest,
    variables=(
        Variable("strength", ("difficulty", "step"), "f8", long_name="strength of the difficulty"),
        Variable("error", POINT, "f8", long_name="true error, relative to the largest number of the answer"),
        Variable("bound", POINT, "f8", long_name="claimed bound on the error, relative to the same"),
        Variable("outcome", POINT, "i1", long_name="outcome of the point", flags=Outcome),
        Variable("violation", POINT, "i1", long_name="kind of a silent wrong answer", flags=Violation),
        Variable("answer_status", POINT, "i1", long_name="status of the answer", flags=Status),
        Variable(
            "assembly_error",
            ("difficulty", "seed", "assembly", "step"),
            "f8",
            long_name="largest coordinate error of a configuration, relative to the largest coordinate",
        ),
        Variable(
            "assembly_seconds",
            ("difficulty", "seed", "assembly"),
            "f8",
            units="s",
            volatile=True,
            long_name="median time of a configuration of `timed_vertices` vertices",
        ),
        Variable("networks_solved", CURVE, "i4", long_name="networks of the percolation curve"),
        Variable("percolating", CURVE, "f8", long_name="part of the networks with every edge stressed"),
        Variable("stressed_fraction", CURVE, "f8", long_name="mean part of the edges that are stressed"),
        Variable("status", ("difficulty", "seed"), "i1", long_name="whether the case was computed", flags=Status),
    ),
    figures={
        "failure_map": map_figure,
        "error_bounds": bound_figure,
        "assembly": assembly_figure,
        "percolation": percolation_figure,
    },
    claims=claims,
    summary=summary,
)
