"""Speed against accuracy: how methods are timed and judged, how fronts are read, and the study end to end, small.

No test asks how long anything took on this machine.
"""

import json
import os
import time

import numpy as np
import pytest
import xarray as xr

from critflow import CriticalManifold, voronoi_network
from critflow.command.main import main
from critflow.engine.code_digest import load_study
from critflow.result import Status
from critflow.sparse import BACKENDS
from workflows.benchmarks.speed import charts, curves, report, sizes, stages
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
    timings = {(t.method.name, t.level): t for t in benchmark(methods, patience=0.01)}
    for level in range(3):
        timing = timings["steady", level]
        assert (timing.error, timing.status) == (10.0**-level, Status.ok)
        assert len(timing.seconds) == len(timing.wall) == 1
    assert timings["gone", COLD].status is Status.missing
    # Each first use has a run at the roughest level.
    assert sorted(runs) == [0.0, 0.0, 1.0, 2.0]
    # A sweep ends at a level that is not reached.
    assert [timings["broken", level].status for level in range(2)] == [Status.ok, Status.failed]
    assert timings["slow", 0].seconds[0] >= 0.02
    assert timings["slow", 1].status is Status.step_limit and timings["slow", 1].seconds == ()
    assert not {("broken", 2), ("slow", 2), ("gone", 0)} & timings.keys()


def test_short_runs_are_repeated():
    timing = benchmark([fake("short", abs, (0.0,))], least=0.005)[1]
    assert len(timing.seconds) > 9 and sum(timing.seconds) >= 0.005


def test_what_is_prepared_is_in_the_first_use_alone():
    def prepare():
        slow(0.0)
        return lambda level: Answer(level)

    first, *levels = benchmark([Method("prepared", prepare, float, (1.0, 0.5))])
    assert first.seconds[0] >= 0.02 and max(timing.seconds[0] for timing in levels) < 0.01
    assert [timing.error for timing in levels] == [1.0, 0.5]


def test_a_preparation_that_raises_has_failed():
    timings = benchmark([Method("broken", lambda: broken(1.0), float)])
    assert [(timing.level, timing.status, timing.seconds) for timing in timings] == [
        (level, Status.failed, ()) for level in (COLD, 0)
    ]


def timing_of(run, **options):
    """The timing of one method with one level."""
    return benchmark([fake("any", run, (0.0,))], **options)[1]


def test_calls_are_counted_in_the_timed_run_alone():
    manifold = CriticalManifold(voronoi_network(40, 1))
    timing = timing_of(lambda level: manifold.balance(np.ones(60)).bond_vectors[0, 0])
    assert timing.calls == {"factorisations": 1, "solves": 1}
    manifold.balance(np.ones(60))
    assert timing.calls == {"factorisations": 1, "solves": 1}


@pytest.mark.skipif(not CORES, reason="only Linux keeps a process on a core")
def test_all_runs_are_on_one_core_and_the_others_return():
    within = []
    timing_of(lambda level: within.append(len(os.sched_getaffinity(0))) or 0.0)
    assert within == [1, 1]
    assert os.sched_getaffinity(0) == CORES


def test_times_are_of_the_processor():
    timing = timing_of(lambda level: time.sleep(0.03) or 0.0)
    assert 0 <= timing.seconds[0] < 0.01 < timing.wall[0]


# Equal errors


def curve(name, points, own=False, preparation=0.0):
    """A method in one network."""
    seconds, errors = np.array(points, dtype=float).T[:, None]
    return curves.Curve(name, own, seconds, seconds, errors, np.zeros(seconds.shape), np.array([preparation]))


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


def test_a_cost_is_that_of_most_networks_and_a_failure_is_silent_or_not():
    seconds, errors = np.array([[1.0, 2], [1, 4], [1, 9]]), np.array([[1, 1e-3], [1, 1e-3], [1, 1]])
    outcomes = np.array([[0, 0], [0, 0], [Status.ok, Status.stalled]])
    one = curves.Curve("any", False, seconds, 10 * seconds, errors, outcomes, np.zeros(3))
    assert list(one.costs(1e-2)) == [2, 4, np.inf] and curves.middle(one.costs(1e-2)) == 4
    assert list(one.costs(1e-2, "calls")) == [20, 40, np.inf]
    assert not one.wrong(1e-2).any()
    outcomes[2, 1] = Status.ok
    assert list(one.wrong(1e-2)) == [False, False, True]
    time, calls, gave_up, wrong, networks = curves._approach(one)
    assert list(time) == [3, 2.5, 3.5] and list(calls) == [30, 25, 35]
    assert (gave_up, wrong, networks) == (0, 1, 3)


def test_a_network_that_ends_before_a_level_counts_as_slower():
    seconds = np.array([[1.0, 2.0, 3.0], [1.1, np.nan, np.nan], [1.2, 2.2, np.nan]])
    errors = np.where(np.isnan(seconds), np.inf, 1e-3 / np.nan_to_num(seconds, nan=1.0))
    one = curves.Curve("any", True, seconds, seconds, errors, np.zeros((3, 3), int), np.zeros(3))
    assert report.points(one) == [[1.1, 0.000909], [2.2, 0.0005]]


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
    case = (
        "moduli",
        40,
        1e-3,
        curve("linear response", [(2, 1e-9)], own=True),
        [curve("peer", points, False, preparation)],
    )
    monkeypatch.setattr(report, "cases", lambda ds: [case])
    presence = xr.DataArray(
        np.ones((1, 1, 1, 1)), dims=("task", "n_vertices", "seed", "contestant"), coords={"contestant": ["a"]}
    )
    (claim,) = report._speed_claims(xr.Dataset({"presence": presence}))
    assert (claim.key, claim.verdict) == ("speed-moduli", verdict)
    assert words in (claim.because if "no such" in words else claim.value)


# The study

METHODS = (
    *("auto", "newton", "lbfgs", "cone", "SciPy dense Cholesky", "SciPy L-BFGS-B", "pyamg CG", "jax_fdm"),
    *("linear response", "differences of stress", "Newton", "FIRE", "LAMMPS cg"),
)


@pytest.mark.parametrize("word", [word for word in TASKS if not word.endswith("_pinned")])
def test_tasks_name_their_methods(word):
    task = TASKS[word]
    selected = task.methods(min(40, task.sizes[0]), 1, 1e-3)
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
        "tasks=configuration,min_V_L,min_V_tau,max_B_0,min_V_L_pinned,strain_step,moduli,stages",
        "n_vertices=40,2000000", "seeds=0:2", f"contestants={','.join((*METHODS, *STAGES))}", "levels=0,2,4,5",
        "gammas=0,0.000001,0.001", "least_run=1e-9", "least_time=0.01",
    ]  # fmt: skip
    settings = [part for word in words for part in ("--set", word)]
    assert main(["run", "speed", "--workers", "0", "--out", str(folder), *settings]) == 0
    with xr.open_dataset(folder / "speed.nc") as dataset:
        return dataset.load(), folder


def test_every_point_has_its_time_error_calls_and_outcome(small):
    dataset = small[0].sel(n_vertices=40).drop_sel(task="stages")
    ran = np.isfinite(dataset.seconds)
    assert ((dataset.outcome == Status.ok) <= ran).all() and ran.any(("seed", "contestant", "gamma", "level")).all()
    assert (dataset.preparation_seconds >= 0).where(ran.any("level"), True).all()
    calls = dataset.factorisations + dataset.solves + dataset.evaluations
    assert ((calls > 0) == ran).sel(contestant=["auto", "Newton", "FIRE", "SciPy L-BFGS-B", "linear response"]).all()
    # Tasks past the transition are at each γ, the others at the transition.
    strained = ran.any(("seed", "contestant", "level"))
    past = [word for word, task in TASKS.items() if task.strained]
    assert (strained == (np.isin(strained.task, past)[:, None] == (strained.gamma.values > 0))).all()
    # A manifold takes longer than a balance.
    one = dataset.sel(task="configuration", contestant="auto", gamma=0)
    assert (one.preparation_seconds > one.seconds.min("level")).all()
    best = dataset.error.min("level").max("seed")
    limits = {
        "configuration": 1e-12, "min_V_L": 1e-12, "min_V_tau": 1e-7, "max_B_0": 1e-13, "min_V_L_pinned": 1e-7,
    }  # fmt: skip
    for word, limit in limits.items():
        assert 0 <= float(best.sel(task=word, contestant="auto", gamma=0)) < limit, word
    assert (best.sel(task="strain_step", contestant="Newton", gamma=[1e-6, 1e-3]) < 1e-8).all()


def test_it_has_its_charts_claims_and_ratios(small, assert_picture):
    dataset, folder = small
    for name in ("speed", "sizes"):
        assert_picture(folder / "figures" / f"{name}.png", 20_000)
    claims = {claim["key"]: claim for claim in json.loads((folder / "claims.json").read_text())}
    words = set(dataset.task.values) - {"stages"}
    assert {f"speed-{word}" for word in words - {"moduli"}} < set(claims)
    assert claims["speed-default"]["verdict"] in ("holds", "differs")
    assert claims["gamma-strain_step"]["verdict"] == "holds"
    summary = json.loads((folder / "summary.json").read_text())
    assert set(summary["tasks"]) == words
    peer = summary["tasks"]["min_V_tau"]["sizes"]["40"]["others"]["SciPy L-BFGS-B"]
    assert all(warm > 0 and cold > 0 for warm, cold in peer.values())
    assert summary["gamma"]["gamma"] == [1e-6, 1e-3]
    newton, fire = (summary["gamma"]["tasks"]["strain_step"][name] for name in ("Newton", "FIRE"))
    assert newton["gave_up"] == newton["wrong"] == [0, 0] and fire["gave_up"][0] + fire["wrong"][0] == 2
    assert fire["calls_median"][0] > 100 * newton["calls_median"][0]
    profile = summary["profile"]["1e-08"]
    assert profile["critflow"]["solved"] == profile["critflow"]["problems"] > profile["FIRE"]["solved"]


def test_the_title_states_what_the_chart_shows(small):
    dataset = small[0]
    figure = charts.overview_figure(dataset)
    assert "no other method" in figure.get_suptitle()
    # Not where the default fails too.
    poor = dataset.copy(deep=True)
    poor.error.loc[{"contestant": "Newton"}] = 1.0
    assert "lower left is better" in charts.overview_figure(poor).get_suptitle()
    assert charts.overview_figure(dataset.sel(task=["stages"])).axes


# Stages


def test_every_stage_is_timed_and_ends_well(small):
    stages = sizes.stages_of(small[0])
    assert list(stages.n_vertices) == [40]
    assert (stages.seconds < 60).all() and (stages.wall_seconds > 0).all()
    assert (stages.memory > 10).all() and (stages.memory < 1e5).all()
    assert (stages.outcome == Status.ok).all()
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
