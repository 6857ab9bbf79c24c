"""What a worker does with a batch."""

import pytest

from critflow.result import Status, StudyError
from critflow.workflow import batch
from critflow.workflow.batch import Job, Outcome, run_batch, stop
from critflow.workflow.plan import select


@pytest.fixture
def job(tiny, tmp_path):
    (tmp_path / "shards").mkdir()
    return Job(f"run of {tmp_path}", str(tiny.path), tiny.digest, str(tmp_path / "shards"), dict(tiny.study.parameters))


BATCH = [{"seed": 0, "population": "random"}, {"seed": 0, "population": "floppy"}]


def test_a_batch_answers_with_plain_words_and_leaves_the_arrays_in_shards(tiny, job, tmp_path, stamps):
    outcomes = run_batch(job, BATCH)
    assert all(type(outcome) is tuple for outcome in outcomes)
    assert [Outcome(*o).case_id for o in outcomes] == [case.id for case in select(tiny.study).cases()[:2]]
    assert [Outcome(*o).status for o in outcomes] == [Status.ok, Status.floppy]
    assert len(stamps(tmp_path)) == 2


def test_a_batch_that_comes_back_computes_only_what_is_not_stored(job, tmp_path, stamps):
    """As after the death of the worker that had it before."""
    first = run_batch(job, BATCH[:1])
    before = stamps(tmp_path)
    again = run_batch(job, BATCH)
    assert Outcome(*again[0]).checksum == Outcome(*first[0]).checksum
    assert before.items() < stamps(tmp_path).items()


def test_a_stopped_run_begins_no_case(job, tmp_path, stamps):
    stop("another run")
    assert len(run_batch(job, BATCH[:1])) == 1
    stop(job.run)
    assert run_batch(job, BATCH) == []
    assert len(stamps(tmp_path)) == 1


def test_a_study_that_changed_under_way_is_refused(job):
    changed = Job(job.run + "!", job.study_path, "0" * 64, job.shards, job.parameters)
    with pytest.raises(StudyError, match="changed while it ran"):
        run_batch(changed, BATCH)


def test_a_case_that_cannot_be_stored_has_failed_and_keeps_no_other_back(tiny, job, monkeypatch):
    real = batch.write_shard

    def without_room(folder, study, case, status, *arrays):
        if case.values["population"] == "random" and status is not Status.failed:
            raise MemoryError("no room for it")
        return real(folder, study, case, status, *arrays)

    monkeypatch.setattr(batch, "write_shard", without_room)
    first, second = (Outcome(*outcome) for outcome in run_batch(job, BATCH))
    assert (first.status, first.error) == (Status.failed, "MemoryError: no room for it")
    assert second.status == Status.floppy
