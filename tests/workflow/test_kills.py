"""Stop a run at any step, by any means, and run it again: the data equal those of an undisturbed run."""

import itertools
import os
import signal
import time
from pathlib import Path

import psutil
import pytest
from disturbed import SIGNALS, begun, contents_of, ended, messages, stamps_of, stored_whole, words_of

from critflow.command.main import main

pytestmark = pytest.mark.timeout(300)

FEW = ("seeds=0:2",)


@pytest.fixture(scope="module")
def golden(tmp_path_factory):
    """Folders of undisturbed runs, by their settings."""
    folders = {settings: tmp_path_factory.mktemp("golden") / "out" for settings in ((), FEW)}
    for settings, folder in folders.items():
        assert ended(begun(folder, settings)) == 0, messages(folder)
    return folders


@pytest.fixture
def assert_resumed(golden, tally):
    """`assert_resumed(folder, settings)`: the same command completes the folder and recomputes no stored case."""

    def check(folder, settings=(), label=""):
        whole, before = stored_whole(folder, settings), stamps_of(folder)
        assert set(before) == whole, label  # nothing partial has the name of a stored case
        tally()
        assert main(words_of(folder, settings)) == 0, label
        assert before.items() <= stamps_of(folder).items(), label
        assert len(tally()) == len(stored_whole(folder, settings)) - len(whole), label
        right = golden[settings]
        assert contents_of(folder / "plain.nc") == contents_of(right / "plain.nc"), label
        for name in ("claims.md", "claims.json", "summary.json"):
            assert (folder / name).read_bytes() == (right / name).read_bytes(), label
        assert sorted(os.listdir(folder)) == sorted(os.listdir(right)), label
        assert not list(folder.rglob("*.partial")), label

    return check


@pytest.mark.parametrize(
    ("action", "stride"),
    [
        ("kill", 5),
        ("terminate", 5),
        ("interrupt", 13),
        ("full", 7),
        *(
            pytest.param(action, stride, marks=pytest.mark.sweep)
            for action, stride in (("kill", 1), ("interrupt", 5), ("full", 3))
        ),
    ],
)
def test_a_run_disturbed_at_any_step_is_resumed(tmp_path, assert_resumed, action, stride):
    """A process killed, asked to end, or refused disk space at the n-th step, for every n."""
    number = -SIGNALS.get(action, 0)
    allowed = {"kill": {number}, "terminate": {number, 130, 0}, "interrupt": {130, 0}, "full": {6}}[action]
    seen = []
    for step in itertools.count(1, stride):
        folder = tmp_path / f"{step}" / "out"
        folder.parent.mkdir()
        code, said = ended(begun(folder, FEW, step=step, action=action)), messages(folder)
        steps = Path(f"{folder}.steps")
        if steps.exists() and int(steps.read_text()) < step:
            break  # the run completed before this step
        assert code in allowed, f"step {step}: {code}\n{said}"
        assert "Traceback" not in said, f"step {step}:\n{said}"
        assert action != "full" or not list(folder.rglob("*.partial")), f"step {step}"
        seen.append(code)
        assert_resumed(folder, FEW, f"step {step}")
    assert len(seen) > 40 // stride
    assert {"kill": -9, "terminate": 130, "interrupt": 130, "full": 6}[action] in seen


def is_worker(process):
    """Whether a process, which may have ended since it was listed, is a worker of dask."""
    try:
        return "spawn_main" in " ".join(process.cmdline())
    except psutil.NoSuchProcess:  # ZombieProcess is one
        return False


@pytest.mark.sweep
def test_a_run_with_workers_survives_the_death_of_one_and_its_own(tmp_path, assert_resumed, start):
    """One worker process is killed; then the command itself, which leaves no process behind."""
    folder = tmp_path / "out"
    process = start(folder, workers=2, study="plain", environment={"CRITFLOW_TEST_PAUSE": "1.5"})
    command = psutil.Process(process.pid)
    workers = []
    while len(workers) < 2 or not list((folder / "shards").glob("*.nc")):
        assert process.poll() is None, process.communicate()
        workers = [child for child in command.children(recursive=True) if is_worker(child)]
        time.sleep(0.01)
    workers[0].kill()
    stored = len(stamps_of(folder))
    while len(stamps_of(folder)) == stored:
        assert process.poll() is None, process.communicate()
        time.sleep(0.01)
    family = command.children(recursive=True)
    process.send_signal(signal.SIGKILL)
    process.communicate()
    assert psutil.wait_procs(family, timeout=60)[1] == []
    assert_resumed(folder)
