"""Stop a run at any step, by any means, and run it again: the data equal those of an undisturbed run."""

import itertools
import os
from pathlib import Path

import pytest
from disturbed import SIGNALS, begun, contents_of, ended, messages, stamps_of, stored_whole, words_of

from critflow.command.main import main

pytestmark = pytest.mark.timeout(300)

FEW = ("seeds=0:2",)


@pytest.fixture(scope="module")
def golden(tmp_path_factory):
    """The folder of an undisturbed run."""
    folder = tmp_path_factory.mktemp("golden") / "out"
    assert ended(begun(folder, FEW)) == 0, messages(folder)
    return folder


@pytest.fixture
def assert_resumed(golden, tally):
    """`assert_resumed(folder, label)`: the same command completes the folder and recomputes no stored case."""

    def check(folder, label):
        whole, before = stored_whole(folder, FEW), stamps_of(folder)
        assert set(before) == whole, label  # nothing partial has the name of a stored case
        tally()
        assert main(words_of(folder, FEW)) == 0, label
        assert before.items() <= stamps_of(folder).items(), label
        assert len(tally()) == len(stored_whole(folder, FEW)) - len(whole), label
        assert contents_of(folder / "plain.nc") == contents_of(golden / "plain.nc"), label
        for name in ("claims.md", "claims.json", "summary.json"):
            assert (folder / name).read_bytes() == (golden / name).read_bytes(), label
        assert sorted(os.listdir(folder)) == sorted(os.listdir(golden)), label
        assert not list(folder.rglob("*.partial")), label

    return check


@pytest.mark.parametrize(
    ("action", "stride"),
    [
        *((action, 13) for action in ("kill", "terminate", "interrupt", "full")),
        *(
            pytest.param(action, stride, marks=pytest.mark.sweep)
            for action, stride in (("kill", 1), ("terminate", 5), ("interrupt", 5), ("full", 3))
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
        assert_resumed(folder, f"step {step}")
    assert len(seen) > 40 // stride
    assert {"kill": -9, "terminate": 130, "interrupt": 130, "full": 6}[action] in seen
