"""Speed against accuracy of every method of critflow and of other packages, for each task, on one core.

Each point has the error against a much more accurate reference, the median of the times with quartiles, the status,
the iterations and the version of the package.  Other packages are optional, `pip install 'critflow[peers]'`; a missing
one is recorded.  Times are of the processor and depend on the machine: compare ratios within one case.
"""

from __future__ import annotations

import re
import time
import warnings
from dataclasses import replace
from enum import IntEnum
from functools import partial

import numpy as np

from critflow import Status, StudyError
from critflow.generators.random_networks import check_voronoi
from critflow.workflow import Axis, Coordinate, Study, Variable

from ...shared.checks import check_network, check_positive
from ..backends import Backend
from ..timing import benchmark, installed, one_core
from .charts import overview_figure, task_figure
from .report import claims, summary
from .tasks import METHODS, TASKS


class Presence(IntEnum):
    """Whether a method belongs to critflow or to another package, and whether it was run."""

    absent = 0
    critflow = 1
    peer = 2
    not_installed = 3


def case(parameters, *, task, n_vertices):
    """All methods of one task at one size; empty beyond the sizes of the task."""
    names, levels = parameters["contestants"], parameters["levels"]
    shape = len(names), len(levels)
    floats = {
        name: np.full(shape, np.nan)
        for name in ("seconds", "seconds_low", "seconds_high", "error", "claimed_bound", "level_value")
    }
    outcome, counts = np.full(shape, int(Status.missing)), np.zeros((2, *shape), int)
    presence, backend, versions = np.zeros(shape[0], int), np.zeros(shape[0], int), np.full((shape[0], 3), -1)
    # Other packages warn and start threads; only their answers on one core are compared.
    with one_core(), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        selected = _selected(parameters, TASKS[task], n_vertices)
        begin, used = time.perf_counter(), time.process_time()
        timings = benchmark(selected, parameters["repeats"], parameters["patience"], parameters["budget"])
        share = (time.process_time() - used) / (time.perf_counter() - begin)
    for method in selected:
        place, version = names.index(method.name), installed(method.package)
        own = method.package == "critflow"
        presence[place] = Presence.critflow if own else Presence.peer if version else Presence.not_installed
        backend[place] = Backend.__members__.get(method.backend or "none", Backend.other)
        numbers = [int(number) for number in re.findall(r"\d+", version)[:3]]
        versions[place, : len(numbers)] = numbers
    for timing in timings:
        at = names.index(timing.method.name), timing.level
        values = timing.median, *timing.quartiles, timing.accuracy.error, timing.accuracy.bound
        for name, value in zip(floats, (*values, timing.method.levels[timing.level]), strict=True):
            floats[name][at] = value
        outcome[at] = timing.accuracy.status
        counts[0][at], counts[1][at] = timing.accuracy.iterations, len(timing.seconds)
    return {
        "status": Status.ok,
        **floats,
        "outcome": outcome,
        "iterations": counts[0],
        "repeats_done": counts[1],
        "presence": presence,
        "backend": backend,
        "package_version": versions,
        "core_share": share if selected else np.nan,
    }


def _selected(parameters, task, n_vertices):
    """The requested methods with the requested levels; none beyond the sizes of the task."""
    if n_vertices > max(task.sizes):
        return []
    return [
        replace(c, levels=tuple(c.levels[level] for level in parameters["levels"] if level < len(c.levels)))
        for c in task.methods(n_vertices, parameters["seed"])
        if c.name in parameters["contestants"]
    ]


def check(parameters, axes):
    """Refuse settings that could only fail, before anything runs."""
    check_positive(parameters, "repeats", "patience", "budget")
    if unknown := sorted(set(parameters["contestants"]) - set(METHODS)):
        raise StudyError(f"there is no method {unknown[0]!r}: choose among {', '.join(METHODS)}")
    for n_vertices in axes["n_vertices"]:
        if n_vertices < 1_000:
            check_network(check_voronoi, n_vertices)


EACH = ("task", "n_vertices")
# The dimension of the methods is not called `method`, which is an argument of xarray's `sel`.
POINT = (*EACH, "contestant", "level")

study = Study(
    name="speed_accuracy",
    title="Speed against accuracy of every method",
    references="methods and problems of Hain, Santangelo and Manning, arXiv:2407.13939",
    axes=(
        Axis("task", tuple(TASKS), "computed quantity"),
        Axis("n_vertices", (100, 1_000, 10_000, 100_000, 1_000_000), "number of vertices", key="n_vertices"),
    ),
    parameters={
        "contestants": METHODS,
        "levels": tuple(range(14)),
        "repeats": 15,
        "patience": 1.5,
        "budget": 10.0,
        "seed": 0,
    },
    coordinates=(
        Coordinate("contestant", "contestants", "method"),
        Coordinate("level", "levels", "requested accuracy, from rough to fine"),
    ),
    case=case,
    check=check,
    workers=1,
    variables=(
        *(
            Variable(name, POINT, "f8", units="s", long_name=f"processor time of a run, {part}", volatile=True)
            for name, part in {
                "seconds": "median",
                "seconds_low": "lower quartile",
                "seconds_high": "upper quartile",
            }.items()
        ),
        Variable("error", POINT, "f8", long_name="error against the reference, as defined by the task"),
        Variable("claimed_bound", POINT, "f8", long_name="error bound returned by the method"),
        Variable("level_value", POINT, "f8", long_name="tolerance, step limit or other parameter of the level"),
        Variable("outcome", POINT, "i1", long_name="status returned by the method", flags=Status),
        Variable("iterations", POINT, "i4", long_name="iterations of the method"),
        Variable("repeats_done", POINT, "i2", long_name="number of timed runs"),
        Variable("presence", (*EACH, "contestant"), "i1", long_name="package of the method", flags=Presence),
        Variable("backend", (*EACH, "contestant"), "i1", long_name="linear solver", flags=Backend),
        Variable(
            "package_version", (*EACH, "contestant", "part"), "i4", fill=-2,
            long_name="version of the package, its first three numbers",
        ),
        Variable(
            "core_share", EACH, "f8", volatile=True,
            long_name="processor time over time: 1 where nothing else ran on the core",
        ),
        Variable("status", EACH, "i1", long_name="whether the case was computed", flags=Status),
    ),
    figures={"speed_accuracy": overview_figure} | {word: partial(task_figure, word=word) for word in TASKS},
    claims=claims,
    summary=summary,
)  # fmt: skip
