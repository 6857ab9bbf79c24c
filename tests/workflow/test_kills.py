"""Kill anything at any moment and run again: the data are those of a run that nobody disturbed."""

import itertools
import os
import random
import signal
import time

import pytest
from killing import BARE, begun, ended

from critflow.cli import main
from critflow.workflow import faults
from critflow.workflow.load import load_file
from critflow.workflow.plan import select
from critflow.workflow.store import read_shard

pytestmark = pytest.mark.timeout(300)

FILES = ("study.json", "seed1-*", "bare.nc", "claims.md")
STORE = [f"{point}@{file}" for point in faults.POINTS if point.startswith("store.") for file in FILES]
STORED = [place for place in STORE if place.endswith(("seed1-*", "bare.nc"))]
ENGINE = [point for point in faults.POINTS if not point.startswith("store.")]


SLOWER = "pause=0.02"  # so that most of the time cases are computed


@pytest.fixture(scope="module")
def golden(tmp_path_factory):
    """The folder of an undisturbed run."""
    folder = tmp_path_factory.mktemp("golden") / "bare"
    assert ended(begun(folder)) == 0
    return folder


@pytest.fixture(scope="module")
def slower_golden(golden):
    """The same with slower cases."""
    folder = golden.with_name("slower")
    assert ended(begun(folder, SLOWER)) == 0
    return folder


@pytest.fixture
def assert_resumed(contents, stamps):
    """`assert_resumed(folder, golden)` runs the same again: what was whole stays, and all ends like the golden run."""

    def assert_same(folder, golden, *settings):
        study = load_file(BARE).study
        cases = select(study, settings).cases()
        whole = {f"{case.id}.nc" for case in cases if read_shard(folder / "shards", study, case) is not None}
        before = stamps(folder)
        assert set(before) == whole  # nothing partial has the name of a shard
        words = ["run", str(BARE), "--out", str(folder), *(f"--set={word}" for word in settings), "--workers=0"]
        assert main(words) == 0
        assert before.items() <= stamps(folder).items()
        assert contents(folder / "bare.nc") == contents(golden / "bare.nc")
        for name in ("claims.md", "claims.json", "summary.json"):
            assert (folder / name).read_bytes() == (golden / name).read_bytes()
        assert not list(folder.rglob(".*.partial"))
        assert sorted(os.listdir(folder)) == sorted(os.listdir(golden))

    return assert_same


@pytest.mark.parametrize("point", [*STORE, *ENGINE])
def test_killed_at_any_point_and_run_again(tmp_path, assert_resumed, golden, point):
    folder = tmp_path / "out"
    assert ended(begun(folder, fault=f"{point} kill")) == -signal.SIGKILL
    assert_resumed(folder, golden)


@pytest.mark.parametrize("point", [*STORED, *ENGINE])
def test_asked_to_stop_at_any_point_and_run_again(tmp_path, assert_resumed, golden, point):
    """While cases are computed the run stops in good order; elsewhere it just ends."""
    folder = tmp_path / "out"
    computing = point.endswith("@seed1-*") or point.startswith(("case.", "batch.", "run.logged"))
    assert ended(begun(folder, fault=f"{point} term")) == (130 if computing else -signal.SIGTERM)
    assert_resumed(folder, golden)


@pytest.mark.parametrize("point", [*STORED, "merge.slab", "run.planned"])
def test_an_error_of_the_disk_at_any_point_and_run_again(tmp_path, assert_resumed, golden, point):
    folder = tmp_path / "out"
    assert ended(begun(folder, fault=f"{point} raise")) == 6
    assert "Traceback" not in (tmp_path / "out.err").read_text()
    assert_resumed(folder, golden)


def test_the_log_tells_all_but_the_batch_that_was_killed(tmp_path):
    folder = tmp_path / "out"
    assert ended(begun(folder, fault="run.logged kill 3")) == -signal.SIGKILL
    told = [line.split()[0] for line in (folder / "run.log").read_text().splitlines() if not line.startswith("#")]
    assert told == [case.id for batch in itertools.islice(select(load_file(BARE).study).batches(), 2) for case in batch]


def test_every_nth_shard(tmp_path, assert_resumed, golden):
    """Killed at the second of the shards that are left, again and again."""
    folder, runs = tmp_path / "out", 1
    while ended(begun(folder, fault="store.half@seed* kill 2")) == -signal.SIGKILL:
        runs += 1
    assert runs == 8
    assert_resumed(folder, golden)


@pytest.mark.parametrize("kills", [1] * 20 + [2] * 5)
def test_killed_at_a_random_time_and_run_again(tmp_path, assert_resumed, request, slower_golden, kills):
    """A while after a random one of its eight shards, so that a busy machine is not killed at its beginning alone."""
    dice, folder = random.Random(request.node.name), tmp_path / "out"

    def stored():
        return len(list(folder.glob("shards/*.nc")))

    for _ in range(kills):
        process, enough = begun(folder, SLOWER), dice.randint(stored(), 8)
        while stored() < enough and process.exitcode is None:
            time.sleep(0.001)
        time.sleep(dice.uniform(0.0, 0.05))
        process.kill()
        ended(process)
    assert_resumed(folder, slower_golden, SLOWER)


@pytest.mark.parametrize("kind", ["kill", "term"])
def test_workers_killed_at_every_point_cost_nothing(tmp_path, golden, contents, kind):
    """Each point ends a worker once, on a case of its own; the same run brings everything to its end."""
    points = [point for point in faults.POINTS if point.startswith(("store.", "case.", "batch."))]
    cases = [f"{case.id}*" for case in select(load_file(BARE).study).cases()]
    places = zip(points, [*cases, cases[0], "*"], strict=True)  # one case more would be set aside in its third death
    armed = [f"{point}@{about} {kind} 1 {tmp_path}/{point}" for point, about in places]
    process = begun(tmp_path / "out", fault=";".join(armed), more=("--workers=2",))
    assert ended(process, 250.0) == 0, (tmp_path / "out.err").read_text()
    assert {path.name for path in tmp_path.iterdir()} == {*points, "out", "out.err"}
    assert contents(tmp_path / "out" / "bare.nc") == contents(golden / "bare.nc")


def test_a_fault_that_nobody_knows_is_refused():
    with pytest.raises(ValueError, match="nowhere kill"):
        faults.Fault("nowhere", "*", "kill")
