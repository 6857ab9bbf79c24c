"""Speed against accuracy of every method up to the transition, and time and memory against size.

Each point has the error against a much more accurate reference, the processor time, the calls of which the run is made
and the status; each method has the time that it needs once, for what it prepares from the bare problem.  Methods are
compared at equal errors, by medians and quartiles over networks.  A strain step and moduli have a distance γ to the
transition, which all others are at.  Other packages are optional, `pip install 'critflow[peers]'`; a missing one is
recorded.  The task `stages` takes one network of up to a million vertices through all that is known in closed form.
Times are on one core and depend on the machine: compare ratios within one case.  Calls do not: factorisations of a
matrix, solves with a factor, and evaluations of forces or products with a matrix.
"""

import warnings
from dataclasses import replace
from enum import IntEnum

import numpy as np

from critflow import Status
from critflow.engine import Axis, Coordinate, Study, Variable
from critflow.points import check_voronoi
from critflow.result import StudyError

from ...shared.checks import check_known, check_network, check_positive
from ...shared.tables import networks
from ..timing import CALLS, COLD, Backend, Timing, benchmark, installed, one_core
from . import stages
from .charts import overview_figure
from .report import claims, summary
from .sizes import sizes_figure
from .tasks import ALL_SIZES, GAMMAS, METHODS, SIZES, TASKS, has_size, strains_of


class Presence(IntEnum):
    """Whether a method belongs to critflow or to another package, and whether it was run."""

    absent = 0
    critflow = 1
    peer = 2
    not_installed = 3


# Stored at every level of a method: type, meaning, and its value of a timing.
POINTS = {
    "seconds": ("f8", "processor time of a prepared run, median", lambda timing: _median(timing.seconds)),
    "error": ("f8", "error against the reference, as defined by the task", lambda timing: timing.error),
    "outcome": ("i1", "status returned by the method", lambda timing: timing.status),
    **{name: ("i4", text, lambda timing, name=name: timing.calls.get(name, 0)) for name, text in CALLS.items()},
}  # fmt: skip


def _median(seconds):
    return np.median(seconds) if seconds else np.nan


def case(parameters, *, task, n_vertices, seed):
    """All methods of one task, or all stages, of one network; empty at sizes that are not of the task."""
    names, gammas = parameters["contestants"], parameters["gammas"]
    shape = len(names), len(gammas), len(parameters["levels"])
    arrays = {name: np.full(shape, np.nan if dtype == "f8" else 0) for name, (dtype, *_) in POINTS.items()}
    arrays["outcome"][:] = Status.missing
    presence, backend = np.zeros(shape[0], int), np.zeros(shape[0], int)
    memory, wall, preparation = np.full(shape[0], np.nan), np.full(shape[0], np.nan), np.full(shape[:2], np.nan)
    for place in strains_of(task, n_vertices, gammas) if has_size(task, n_vertices, seed) else ():
        for timing in _timings(parameters, task, n_vertices, seed, gammas[place]):
            method = timing.method
            if method.name not in names:
                continue
            row = names.index(method.name)
            own = Presence.critflow if method.package == "critflow" else Presence.peer
            presence[row] = own if installed(method.package) else Presence.not_installed
            backend[row] = Backend.__members__.get(method.backend or "none", Backend.other)
            memory[row], wall[row] = timing.memory, _median(timing.wall)
            if timing.level == COLD:
                preparation[row, place] = _median(timing.seconds)
            else:
                for name, (*_, value) in POINTS.items():
                    arrays[name][row, place, timing.level] = value(timing)
    # The first use contains a run at the roughest level.
    preparation = np.maximum(preparation - arrays["seconds"][..., 0], 0)
    found = {"presence": presence, "backend": backend, "memory": memory, "wall_seconds": wall}
    return {"status": Status.ok, "preparation_seconds": preparation, **arrays, **found}


def _timings(parameters, task, n_vertices, seed, gamma) -> list[Timing]:
    """Timings of the requested methods and levels, or of the stages."""
    if task == stages.WORD:
        return stages.measured(n_vertices, seed, parameters["least_time"])
    # Other packages warn and start threads; only their answers on one core are compared.
    with one_core(), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        chosen = [
            replace(m, levels=tuple(m.levels[level] for level in parameters["levels"] if level < len(m.levels)))
            for m in TASKS[task].methods(n_vertices, seed, gamma)
            if m.name in parameters["contestants"]
        ]
        return benchmark(chosen, parameters["patience"], parameters["least_run"])


def check(parameters, axes):
    """Refuse settings that could only fail, before anything runs."""
    check_positive(parameters, "patience", "least_time")
    check_known("method", parameters["contestants"], METHODS)
    if not all(0 <= gamma <= 0.5 for gamma in parameters["gammas"]):
        raise StudyError("gammas must be between 0, for tasks at the transition, and 0.5")
    for n_vertices in axes["n_vertices"]:
        if stages.WORD in axes["task"] and (n_vertices % 2 or n_vertices < 40):
            raise StudyError(f"n_vertices={n_vertices} must be even and at least 40: every Voronoi cell brings two")
        if n_vertices < 1_000:
            check_network(check_voronoi, n_vertices)


EACH = ("task", "n_vertices", "seed")
# The dimension of the methods is not called `method`, which is an argument of xarray's `sel`.
METHOD = (*EACH, "contestant")
POINT = (*METHOD, "gamma", "level")

study = Study(
    name="speed",
    title="Error against cost of every method, up to the transition, and time and memory up to a million vertices",
    references="methods and problems of Hain, Santangelo and Manning, arXiv:2407.13939",
    axes=(
        Axis("task", tuple(SIZES), "computed quantity, or the stages of one network"),
        Axis("n_vertices", ALL_SIZES, "number of vertices", key="n_vertices"),
        networks(20),
    ),
    parameters={
        "contestants": METHODS,
        "gammas": GAMMAS,
        "levels": tuple(range(8)),
        "patience": 0.25,
        "least_run": 0.002,
        "least_time": 0.3,
    },
    coordinates=(
        Coordinate("contestant", "contestants", "method, or stage"),
        Coordinate("gamma", "gammas", "distance to the transition, V = V(0)(1 + γ)"),
        Coordinate("level", "levels", "requested accuracy, from rough to fine"),
    ),
    case=case,
    check=check,
    workers=1,
    variables=(
        *(
            Variable(
                name, POINT, dtype, long_name=text, units="s" if name == "seconds" else "1",
                volatile=name == "seconds", flags=Status if name == "outcome" else None,
            )
            for name, (dtype, text, _) in POINTS.items()
        ),
        Variable(
            "preparation_seconds", (*METHOD, "gamma"), "f8", long_name="processor time of the preparation", units="s",
            volatile=True,
        ),
        Variable("presence", METHOD, "i1", long_name="package of the method", flags=Presence),
        Variable("backend", METHOD, "i1", long_name="linear solver", flags=Backend),
        Variable("memory", METHOD, "f8", long_name="peak resident memory in a stage", units="MB", volatile=True),
        Variable("wall_seconds", METHOD, "f8", long_name="wall time of a stage, median", units="s", volatile=True),
        Variable("status", EACH, "i1", long_name="whether the case was computed", flags=Status),
    ),
    figures={"speed": overview_figure, "sizes": sizes_figure},
    claims=claims,
    summary=summary,
)  # fmt: skip
