"""A results folder under any order of events, compared with a plain model of its contents.

`CRITFLOW_SOAK=5000 pytest tests/engine/test_folder_machine.py` examines that many examples.
"""

import os
import shutil
import tempfile
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from disturbed import PLAIN, STUDY, words_of
from hypothesis import HealthCheck, Phase, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, precondition, rule

from critflow.command.main import main
from critflow.engine.code_digest import load_file
from critflow.engine.settings import select
from critflow.result import Status

SEEDS = st.lists(st.integers(0, 4), min_size=1, max_size=4, unique=True)
BROKEN, STOPPED = (load_file(PLAIN).study.case.__globals__[name] for name in ("broken", "stopped"))


class Killed(BaseException):
    """The death of the process, as nearly as one process can imitate it."""


class FolderMachine(RuleBasedStateMachine):
    """What is stored of each case is known from the events, never from the folder."""

    @initialize()
    def begin(self):
        self.folder = Path(tempfile.mkdtemp(dir="/dev/shm" if os.path.isdir("/dev/shm") else None))
        self.stored: dict[tuple[float, int], str] = {}  # by scale and seed: "good", "failed" or "damaged"
        self.merged: dict[float, set[int]] = {}  # seeds that a dataset of this scale contains, for the last scale

    def teardown(self):
        BROKEN.clear()
        if hasattr(self, "folder"):
            shutil.rmtree(self.folder)

    def path(self, scale, seed):
        return self.folder / "shards" / f"{select(STUDY, [f'scale={scale}', f'seeds={seed}']).cases[0].id}.nc"

    def attempt(self, scale, seeds, retry=False):
        words = words_of(self.folder, [f"scale={scale}", f"seeds={','.join(map(str, seeds))}"])
        return main([*words, *(["--retry-failed"] if retry else [])])

    def todo(self, scale, seeds, retry):
        """Seeds to compute, in order: requested ones that are not stored, and damaged ones of the dataset before."""
        skip = {"good"} if retry else {"good", "failed"}
        requested = {seed for seed in seeds if self.stored.get((scale, seed)) not in skip}
        return sorted(requested | {s for s in self.merged.get(scale, ()) if self.stored.get((scale, s)) == "damaged"})

    def compute(self, scale, seeds):
        for seed in seeds:
            self.stored[scale, seed] = "failed" if seed in BROKEN else "good"

    @rule(seeds=st.sets(st.integers(0, 4), max_size=3))
    def break_or_repair_cases(self, seeds):
        BROKEN.clear()
        BROKEN.update(seeds)

    @rule(scale=st.sampled_from([1.0, 2.0]), seeds=SEEDS, retry=st.booleans())
    def run(self, scale, seeds, retry):
        self.compute(scale, self.todo(scale, seeds, retry))
        failed = any(self.stored[scale, seed] == "failed" for seed in seeds)
        assert self.attempt(scale, seeds, retry) == (3 if failed else 0)
        self.merge(scale, seeds)
        self.compare(scale)

    @rule(scale=st.sampled_from([1.0, 2.0]), seeds=SEEDS, seed=st.integers(0, 4))
    def run_and_stop_in_a_case(self, scale, seeds, seed):
        todo = self.todo(scale, seeds, False)
        if seed not in todo:
            return
        STOPPED.add(seed)
        try:
            assert self.attempt(scale, seeds) == 130
        finally:
            STOPPED.clear()
        self.compute(scale, todo[: todo.index(seed)])
        self.merge(scale, seeds)

    @rule(scale=st.sampled_from([1.0, 2.0]), seeds=SEEDS, after=st.integers(1, 5))
    def die_before_a_rename(self, scale, seeds, after):
        """The process dies before its n-th file is put in place, the first being the note."""
        todo, real, renamed = self.todo(scale, seeds, False), os.replace, []

        def dying(source, target):
            if len(renamed) == after:
                raise Killed
            real(source, target)
            renamed.append(target)

        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(os, "replace", dying)
            try:
                self.attempt(scale, seeds)
            except Killed:
                pass
        self.compute(scale, todo[: after - 1])
        self.merge(scale, seeds)

    def merge(self, scale, seeds):
        """The requested cases belong to the dataset too, also after the note of a run that did not end."""
        before = {s for s in self.merged.get(scale, ()) if (scale, s) in self.stored}
        self.merged = {scale: before | set(seeds)}

    @precondition(lambda self: "good" in self.stored.values())
    @rule(data=st.data(), how=st.sampled_from(["cut", "flip", "text", "delete"]))
    def damage_a_stored_case(self, data, how):
        scale, seed = data.draw(st.sampled_from(sorted(key for key, state in self.stored.items() if state == "good")))
        path = self.path(scale, seed)
        whole = path.read_bytes()
        at = data.draw(st.integers(0, len(whole) - 1))
        path.unlink()
        if how == "delete":
            del self.stored[scale, seed]
            return
        flipped = whole[:at] + bytes([whole[at] ^ 1]) + whole[at + 1 :]
        path.write_bytes({"cut": whole[:at], "flip": flipped, "text": b"no result"}[how])
        self.stored[scale, seed] = "damaged"

    def compare(self, scale):
        """Values are those of the formula where the model says so; nothing is anywhere else."""
        with xr.open_dataset(self.folder / "plain.nc") as ds:
            assert ds.seed.values.tolist() == sorted(self.merged[scale])
            for seed in ds.seed.values.tolist():
                case, state = ds.sel(seed=seed), self.stored[scale, seed]
                assert int(case.status) == (Status.ok if state == "good" else Status.failed)
                if state == "good":
                    assert case["values"].values.tobytes() == (scale * (seed + np.arange(4.0))).tobytes()
                else:
                    assert case["values"].isnull().all()


SOAK = int(os.environ.get("CRITFLOW_SOAK", "0"))
FolderMachine.TestCase.settings = settings(
    max_examples=SOAK or settings.default.max_examples // 2,
    stateful_step_count=8,
    deadline=None,
    derandomize=not SOAK,
    database=None,
    phases=(Phase.generate,),  # shrinking a failure takes minutes
    suppress_health_check=list(HealthCheck),
)
TestFolderMachine = pytest.mark.timeout(0 if SOAK else 300)(FolderMachine.TestCase)
