"""Speed against accuracy: how methods are timed and judged, how fronts are read, and the study end to end, small.

No test asks how long anything took on this machine.
"""

import json
import os
import time

import numpy as np
import pytest
import xarray as xr

from critflow.command.main import main
from critflow.engine.code_digest import load_study
from critflow.result import Status
from critflow.sparse import BACKENDS
from workflows.benchmarks.speed import curves, report, sizes, stages
from workflows.benchmarks.speed.stages import STAGES
from workflows.benchmarks.speed.tasks import TASKS
from workflows.benchmarks.timing import COLD, Answer, Method, benchmark

study = load_study("speed").study

CORES = os.sched_getaffinity(0) if hasattr(os, "sched_getaffinity") else set()

# Timing


def fake(name, run, levels=(0.0, 1.0, 2.0), **more):
    return Method(name, lambda: lambda level: Answer(run(level)), lambda values: values, levels, **more)


def broken(level):
    if level == 1.0:
        raise ZeroDivisionError("by a peer")
    return 0.1


def slow(level):
    end = time.process_time() + 0.02
    while time.process_time() < end:
        pass
    return 0.1


def test_a_method_that_raises_has_failed_and_a_slow_one_stops():
    runs = []

    def steady(level):
        runs.append(level)
        return 10.0**-level

    methods = [fake("steady", steady), fake("broken", broken), fake("slow", slow), fake("gone", broken, package="no-x")]
    timings = {(t.method.name, t.level): t for t in benchmark(methods, repeats=4, patience=0.01)}
    assert len(timings) == 3 * 4 + 1
    for level in range(3):
        timing = timings["steady", level]
        assert (timing.error, timing.status) == (10.0**-level, Status.ok)
        assert len(timing.seconds) == len(timing.wall) == 4
        median, low, high = timing.quartiles
        assert low <= median <= high
    assert timings["gone", COLD].status is Status.missing
    # One round is judged and not timed; each first use has a run at the roughest level.
    assert sorted(runs) == [0.0] * 10 + [1.0] * 5 + [2.0] * 5
    assert [timings["broken", level].status for level in range(3)] == [Status.ok, Status.failed, Status.ok]
    assert np.isnan(timings["broken", 1].quartiles).all()
    assert [len(timings["slow", level].seconds) for level in (COLD, 0, 1, 2)] == [1, 1, 0, 0]
    assert timings["slow", 0].quartiles[0] >= 0.02
    assert [timings["slow", level].status for level in (1, 2)] == [Status.missing] * 2


def test_what_is_prepared_is_in_the_first_use_alone():
    def prepare():
        slow(0.0)
        return lambda level: Answer(level)

    timings = benchmark([Method("prepared", prepare, float, (1.0, 0.5))], repeats=3)
    first, *levels = (timing.quartiles[0] for timing in timings)
    assert first >= 0.02 and max(levels) < 0.01
    assert [timing.error for timing in timings[1:]] == [1.0, 0.5]


def test_a_preparation_that_raises_has_failed():
    timings = benchmark([Method("broken", lambda: broken(1.0), float)], repeats=2)
    assert [(timing.level, timing.status, timing.seconds) for timing in timings] == [
        (level, Status.failed, ()) for level in (COLD, 0)
    ]


def timing_of(run, **options):
    """The timing of one method with one level."""
    return benchmark([fake("any", run, (0.0,))], **options)[1]


def test_no_round_begins_after_the_budget():
    assert len(timing_of(slow, repeats=9, patience=9.0, budget=0.0).seconds) == 1
    # A slow first round leaves the budget to the rounds after it.
    pauses = iter([0.2])
    assert len(timing_of(lambda level: time.sleep(next(pauses, 0.0)) or 0.0, repeats=4, budget=0.15).seconds) == 4


@pytest.mark.skipif(not CORES, reason="only Linux keeps a process on a core")
def test_all_runs_are_on_one_core_and_the_others_return():
    within = []
    timing_of(lambda level: within.append(len(os.sched_getaffinity(0))) or 0.0, repeats=1)
    assert within == [1, 1, 1, 1]
    assert os.sched_getaffinity(0) == CORES


def test_times_are_of_the_processor():
    timing = timing_of(lambda level: time.sleep(0.03) or 0.0, repeats=1)
    assert 0 <= timing.quartiles[0] < 0.01 < timing.wall[0]


# Equal errors


def curve(name, points, own=False, preparation=0.0):
    seconds, errors = np.array(points, dtype=float).T
    return curves.Curve(name, own, seconds, seconds, seconds, errors, preparation)


def test_times_are_compared_at_equal_errors():
    """The cheapest setting counts, on both sides, and the rival's preparation in the second ratio alone."""
    default = curve("auto", [(2, 1e-3), (4, 1e-9)], own=True, preparation=6)
    rival = curve("rival", [(1, 0.5), (3, 1e-2), (9, 1e-5), (8, 1e-7)], preparation=12)
    assert curves.ratios(default, rival) == [(1e-2, 1.5, 15 / 8), (1e-4, 2, 2), (1e-6, 2, 2)]
    assert curves.finest(default, rival) == (1e-6, 2, 2)
    # Where the default has no such error the ratio is zero.
    assert curves.ratios(rival, default)[-1] == (1e-8, 0, 0)
    assert curves.finest(rival, default) == (1e-6, 0.5, 0.5)
    assert curves.finest(default, curve("poor", [(1, 0.5)])) is None


@pytest.mark.parametrize(
    "points, preparation, verdict, words",
    [
        ([(4, 1e-9)], 0, "holds", "at least 2 / 2 × (peer, error 1e-08, N_v = 40)"),
        ([(1.9, 1e-9)], 0, "holds", "0.95 / 0.95 ×"),
        ([(1, 1e-9)], 9, "differs", "0.5 / 5 × (peer, error 1e-08, N_v = 40)"),
        ([(4, 1e-11)], 0, "differs", "the default has no such error (peer, error 1e-10, N_v = 40)"),
    ],
)
def test_claims_follow_from_equal_errors(monkeypatch, points, preparation, verdict, words):
    case = "moduli", 40, curve("linear response", [(2, 1e-9)], own=True), [curve("peer", points, False, preparation)]
    monkeypatch.setattr(report, "cases", lambda ds: [case])
    presence = xr.DataArray(np.ones((1, 1, 1)), dims=("task", "n_vertices", "contestant"), coords={"contestant": ["a"]})
    (claim,) = report._speed_claims(xr.Dataset({"presence": presence}))
    assert (claim.key, claim.verdict) == ("speed-moduli", verdict)
    assert words in (claim.because if "no such" in words else claim.value)


# The study

METHODS = (
    *("auto", "newton", "lbfgs", "cone", "solve", "dense Cholesky", "SciPy L-BFGS-B", "pyamg CG", "jax_fdm"),
    *("linear response", "differences of stress"),
)


@pytest.mark.parametrize("word", [word for word in TASKS if not word.endswith("_pinned")])
def test_tasks_name_their_methods(word):
    task = TASKS[word]
    selected = task.methods(min(40, task.sizes[0]), 1)
    names = [method.name for method in selected]
    assert max(len(method.levels) for method in selected) <= len(study.parameters["levels"])
    assert len(names) == len(set(names))
    # Small boxes have edges longer than half of them, which LAMMPS cannot take.
    assert set(names) <= set(task.names)
    assert task.default in names
    assert task.title and task.error


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    folder = tmp_path_factory.mktemp("speed")
    words = [
        "tasks=configuration,gradient,min_V_L,min_V_tau,max_B_0,min_V_L_pinned,moduli,stages",
        "n_vertices=40,2000000", f"contestants={','.join((*METHODS, *STAGES))}", "levels=0,10,20,28", "repeats=1",
        "budget=0.01", "least_time=0.01",
    ]  # fmt: skip
    settings = [part for word in words for part in ("--set", word)]
    assert main(["run", "speed", "--workers", "0", "--out", str(folder), *settings]) == 0
    with xr.open_dataset(folder / "speed.nc") as dataset:
        return dataset.load(), folder


def test_every_point_has_its_time_error_and_outcome(small):
    dataset = small[0].sel(n_vertices=40).drop_sel(task="stages")
    ran = dataset.outcome != Status.missing
    assert (ran == np.isfinite(dataset.error)).all()
    assert (ran == np.isfinite(dataset.seconds)).all()
    assert ((dataset.repeats_done > 0) == ran).all()
    assert (dataset.seconds_low <= dataset.seconds).where(ran, True).all()
    assert (dataset.seconds <= dataset.seconds_high).where(ran, True).all()
    used = ran.any("level")
    assert (dataset.preparation_seconds >= 0).where(used, True).all()
    # A manifold takes longer than a balance.
    one = dataset.sel(task="configuration", contestant="auto")
    assert one.preparation_seconds > one.seconds.min()
    best = dataset.error.sel(contestant="auto").min("level")
    limits = {
        "configuration": 1e-12, "gradient": 1e-12, "min_V_L": 1e-12, "min_V_tau": 1e-8, "max_B_0": 1e-13,
        "min_V_L_pinned": 1e-12,
    }  # fmt: skip
    for word, limit in limits.items():
        assert 0 <= float(best.sel(task=word)) < limit, word
    # Tighter tolerances leave smaller errors.
    assert (dataset.error.sel(contestant="newton", task="min_V_tau").diff("level") < 0).all()


def test_it_has_its_charts_claims_and_ratios(small, assert_picture):
    dataset, folder = small
    for name in ("speed", "sizes"):
        assert_picture(folder / "figures" / f"{name}.png", 20_000)
    claims = {claim["key"]: claim for claim in json.loads((folder / "claims.json").read_text())}
    words = set(dataset.task.values) - {"stages"}
    assert {f"speed-{word}" for word in words - {"moduli"}} < set(claims)
    assert claims["speed-default"]["verdict"] in ("holds", "differs")
    tasks = json.loads((folder / "summary.json").read_text())["tasks"]
    assert set(tasks) == words
    peer = tasks["min_V_tau"]["sizes"]["40"]["others"]["SciPy L-BFGS-B"]
    assert all(warm > 0 and cold > 0 for warm, cold in peer.values())


# Stages


def test_every_stage_is_timed_and_ends_well(small):
    stages = sizes.stages_of(small[0])
    assert list(stages.n_vertices) == [40]
    assert (stages.seconds < 60).all() and (stages.wall_seconds > 0).all()
    assert (stages.memory > 10).all() and (stages.memory < 1e5).all()
    assert (stages.outcome == Status.ok).all()
    # Repeated until the least time is spent.
    assert (stages.repeats_done.sel(contestant="gradient") > 1).all()
    checked = ["configuration", "gradient", "checked", "optimum", "moduli", "coefficients"]
    assert (stages.error.sel(contestant=checked) < 1e-11).all()
    assert (stages.error.sel(contestant="optimum") < 1e-13).all()
    assert (stages.backend.sel(contestant=["points", "tessellation"]) == 0).all()
    assert (stages.backend.sel(contestant=["configuration", "coefficients"]) > 0).all()


def test_the_symbolic_analysis_is_timed_as_such(monkeypatch):
    """At 10⁵ vertices it takes longer than a configuration, which is timed only once there."""
    running, analysed = [], []
    watch = stages.stopwatch

    def watched(work, *arguments):
        running.append(work.__name__)
        return watch(work, *arguments)

    monkeypatch.setattr(stages, "stopwatch", watched)
    for name, backend in list(BACKENDS.items()):  # a solver begins with its analysis
        noted = lambda matrix, backend=backend: analysed.append(running[-1]) or backend(matrix)  # noqa: E731
        monkeypatch.setitem(BACKENDS, name, noted)
    stages.measured(40, 0, 0.0)
    assert analysed[0] == "_analysed" and not {"balance", "solve"} & set(analysed)


@pytest.mark.parametrize(
    "power, memory, differ",
    [(0.8, 1000.0, set()), (1.1, 9000.0, {"memory", "generation"}), (1.3, 1000.0, {"configuration", "generation"})],
)
def test_claims_on_sizes_are_judged_by_what_is_required(small, power, memory, differ):
    """As if the networks had 10⁴ and 10⁶ vertices and the times grew with a power of that."""
    one = small[0].sel(n_vertices=[40])
    dataset = xr.concat([one, one], "n_vertices", data_vars="all").assign_coords(n_vertices=[10_000, 1_000_000])
    for name in ("seconds", "wall_seconds"):
        dataset[name].loc[{"task": "stages", "n_vertices": 10_000}] = 0.1
        dataset[name].loc[{"task": "stages", "n_vertices": 1_000_000}] = 0.1 * 100**power
    dataset.memory.loc[{"task": "stages"}] = memory
    assert sizes.fitted(sizes.stages_of(dataset), "configuration") == pytest.approx(power, rel=1e-12)
    claims = {claim.key.removeprefix("Scale-"): claim for claim in sizes.size_claims(dataset)}
    assert {key for key, claim in claims.items() if claim.verdict == "differs"} == differ
    assert {"memory", "generation", "configuration", "status", "certificate"} <= claims.keys()
    assert sizes.sizes_figure(dataset).axes
