"""Jobs of a batch system: submitted, and submitted again when they end before the run does.

dask-jobqueue submits jobs and asks no more about them.  A job has ended when its workers were there and are gone,
whoever ended it.  One that ends before its workers are there is known by a note, which the job itself leaves where its
keys are: when as many do that in a row as there should be jobs, no other follows.
"""

from __future__ import annotations

import itertools
import re
import shlex
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from distributed import Status

from critflow.result import EnvironmentFailure
from critflow.workflow.profiles import Cluster

PATIENCE = 60.0  # seconds: a worker that died is back sooner, and no job is replaced by another more often
_LONGEST = 300  # letters that a batch system may say


class Jobs:
    """The jobs of one run, kept at the number that its profile says."""

    def __init__(self, cluster: Any, profile: Cluster, notes: Path, logs: Path | None, stopped: Callable[[], bool]):
        self.cluster, self.profile, self.notes, self.logs, self.stopped = cluster, profile, notes, logs, stopped
        self.seen: dict[str, float] = {}  # when a worker of this job was there last
        self.barren: list[str] = []  # notes of jobs that ended without a worker, since one had some
        self.numbers = itertools.count()  # a name is never used again
        self.looked = self.submitted = time.monotonic()
        self.submit()

    @property
    def patience(self) -> float:
        """How many seconds to wait without any worker."""
        return PATIENCE if self.stopped() else self.profile.wait

    @property
    def where(self) -> str:
        return "" if self.logs is None else f"; the jobs write to {self.logs}"

    def submit(self) -> None:
        """Bring the jobs to their number; an error in the words of the batch system where it refuses one."""
        self.submitted = time.monotonic()
        while len(self.cluster.worker_spec) < self.profile.jobs:
            self.cluster.worker_spec[f"job-{next(self.numbers)}"] = self.cluster.new_spec
        refused = ""
        try:
            self.cluster.sync(_corrected, self.cluster)
        except FileNotFoundError as error:
            refused = f"there is no {error.filename} here"
        except Exception as error:
            refused = _said(str(error))
        if refused:
            for name in [name for name, job in self.cluster.workers.items() if job.job_id is None]:
                self.cluster.workers.pop(name).status = Status.failed  # or dask would miss it when it closes
                del self.cluster.worker_spec[name]
            raise EnvironmentFailure(f"no job of profile {self.profile.name!r} can be submitted: {refused}")

    def look(self) -> None:
        """Replace the jobs that ended; an error when none is left and none would do better."""
        now = time.monotonic()
        if self.stopped() or now - self.looked < 1.0:
            return
        self.looked = now
        present = {worker.name for worker in list(self.cluster.scheduler.workers.values())}
        ended = {path.name for path in self.notes.iterdir()}
        for job, spec in list(self.cluster.worker_spec.items()):
            if present.intersection(f"{job}{suffix}" for suffix in spec.get("group", [""])):
                if job not in self.seen:
                    self.barren.clear()
                self.seen[job] = now
            elif job in ended and job not in self.seen:
                self.barren.append((self.notes / job).read_text().strip())
                del self.cluster.worker_spec[job]
            elif job in self.seen and (job in ended or now - self.seen[job] > PATIENCE):
                del self.cluster.worker_spec[job]
        hopeless = len(self.barren) >= self.profile.jobs
        if hopeless and not self.cluster.worker_spec:
            raise EnvironmentFailure(
                f"the jobs of profile {self.profile.name!r} end before a worker is there, with exit code "
                f"{self.barren[-1]}: look into {self.logs} and mend the profile"
            )
        if not hopeless and len(self.cluster.worker_spec) < self.profile.jobs and now - self.submitted > PATIENCE:
            try:
                self.submit()
            except EnvironmentFailure:  # the batch system may be away for a while
                if not self.cluster.worker_spec and not present:
                    raise


def noting(kind: Any, notes: Path) -> Any:
    """A class of jobs that write their exit code to a file when they end, unless they are killed."""

    class NotingJob(kind):
        def __init__(self, *args: Any, name: str, job_script_prologue: list[str], **options: Any):
            note = f"{{ echo $? > {shlex.quote(str(notes / name))}; }} 2>/dev/null"
            prologue = [f"trap {shlex.quote(note)} EXIT", *job_script_prologue]
            super().__init__(*args, name=name, job_script_prologue=prologue, **options)

    return NotingJob


async def _corrected(cluster: Any) -> None:
    await cluster


def _said(error: str) -> str:
    """What a command said, in a line: the end of the message of dask-jobqueue, without the command's own name."""
    said = error.rpartition("stderr:\n")[2].strip() or error.strip()
    return "; ".join(re.sub(r"^\w+: (error: )?", "", line) for line in said.splitlines())[:_LONGEST]
