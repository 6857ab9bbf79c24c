"""A results folder under any order of events, against a plain model of what must be in it.

`CRITFLOW_SOAK=5000 pytest tests/workflow/test_folder_machine.py` looks at that many examples instead of a hundred.
"""

import os
import shutil
import tempfile
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from hypothesis import HealthCheck, Phase, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule
from in_memory import merge

from critflow.result import IntegrityError, Status
from critflow.workflow import run as engine
from critflow.workflow import store
from critflow.workflow.errors import Interrupted
from critflow.workflow.folder import Folder
from critflow.workflow.load import load_file
from critflow.workflow.plan import Selection
from critflow.workflow.status import folder_status

LOADED = load_file(Path(__file__).with_name("plain_study.py"))
SEEDS = st.lists(st.integers(0, 4), min_size=1, max_size=4, unique=True)
BROKEN, STOPPED = (LOADED.study.case.__globals__[name] for name in ("broken", "stopped"))


class Killed(BaseException):
    """The death of the process, as far as one process can play it."""


class FolderMachine(RuleBasedStateMachine):
    """What is stored of each case is known from what was done, never from the folder."""

    @initialize(seeds=SEEDS)
    def begin(self, seeds):
        base = "/dev/shm" if os.path.isdir("/dev/shm") else None
        self.folder = Folder(Path(tempfile.mkdtemp(dir=base)))
        self.axes, self.parameters = tuple(seeds), dict(LOADED.study.parameters)
        self.good: set[str] = set()  # cases stored whole
        self.failed: set[str] = set()  # cases stored as failed
        self.damaged: set[str] = set()
        self.noted = None  # the selection that the note tells, "damaged", or None
        self.dataset = None  # what the dataset holds, "damaged", or None

    def teardown(self):
        BROKEN.clear()
        if hasattr(self, "folder"):
            shutil.rmtree(self.folder.path)

    @property
    def selection(self):
        return Selection(LOADED.study, self.parameters, {"seed": self.axes})

    def expected(self, retry):
        """Seeds whose case is to be computed, in order."""
        stored = self.good if retry else self.good | self.failed
        return [case.values["seed"] for case in self.selection.cases() if case.id not in stored]

    def forget_failed(self, retry):
        """What the model says when a run that tries failed cases again has begun."""
        if retry:
            self.failed -= {case.id for case in self.selection.cases()}

    def compute(self, seeds):
        """What the model says after these cases were computed."""
        for case in self.selection.cases():
            if case.values["seed"] in seeds:
                self.damaged.discard(case.id)
                self.failed.discard(case.id)
                (self.failed if case.values["seed"] in BROKEN else self.good).add(case.id)

    def attempt(self, retry, writes=True):
        """One run of the engine, as the command makes it, but for the figures and often the dataset, which are slow."""
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(engine, "write_report", lambda *_, **__: None)
            if not writes:
                patch.setattr(engine, "write_dataset", lambda chosen, shards, *_: self.compare(merge(chosen, shards)))
            return engine.run_study(LOADED, self.selection, self.folder, workers=0, retry_failed=retry)

    @rule(seeds=SEEDS)
    def extend_or_narrow(self, seeds):
        self.axes = tuple(seeds)

    @rule(scale=st.sampled_from([1.0, 2.0]))
    def change_a_parameter(self, scale):
        self.parameters = {"scale": scale}

    @rule(seeds=st.sets(st.integers(0, 4), max_size=3))
    def break_or_mend_cases(self, seeds):
        BROKEN.clear()
        BROKEN.update(seeds)

    @rule(retry=st.booleans(), writes=st.sampled_from([False, False, False, True]))
    def run(self, retry, writes):
        todo = self.expected(retry)
        self.compute(todo)
        result = self.attempt(retry, writes)
        self.noted = self.selection
        assert result.kept == len(self.axes) - len(todo)
        failed = {case.id for case in self.selection.cases()} & self.failed
        assert result.failed == dict.fromkeys(failed, "ValueError: broken on demand")
        assert (self.folder.path / "failed.txt").exists() == bool(failed)
        if writes:
            self.dataset = self.selection
            with xr.open_dataset(self.folder.dataset("plain")) as dataset:
                self.compare(dataset.load())

    @rule(retry=st.booleans(), seed=st.integers(0, 4))
    def run_some_and_be_stopped(self, retry, seed):
        """The second Ctrl-C, in the middle of a case."""
        todo = self.expected(retry)
        if seed not in todo:
            return
        STOPPED.add(seed)
        try:
            with pytest.raises(Interrupted):
                self.attempt(retry)
        finally:
            STOPPED.clear()
        self.forget_failed(retry)
        self.compute(todo[: todo.index(seed)])
        self.noted = self.selection

    @rule(retry=st.booleans(), after=st.integers(0, 5))
    def crash_while_writing(self, retry, after):
        """The process dies before its n-th file is renamed, and leaves what it wrote beside it."""
        todo, replaced, real = self.expected(retry), [], os.replace

        def dying(source, target):
            if len(replaced) == after:
                shutil.copy(source, Path(source).with_name(f".left.{len(replaced)}{store.PARTIAL}"))
                raise Killed
            real(source, target)
            replaced.append(Path(target))

        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(store.os, "replace", dying)
            try:
                self.attempt(retry)
            except Killed:
                pass
        if replaced:
            self.noted = self.selection
            self.forget_failed(retry)
        self.compute(todo[: max(0, len(replaced) - 1)])
        if len(replaced) > 1 + len(todo):
            self.dataset = self.selection

    @precondition(lambda self: self.good | self.failed)
    @rule(data=st.data(), how=st.sampled_from(["cut", "flip", "text", "neighbour", "delete"]))
    def damage_a_shard(self, data, how):
        victim = data.draw(st.sampled_from(sorted(self.good | self.failed)))
        path = self.folder.shards / f"{victim}.nc"
        whole = path.read_bytes()
        if how == "neighbour":
            others = sorted((self.good | self.failed) - {victim})
            how = "delete" if not others else how
        if how == "delete":
            path.unlink()
        elif how == "neighbour":
            shutil.copy(self.folder.shards / f"{others[0]}.nc", path)
        elif how == "text":
            path.write_text("no shard")
        else:
            at = data.draw(st.integers(0, len(whole) - 1))
            path.write_bytes(whole[:at] if how == "cut" else whole[:at] + bytes([whole[at] ^ 1]) + whole[at + 1 :])
        self.good.discard(victim)
        self.failed.discard(victim)
        if how != "delete":
            self.damaged.add(victim)

    @precondition(lambda self: self.noted is not None)
    @rule(at=st.floats(0, 1, exclude_max=True))
    def cut_the_note(self, at):
        whole = self.folder.note.read_bytes()
        self.folder.note.write_bytes(whole[: int(at * len(whole))])
        self.noted = "damaged"

    @precondition(lambda self: self.dataset is not None)
    @rule(delete=st.booleans())
    def lose_the_dataset(self, delete):
        path = self.folder.dataset("plain")
        path.unlink() if delete else path.write_bytes(path.read_bytes()[:100])
        self.dataset = None

    @rule()
    def merge_what_is_there(self):
        ids = {case.id for case in self.selection.cases()}
        if ids & self.damaged:
            with pytest.raises(IntegrityError):
                merge(self.selection, self.folder.shards)
        else:
            self.compare(merge(self.selection, self.folder.shards))

    @invariant()
    def what_is_missing_is_known(self):
        if not hasattr(self, "folder"):
            return
        missing = engine.missing_cases(self.selection, self.folder)
        cases = self.selection.cases()
        assert missing.todo == [place for place, case in enumerate(cases) if case.id not in self.good | self.failed]
        assert missing.failed == [place for place, case in enumerate(cases) if case.id in self.failed]
        assert len(missing.damage) == sum(case.id in self.damaged for case in cases)

    @invariant()
    def the_note_tells_the_last_run_or_nothing(self):
        if getattr(self, "noted", None) is None:
            return
        if self.noted == "damaged":
            with pytest.raises(IntegrityError):
                self.folder.selection()
            return
        _, selection = self.folder.selection()
        assert (selection.parameters, selection.axes) == (self.noted.parameters, self.noted.axes)
        ids = {case.id for case in selection.cases()}
        if not ids & self.damaged:  # a status is read from the heads alone, and may take a flipped one for another
            total = folder_status(self.folder).total
            assert total["failed"] == len(ids & self.failed)
            assert total["missing"] == len(ids - self.good - self.failed)

    def compare(self, dataset):
        """Values are those of the formula where the model says so, and nothing anywhere else."""
        assert dataset.seed.values.tolist() == list(self.axes)
        for case in self.selection.cases():
            one, seed = dataset.sel(seed=case.values["seed"]), case.values["seed"]
            if case.id in self.good:
                values = self.parameters["scale"] * (seed + np.arange(4.0))
                assert one["values"].values.tobytes() == values.tobytes()
                assert float(one.total) == values.sum()
                assert one.status == Status.ok
            else:
                assert one.status == (Status.failed if case.id in self.failed else Status.missing)
                assert one["values"].isnull().all()


SOAK = int(os.environ.get("CRITFLOW_SOAK", "100"))
FolderMachine.TestCase.settings = settings(
    max_examples=SOAK,
    stateful_step_count=30,
    deadline=None,
    derandomize=SOAK == 100,
    database=None,
    phases=(Phase.generate,),  # to shrink what failed takes minutes
    suppress_health_check=list(HealthCheck),
)
TestFolderMachine = pytest.mark.timeout(0 if SOAK > 100 else 300)(FolderMachine.TestCase)
