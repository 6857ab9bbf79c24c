"""Where methods fail: error, claimed bound and status of every answer against the strength of a difficulty.

No answer may be silently wrong.  Every point is correct within its claimed bound, returns a status, or raises an error
with the reason; every other outcome is a violation.  Other methods and programs solve the same springs, and their
silent wrong answers are counted apart.

With `network=FILE` the difficulties are those of the network of a file; those with their own networks stay empty.
"""

from functools import partial

import numpy as np

from critflow import Status
from critflow.engine import Axis, Coordinate, Study, Variable
from critflow.points import check_voronoi
from critflow.result import StudyError

from ...shared.checks import check_known, check_network
from ...shared.own_network import check_own, own_network, with_digest
from ...shared.tables import networks, padded
from .outcomes import Finding, Outcome, Violation
from .peers import PEERS
from .problems import DIFFICULTIES, GENERATED, QUANTITIES, WITH_PEERS
from .quantities import finding
from .report import MAPS, bound_figure, claims, map_figure, summary

MOST_VERTICES = 64


def case(parameters, *, difficulty, seed):
    """All quantities at all strengths of one difficulty, for one network."""
    quantities, n_steps = parameters["quantities"], parameters["n_steps"]
    own, chosen = own_network(parameters), DIFFICULTIES[difficulty]
    strengths = () if own and difficulty in GENERATED else evenly(chosen.strengths, n_steps)
    strength = padded(strengths, n_steps)
    findings = np.full((len(quantities), n_steps), Finding(Outcome.absent), dtype=object)
    for step, value in enumerate(strengths):
        for row, quantity in enumerate(quantities):
            if quantity in (*chosen.quantities, *(PEERS if difficulty in WITH_PEERS else ())):
                # A problem keeps what the methods of one quantity compute, so each has its own.
                findings[row, step] = finding(quantity, chosen.problem(value, seed, own or parameters["n_vertices"]))
    columns = {name: name for name in ("error", "bound", "outcome", "violation", "calls")} | {"answer_status": "status"}
    lists = {name: [[getattr(found, of) for found in row] for row in findings] for name, of in columns.items()}
    return {"status": Status.ok, "strength": strength} | {name: np.array(values) for name, values in lists.items()}


def evenly(strengths, n_steps):
    """At most `n_steps` of the strengths, evenly spread."""
    if len(strengths) <= n_steps:
        return strengths
    return tuple(strengths[n] for n in np.round(np.linspace(0, len(strengths) - 1, n_steps)).astype(int))


def check(parameters, axes):
    """Refuse settings that could only fail, before anything runs."""
    check_known("quantity", parameters["quantities"], (*QUANTITIES, *PEERS))
    if parameters["n_steps"] < 2:
        raise StudyError(f"n_steps={parameters['n_steps']} must be at least 2")
    if own := own_network(parameters):
        check_own(own)
        if own.n_vertices > MOST_VERTICES:
            raise StudyError(
                f"network: the references in many digits are for at most {MOST_VERTICES} vertices, not "
                f"{own.n_vertices}: give a smaller network"
            )
    check_network(check_voronoi, parameters["n_vertices"])


POINT = ("difficulty", "seed", "quantity", "step")

study = Study(
    name="failure_map",
    title="Where methods fail: error, claimed bound and status over the strength of every difficulty",
    axes=(
        Axis("difficulty", tuple(DIFFICULTIES), "difficulty", key="difficulties"),
        networks(2),
    ),
    parameters={
        "quantities": (*QUANTITIES, *PEERS),
        "n_vertices": 16,
        "n_steps": 16,
        "network": "",
    },
    coordinates=(Coordinate("quantity", "quantities", "computed quantity, and the method"),),
    case=case,
    check=check,
    complete=partial(with_digest, 16),
    variables=(
        Variable("strength", ("difficulty", "step"), "f8", long_name="strength of the difficulty"),
        Variable("error", POINT, "f8", long_name="true error, relative to the largest number of the answer"),
        Variable("bound", POINT, "f8", long_name="claimed bound on the error, relative to the same"),
        Variable("outcome", POINT, "i1", long_name="outcome of the point", flags=Outcome),
        Variable("violation", POINT, "i1", long_name="kind of a silent wrong answer", flags=Violation),
        Variable("calls", POINT, "i4", long_name="evaluations, solves and factorisations of a peer"),
        Variable("answer_status", POINT, "i1", long_name="status of the answer", flags=Status),
        Variable("status", ("difficulty", "seed"), "i1", long_name="whether the case was computed", flags=Status),
    ),
    figures={**{name: partial(map_figure, name=name) for name in MAPS}, "error_bounds": bound_figure},
    claims=claims,
    summary=summary,
)
