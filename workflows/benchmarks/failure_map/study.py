"""Where methods fail: error, claimed bound and status of every answer against the strength of a difficulty.

No answer may be silently wrong.  Every point is correct within its claimed bound, returns a status, or raises an error
with the reason; every other outcome is a violation.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from critflow import Status
from critflow.generators.random_networks import check_voronoi
from critflow.result import StudyError
from critflow.workflow import Axis, Coordinate, Study, Variable

from ...shared.checks import check_network
from ...shared.tables import padded
from .outcomes import Finding, Outcome, Violation
from .problems import DIFFICULTIES, QUANTITIES
from .quantities import finding
from .report import MAPS, bound_figure, claims, map_figure, summary


def case(parameters, *, difficulty, seed):
    """All quantities at all strengths of one difficulty, for one network."""
    quantities, n_steps = parameters["quantities"], parameters["n_steps"]
    chosen = DIFFICULTIES[difficulty]
    strengths = evenly(chosen.strengths, n_steps)
    strength = padded(strengths, n_steps)
    findings = np.full((len(quantities), n_steps), Finding(Outcome.absent), dtype=object)
    for step, value in enumerate(strengths):
        for row, quantity in enumerate(quantities):
            if quantity in chosen.quantities:
                # A problem keeps what the methods of one quantity compute, so each has its own.
                findings[row, step] = finding(quantity, chosen.problem(value, seed, parameters["n_vertices"]))
    columns = ("error", "bound", "outcome", "violation", "status")
    error, bound, outcome, violation, status = (
        np.array([[getattr(found, name) for found in row] for row in findings]) for name in columns
    )
    return {
        "status": Status.ok,
        "strength": strength,
        "error": error,
        "bound": bound,
        "outcome": outcome,
        "violation": violation,
        "answer_status": status,
    }


def evenly(strengths, n_steps):
    """At most `n_steps` of the strengths, evenly spread."""
    if len(strengths) <= n_steps:
        return strengths
    return tuple(strengths[n] for n in np.round(np.linspace(0, len(strengths) - 1, n_steps)).astype(int))


def check(parameters, axes):
    """Refuse settings that could only fail, before anything runs."""
    if unknown := sorted(set(parameters["quantities"]) - set(QUANTITIES)):
        raise StudyError(f"there is no quantity {unknown[0]!r}: choose among {', '.join(QUANTITIES)}")
    if parameters["n_steps"] < 2:
        raise StudyError(f"n_steps={parameters['n_steps']} must be at least 2")
    check_network(check_voronoi, parameters["n_vertices"], 0.82)


POINT = ("difficulty", "seed", "quantity", "step")

study = Study(
    name="failure_map",
    title="Where methods fail: error, claimed bound and status over the strength of every difficulty",
    axes=(
        Axis("difficulty", tuple(DIFFICULTIES), "difficulty", key="difficulties"),
        Axis("seed", range(2), "seed of the network", noun="networks"),
    ),
    parameters={
        "quantities": QUANTITIES,
        "n_vertices": 16,
        "n_steps": 16,
    },
    coordinates=(Coordinate("quantity", "quantities", "computed quantity, and the method"),),
    case=case,
    check=check,
    variables=(
        Variable("strength", ("difficulty", "step"), "f8", long_name="strength of the difficulty"),
        Variable("error", POINT, "f8", long_name="true error, relative to the largest number of the answer"),
        Variable("bound", POINT, "f8", long_name="claimed bound on the error, relative to the same"),
        Variable("outcome", POINT, "i1", long_name="outcome of the point", flags=Outcome),
        Variable("violation", POINT, "i1", long_name="kind of a silent wrong answer", flags=Violation),
        Variable("answer_status", POINT, "i1", long_name="status of the answer", flags=Status),
        Variable("status", ("difficulty", "seed"), "i1", long_name="whether the case was computed", flags=Status),
    ),
    figures={**{name: partial(map_figure, name=name) for name in MAPS}, "error_bounds": bound_figure},
    claims=claims,
    summary=summary,
)
