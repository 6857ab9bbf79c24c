"""Speed against accuracy: for each task of the library all methods, its own and its peers', in one process on one core.

Each point has an error against a reference far better than any contestant, the median of its times with their spread,
the outcome, iterations, and the version of what computed it.  Peers are an optional extra, `pip install
'critflow[peers]'`; one that is missing is recorded as missing.  Times are those of the machine that ran the study:
what can be compared are ratios within one case.
"""

from __future__ import annotations

import re
import warnings
from dataclasses import replace
from enum import IntEnum

import numpy as np

from critflow import Status, StudyError, voronoi_network
from critflow.workflow import Axis, Coordinate, Study, Variable

from ...shared.checks import check_network, check_positive
from ..timing import contest, installed, one_core
from .report import all_sizes_figure, claims, main_figure, summary
from .tasks import CONTESTANTS, TASKS


class Presence(IntEnum):
    """Whose method a contestant is, and whether it took part."""

    absent = 0
    critflow = 1
    peer = 2
    not_installed = 3


class Backend(IntEnum):
    """What factorised, where that is a choice."""

    none = 0
    qdldl = 1
    pardiso = 2
    metis = 3
    superlu = 4
    single = 5
    dense = 6
    multigrid = 7
    other = 8


def case(parameters, *, task, n_vertices):
    """All contestants of one task at one size; nothing where the task does not go to this size."""
    names, levels = parameters["contestants"], parameters["levels"]
    shape = len(names), len(levels)
    floats = {
        name: np.full(shape, np.nan)
        for name in ("seconds", "seconds_low", "seconds_high", "error", "claimed_bound", "level_value")
    }
    outcome, counts = np.full(shape, int(Status.missing)), np.zeros((2, *shape), int)
    presence, backend, versions = np.zeros(shape[0], int), np.zeros(shape[0], int), np.full((shape[0], 3), -1)
    # Peers warn of much, and start threads; what counts is their answer on one core.
    with one_core(), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        entrants = _entrants(parameters, TASKS[task], n_vertices)
        timings = contest(entrants, parameters["repeats"], parameters["patience"], parameters["budget"])
    for contestant in entrants:
        place, version = names.index(contestant.name), installed(contestant.package)
        own = contestant.package == "critflow"
        presence[place] = Presence.critflow if own else Presence.peer if version else Presence.not_installed
        backend[place] = Backend.__members__.get(contestant.backend or "none", Backend.other)
        numbers = [int(number) for number in re.findall(r"\d+", version)[:3]]
        versions[place, : len(numbers)] = numbers
    for timing in timings:
        at = names.index(timing.contestant.name), timing.level
        values = timing.median, *timing.quartiles, timing.verdict.error, timing.verdict.bound
        for name, value in zip(floats, (*values, timing.contestant.levels[timing.level]), strict=True):
            floats[name][at] = value
        outcome[at] = timing.verdict.status
        counts[0][at], counts[1][at] = timing.verdict.iterations, len(timing.seconds)
    return {
        "status": Status.ok,
        **floats,
        "outcome": outcome,
        "iterations": counts[0],
        "repeats_done": counts[1],
        "presence": presence,
        "backend": backend,
        "package_version": versions,
    }


def _entrants(parameters, task, n_vertices):
    """The contestants that were asked for, with the levels that were asked for; none beyond the sizes of the task."""
    if n_vertices > max(task.sizes):
        return []
    return [
        replace(c, levels=tuple(c.levels[level] for level in parameters["levels"] if level < len(c.levels)))
        for c in task.contestants(n_vertices, parameters["seed"])
        if c.name in parameters["contestants"]
    ]


def check(parameters, axes):
    """Refuse settings that could only fail, before anything runs."""
    check_positive(parameters, "repeats", "patience", "budget")
    if unknown := sorted(set(parameters["contestants"]) - set(CONTESTANTS)):
        raise StudyError(f"there is no contestant {unknown[0]!r}: choose among {', '.join(CONTESTANTS)}")
    for n_vertices in axes["n_vertices"]:
        if n_vertices < 1_000:
            check_network(voronoi_network, n_vertices, parameters["seed"])


EACH = ("task", "n_vertices")
POINT = (*EACH, "contestant", "level")

study = Study(
    name="speed_accuracy",
    title="Speed against accuracy of every method",
    references="methods and problems of Hain, Santangelo and Manning, arXiv:2407.13939",
    axes=(
        Axis("task", tuple(TASKS), "what is computed"),
        Axis("n_vertices", (100, 1_000, 10_000, 100_000, 1_000_000), "number of vertices", key="n_vertices"),
    ),
    parameters={
        "contestants": CONTESTANTS,
        "levels": tuple(range(14)),
        "repeats": 15,
        "patience": 1.5,
        "budget": 10.0,
        "seed": 0,
    },
    coordinates=(
        Coordinate("contestant", "contestants", "method"),
        Coordinate("level", "levels", "accuracy asked of a method, from rough to fine"),
    ),
    case=case,
    check=check,
    workers=1,
    variables=(
        *(
            Variable(name, POINT, "f8", units="s", long_name=f"time of a run, {part}", volatile=True)
            for name, part in {
                "seconds": "median",
                "seconds_low": "lower quartile",
                "seconds_high": "upper quartile",
            }.items()
        ),
        Variable("error", POINT, "f8", long_name="error against the reference, of the kind that the task names"),
        Variable("claimed_bound", POINT, "f8", long_name="what the method says its error does not exceed"),
        Variable("level_value", POINT, "f8", long_name="tolerance, steps or whatever the level stands for"),
        Variable("outcome", POINT, "i1", long_name="how the method ended", flags=Status),
        Variable("iterations", POINT, "i4", long_name="iterations of the method"),
        Variable("repeats_done", POINT, "i2", long_name="runs that were timed"),
        Variable("presence", (*EACH, "contestant"), "i1", long_name="whose method it is", flags=Presence),
        Variable("backend", (*EACH, "contestant"), "i1", long_name="what factorised", flags=Backend),
        Variable(
            "package_version", (*EACH, "contestant", "part"), "i4", fill=-2,
            long_name="version of the package, its first three numbers",
        ),
        Variable("status", EACH, "i1", long_name="whether the case was computed", flags=Status),
    ),
    figures={"speed_accuracy": main_figure, "speed_accuracy_sizes": all_sizes_figure},
    claims=claims,
    summary=summary,
)  # fmt: skip
