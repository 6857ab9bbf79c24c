"""Speed against accuracy: how methods are timed and judged, how fronts are read, and the study end to end, small.

No test asks how long anything took on this machine.
"""

import json
import os
import time

import numpy as np
import pytest
import xarray as xr

from critflow import CriticalManifold, critical_from_lengths, voronoi_network
from critflow.command.main import main
from critflow.linalg.factor import FixedPattern
from critflow.result import Status
from critflow.workflow.load import load_study
from workflows.benchmarks.speed import curves, sizes, stages
from workflows.benchmarks.speed.lengths import error_of_stress
from workflows.benchmarks.speed.references import stress_of_lengths
from workflows.benchmarks.speed.stages import STAGES
from workflows.benchmarks.speed.tasks import TASKS
from workflows.benchmarks.timing import Answer, Method, benchmark

study = load_study("speed").study

CORES = os.sched_getaffinity(0) if hasattr(os, "sched_getaffinity") else set()

# Timing


def fake(name, run, levels=(0.0, 1.0, 2.0), **more):
    return Method(name, lambda level: Answer(run(level), iterations=3), lambda values: values, levels, **more)


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
    assert len(timings) == 12
    for level in range(3):
        timing = timings["steady", level]
        assert (timing.error, timing.status, timing.iterations) == (10.0**-level, Status.ok, 3)
        assert len(timing.seconds) == len(timing.wall) == 4
        median, low, high = timing.quartiles
        assert low <= median <= high
        assert timings["gone", level].status is Status.missing
    # One round is judged and not timed.
    assert sorted(runs) == [0.0] * 5 + [1.0] * 5 + [2.0] * 5
    assert [timings["broken", level].status for level in range(3)] == [Status.ok, Status.failed, Status.ok]
    assert np.isnan(timings["broken", 1].quartiles).all()
    assert [len(timings["slow", level].seconds) for level in range(3)] == [1, 0, 0]
    assert timings["slow", 0].quartiles[0] >= 0.02
    assert [timings["slow", level].status for level in (1, 2)] == [Status.missing] * 2


def timing_of(run, **options):
    """The timing of one method with one level."""
    (timing,) = benchmark([fake("any", run, (0.0,))], **options)
    return timing


def test_no_round_begins_after_the_budget():
    assert len(timing_of(slow, repeats=9, patience=9.0, budget=0.0).seconds) == 1
    # A slow first round leaves the budget to the rounds after it.
    pauses = iter([0.2])
    assert len(timing_of(lambda level: time.sleep(next(pauses, 0.0)) or 0.0, repeats=4, budget=0.15).seconds) == 4


@pytest.mark.skipif(not CORES, reason="only Linux keeps a process on a core")
def test_all_runs_are_on_one_core_and_the_others_return():
    within = []
    timing_of(lambda level: within.append(len(os.sched_getaffinity(0))) or 0.0, repeats=1)
    assert within == [1, 1]
    assert os.sched_getaffinity(0) == CORES


def test_times_are_of_the_processor():
    timing = timing_of(lambda level: time.sleep(0.03) or 0.0, repeats=1)
    assert 0 <= timing.quartiles[0] < 0.01 < timing.wall[0]


# Reading fronts


def curve(name, points, own=True, cut=False):
    seconds, errors = np.array(points, dtype=float).T
    return curves.Curve(name, own, cut, seconds, seconds, seconds, errors, np.arange(len(errors)))


def test_the_front_is_what_no_point_beats():
    rng = np.random.default_rng(1)
    for _ in range(50):
        # Few values, so that there are ties.
        seconds, errors = rng.integers(1, 6, (2, 12)).astype(float)
        front = curves.pareto_front(seconds, errors)
        points = set(zip(seconds, errors, strict=True))
        beaten = {p for p in points if any(q != p and q[0] <= p[0] and q[1] <= p[1] for q in points)}
        assert [(seconds[n], errors[n]) for n in front] == sorted(points - beaten)


@pytest.mark.parametrize(
    "own, rival, ratios",
    [
        ([(1, 1e-9)], [(2, 1e-4), (8, 1e-8)], [0.5, 0.125]),
        ([(1, 1e-4), (9, 1e-9)], [(3, 1e-6)], [3.0]),
        # Within a digit of the best is as good as the best; further away is not.
        ([(1, 5e-9)], [(2, 1e-9)], [0.5]),
        ([(1, 5e-8)], [(2, 1e-9)], [np.inf]),
        # A digit is not given away where one's best is better.
        ([(1, 5e-9), (4, 1e-12)], [(2, 1e-9)], [2.0]),
        # Points below the better ones of the same method, and failures, do not count.
        ([(1, 1e-9)], [(0.1, 0.5), (2, 1e-8), (3, 1e-7)], [0.5]),
    ],
)
def test_how_far_one_is_behind_another(own, rival, ratios):
    found, _ = curves.behind([curve("own", own)], [curve("rival", rival, own=False)], 1e-2)
    np.testing.assert_allclose(found, ratios, rtol=1e-12)


def test_a_method_whose_finer_levels_were_cut_is_not_behind():
    rival = curve("rival", [(3, 1e-5), (4, 1e-15)], own=False)
    for cut, ratios in ((False, [1 / 3, np.inf]), (True, [1 / 3])):
        found, points = curves.behind([curve("own", [(1, 1e-9)], cut=cut)], [rival], 1e-2)
        np.testing.assert_allclose(found, ratios, rtol=1e-12)
        assert [n for _, n in points] == [0, 1][: len(ratios)]


def test_a_choice_is_measured_at_every_accuracy_that_it_reaches():
    chosen, other = curve("auto", [(4, 1e-12)]), curve("lbfgs", [(1, 1e-4), (3, 1e-7), (9, 1e-15)])
    assert curves.detour(chosen, [chosen, other], 1e-2) == 4.0
    assert curves.detour(other, [chosen, other], 1e-2) == pytest.approx(9 / 4)
    # Errors above the useful one do not count.
    assert curves.detour(chosen, [chosen, other], 1e-6) == pytest.approx(4 / 3)
    assert curves.gain(chosen, other) == 0.0
    assert curves.fastest([chosen, other], 1e-5) == (3, 1) and curves.fastest([other], 1e-20) == (np.inf, 0)
    assert curves.gain(other, chosen) == pytest.approx(4 / 9)


def test_stresses_of_rest_lengths_are_compared_without_their_scale():
    manifold = CriticalManifold(voronoi_network(16, 3))
    lengths = 1 + 0.05 * np.random.default_rng(1).standard_normal(24)
    error = error_of_stress(stress_of_lengths(manifold, lengths))
    found = critical_from_lengths(manifold, lengths).value.sigma
    assert error(7 * found) < 1e-12
    worse = found.copy()
    worse[5] += 1e-6 * found.mean()
    # The comparison of scales returns a part of one edge in 24.
    assert error(worse) == pytest.approx(1e-6, rel=0.3)


# The study

METHODS = (
    *("auto", "newton", "lbfgs", "cone", "solve", "dense Cholesky", "SciPy L-BFGS-B", "pyamg CG", "jax_fdm"),
    *("exact", "line through 16", "closed form", "linear response at γ → 0"),
)


@pytest.mark.parametrize("word", [word for word in TASKS if not word.endswith("pinned")])
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
        "tasks=configuration,gradient,length_variance,tension_variance,bulk_modulus,rest_lengths,length_variance_pinned,"
        "coefficients,transition_moduli,stages",
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
    best = dataset.error.sel(contestant="auto").min("level")
    limits = {
        "configuration": 1e-12, "gradient": 1e-12, "length_variance": 1e-24, "tension_variance": 1e-8,
        "bulk_modulus": 1e-28, "rest_lengths": 1e-12, "length_variance_pinned": 1e-24,
    }  # fmt: skip
    for word, limit in limits.items():
        assert 0 <= float(best.sel(task=word)) < limit, word
    # Tighter tolerances leave smaller errors.
    newton = dataset.error.sel(contestant="newton", task="tension_variance")
    assert (newton.diff("level") < 0).all()
    assert dataset.iterations.sel(contestant="newton", task="tension_variance").diff("level").min() > 0


def test_it_has_its_charts_claims_and_fronts(small, assert_picture):
    dataset, folder = small
    for name in ("speed", "sizes"):
        assert_picture(folder / "figures" / f"{name}.png", 20_000)
    claims = {claim["key"]: claim for claim in json.loads((folder / "claims.json").read_text())}
    words = set(dataset.task.values) - {"stages"}
    assert {f"speed-accuracy-{word}" for word in words} < set(claims)
    assert claims["speed-accuracy-auto"]["verdict"] in ("holds", "differs")
    tasks = json.loads((folder / "summary.json").read_text())["tasks"]
    assert set(tasks) == words
    for of_task in tasks.values():
        assert of_task["sizes"]["40"]["auto_over_front"] >= 1


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
    assert (stages.error.sel(contestant="optimum") < 1e-13).all() and (stages.change_by_refinement < 1e-12).all()
    assert (stages.backend.sel(contestant=["points", "tessellation"]) == 0).all()
    assert (stages.backend.sel(contestant=["configuration", "coefficients"]) > 0).all()


def test_the_symbolic_analysis_is_timed_as_such(monkeypatch):
    """At 10⁵ vertices it takes longer than a configuration, which is timed only once there."""
    running, analysed = [], []
    add, watch = FixedPattern._add, stages.stopwatch

    def watched(work, *arguments):
        running.append(work.__name__)
        return watch(work, *arguments)

    monkeypatch.setattr(stages, "stopwatch", watched)
    monkeypatch.setattr(FixedPattern, "_add", lambda self, solver: analysed.append(running[-1]) or add(self, solver))
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
