"""Handing out batches when the cluster goes away, with a client that only plays one: nothing is waited for in vain."""

from concurrent.futures import CancelledError
from pathlib import Path
from types import SimpleNamespace

import pytest

from critflow.result import EnvironmentFailure
from critflow.workflow import fanout
from critflow.workflow.batch import Job
from critflow.workflow.fanout import Interruption, _through_dask

pytestmark = pytest.mark.timeout(30)


class Cluster:
    """A client of workers that begin what they get; `end` says what comes of it, if anything."""

    def __init__(self, end=None):
        self.workers, self.end, self.stopped = {"one": 1}, end, 0

    def nthreads(self):
        return self.workers

    def run(self, function, *_, **__):
        self.stopped += function is fanout.work.stop
        return {}

    def submit(self, function, job, batch, *, key, pure):
        def done(callback):
            if self.end is not None:
                callback(future)

        future = SimpleNamespace(key=key, add_done_callback=done, result=self.end)
        return future


@pytest.fixture
def handed_out(tmp_path):
    """`handed_out(cluster, interruption)` is what comes of one batch of one case."""
    job = Job("run", "study.py", "", str(tmp_path), {})

    def outcomes(cluster, interruption=None):
        return list(_through_dask(cluster, job, interruption or Interruption("run"), [[{"seed": 0}]]))

    return outcomes


def test_the_end_of_a_scheduler_ends_the_run(handed_out):
    def cancelled(timeout):
        raise CancelledError

    with pytest.raises(EnvironmentFailure, match="the scheduler went away"):
        handed_out(Cluster(cancelled))


@pytest.mark.parametrize("asked", [False, True])
def test_without_workers_for_long_a_run_ends(handed_out, monkeypatch, asked):
    """Interrupted too: what runs may never end."""
    cluster, interruption, clock = Cluster(), Interruption("run"), iter(range(0, 10**6, 7))

    class Silence(fanout.queue.SimpleQueue):
        def get(self, timeout):  # the batch has begun
            cluster.workers, interruption.asked = {}, asked
            raise fanout.queue.Empty

    monkeypatch.setattr(fanout.queue, "SimpleQueue", Silence)
    monkeypatch.setattr(fanout.time, "monotonic", lambda: float(next(clock)))
    with pytest.raises(EnvironmentFailure, match="all workers went away"):
        handed_out(cluster, interruption)
    assert cluster.stopped == asked  # told once


def test_workers_that_do_nothing_for_long_are_noticed(handed_out, monkeypatch):
    def look(watch):
        raise EnvironmentFailure(f"{watch.folder} is watched for {watch.seconds:.0f} s")

    monkeypatch.setattr(fanout.Watch, "look", look)
    with pytest.raises(EnvironmentFailure, match=rf"{Path('.attempts')} is watched for 7380 s"):
        handed_out(Cluster())
