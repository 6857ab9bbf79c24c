"""Cases that do their worst: the others are computed, the bad one is told, and nothing hangs."""

import shlex
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from critflow.cli import main
from critflow.result import EnvironmentFailure, Status
from critflow.workflow import attempts, limits, supervise
from critflow.workflow.batch import Job, Outcome
from critflow.workflow.fanout import Interruption
from critflow.workflow.load import load_file
from critflow.workflow.plan import select
from critflow.workflow.store import read_shard

STUDY = Path(__file__).with_name("poisoned_study.py")
PLAIN = {
    "raises": "acts",
    "unprintable": "Unprintable",
    "outside": "Outside: outside",
    "surrogate": r"ValueError: \udc80 and \0",
    "talkative": "xxx",
    "exits": "SystemExit: 3",
    "returns_function": "dtype object",
    "returns_list": "must return a dict",
    "returns_generator": "dtype object",
    "returns_nonsense": "77 is not a valid Status",
    "recurses": "RecursionError",
}
DEADLY = {
    "interrupts": "KeyboardInterrupt",  # in the process of the command it would be a Ctrl-C
    "quits": "without a word",
    "kills_itself": "without a word",
    "aborts": "crashed: Aborted",
    "segfaults": "crashed: Segmentation fault",
    "leaks": "ended from outside",
    "hangs": "longer than its time limit",
    "hangs_in_compiled_code": "longer than its time limit",
}


def words(folder, kinds, *more):
    return ["run", str(STUDY), "--out", str(folder), f"--set=kinds={','.join(kinds)}", *more]


def assert_only_the_bad_ones_failed(folder, kinds):
    """Of the three cases of every kind the one in the middle failed, and says why."""
    with xr.open_dataset(folder / "poisoned.nc") as dataset:
        status = dataset.status.transpose("kind", "seed").values
    assert (status == np.array([Status.ok, Status.failed, Status.ok])).all(), status
    study = load_file(STUDY).study
    told = (folder / "failed.txt").read_text()
    for kind, reason in kinds.items():
        case = select(study, [f"kinds={kind}"]).case(kind=kind, seed=1)
        error = read_shard(folder / "shards", study, case).error
        assert reason in error
        assert len(error) < 21_000
        assert error in told


def test_whatever_a_case_raises_or_returns_the_others_are_computed(tmp_path, capsys):
    assert main(words(tmp_path, PLAIN, "--workers=0")) == 3
    err = capsys.readouterr().err
    assert "critflow: 11 cases failed" in err
    assert max(map(len, err.splitlines())) < 400
    assert_only_the_bad_ones_failed(tmp_path, PLAIN)


@pytest.mark.timeout(300)
def test_whatever_a_case_does_to_its_worker_the_others_are_computed(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(supervise, "ATTEMPTS", 1)
    more = ("--workers=2", "--time-limit=6", "--memory-limit=0.6")
    assert main(words(tmp_path, DEADLY, *more)) == 3
    assert "Traceback" not in capsys.readouterr().err
    assert_only_the_bad_ones_failed(tmp_path, DEADLY)
    assert not list((tmp_path / "shards").glob(".*"))


@pytest.mark.timeout(300)
def test_a_case_that_ends_its_worker_is_tried_again_and_one_that_raises_is_not(tmp_path):
    tally = tmp_path / "tally"
    kinds = ["quits_twice", "raises"]
    assert main(words(tmp_path / "out", kinds, f"--set=tally={tally}", "--workers=1")) == 3
    tries = {kind: len(Path(f"{tally}-{kind}").read_text().splitlines()) for kind in kinds}
    assert tries["quits_twice"] == 3
    assert tries["raises"] == 1  # it would raise again
    with xr.open_dataset(tmp_path / "out" / "poisoned.nc") as dataset:
        failed = (dataset.status == Status.failed).sum("seed")
    assert failed.sel(kind=kinds).values.tolist() == [0, 1]


@pytest.mark.timeout(300)
def test_a_worker_that_does_not_answer_is_restarted(tmp_path, monkeypatch):
    """A stopped process has no clock of its own; the scheduler misses its heartbeat."""
    monkeypatch.setattr(supervise, "ATTEMPTS", 1)
    monkeypatch.setattr(limits, "GRACE", 5.0)
    assert main(words(tmp_path, ["stops"], "--workers=1", "--time-limit=1")) == 3
    assert_only_the_bad_ones_failed(tmp_path, {"stops": "without a word"})


def test_a_failed_case_comes_with_its_parameters_and_the_command_that_runs_it_alone(tmp_path):
    settings = ("--set=tally=none of these/it's", "--workers=0")
    assert main(words(tmp_path / "out", ["none", "raises"], *settings)) == 3
    name, command, _, *told = (tmp_path / "out" / "failed.txt").read_text().splitlines()
    assert told[:4] == ["kind = raises", "seed = 1", "bad = 1", "tally = none of these/it's"]
    assert told[-1].startswith("FileNotFoundError: [Errno 2]")
    chosen = [word.removeprefix("--set=") for word in shlex.split(command) if word.startswith("--set=")]
    assert [f"# {case.id}" for case in select(load_file(STUDY).study, chosen).cases()] == [name]
    alone = [word for word in shlex.split(command)[1:] if not word.startswith("--workers")]
    assert main([*alone, "--workers=0"]) == 3
    assert (tmp_path / "out-alone" / "failed.txt").read_text().splitlines()[0] == name


def test_what_failed_is_told_until_it_is_mended(tmp_path, capsys):
    tally = f"--set=tally={tmp_path}/no/tally"
    for more in ((), ()):
        assert main(words(tmp_path / "out", ["raises"], tally, "--workers=0", *more)) == 3
        assert "1 case failed" in capsys.readouterr().err
        assert (tmp_path / "out" / "failed.txt").exists()
    assert main(words(tmp_path / "out", ["none"], "--workers=0")) == 0
    assert not (tmp_path / "out" / "failed.txt").exists()


@pytest.mark.parametrize(
    ("more", "sentence"),
    [
        (("--time-limit=0", "--workers=1"), "--time-limit 0 must be a number above zero"),
        (("--time-limit=nan", "--workers=1"), "--time-limit nan must be"),
        (("--memory-limit=-1", "--workers=1"), "--memory-limit -1 must be"),
        (("--time-limit=5", "--workers=0"), "--workers 0 has none"),
        (("--memory-limit=5", "--scheduler=tls://127.0.0.1:1"), "--memory-limit is for workers on this machine"),
    ],
)
def test_limits_that_cannot_be_held_are_refused(tmp_path, capsys, more, sentence):
    assert main(words(tmp_path / "out", ["none"], *more)) == 2
    assert sentence in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


class Workers:
    """Worker processes with threads: whatever runs beside a case that dies is in the file it leaves."""

    def __init__(self, job, guilty):
        self.job, self.guilty = job, guilty
        self.together, self.deaths = [], 0

    def __call__(self, batches):
        together = [values for batch in batches for values in batch]
        self.together.append(together)
        dies = any(values["seed"] in self.guilty for values in together)
        if dies:
            self.deaths += 1
            study = load_file(STUDY).study
            ids = [select(study).case(**values).id for values in together]
            folder = Path(self.job.shards) / ".attempts"
            folder.mkdir(exist_ok=True, parents=True)
            (folder / f"{self.job.run}-host-{self.deaths}").write_text(f"{' '.join(ids)}\n")
        for batch in batches:
            outcomes = [Outcome(f"seed{values['seed']}", int(Status.ok), "", 0.0, "", "") for values in batch]
            yield batch, None if dies else outcomes


@pytest.fixture
def supervised(tmp_path):
    """`supervised(workers)` is what comes of the three cases of the study, by seed."""
    loaded = load_file(STUDY)
    job = Job("run", str(STUDY), loaded.digest, str(tmp_path), dict(loaded.study.parameters))
    selection = select(loaded.study)

    def outcomes(workers):
        batches = [[{"kind": "none", "seed": seed} for seed in range(3)]]
        found = supervise.supervised(workers, job, selection, batches, Interruption(job.run))
        return {values["seed"]: o.status for batch, each in found for values, o in zip(batch, each, strict=True)}

    return job, outcomes


def test_cases_that_ran_beside_a_deadly_one_are_not_condemned_with_it(supervised):
    job, outcomes = supervised
    workers = Workers(job, guilty=[1])
    assert outcomes(workers) == {0: Status.ok, 1: Status.failed, 2: Status.ok}
    assert workers.deaths == 3
    assert [[values["seed"] for values in each] for each in workers.together] == [[0, 1, 2], [0, 1, 2], [0], [1], [2]]


def test_workers_that_die_before_they_begin_stop_the_run(supervised):
    _, outcomes = supervised
    with pytest.raises(EnvironmentFailure, match="before they begin"):
        outcomes(lambda batches: ((batch, None) for batch in batches))


def test_a_run_in_which_nothing_happens_is_ended(tmp_path, monkeypatch):
    now = 0.0
    monkeypatch.setattr(attempts.time, "monotonic", lambda: now)
    (tmp_path / ".attempts").mkdir()
    watch = attempts.Watch("run", tmp_path, seconds=100.0)
    for number in range(5):  # somebody begins a case now and then
        (tmp_path / ".attempts" / f"run-{number}").touch()
        now += 90.0
        watch.look()
    (tmp_path / ".attempts" / "other-run").touch()  # no life of this one
    now += 90.0
    watch.look()
    now += 20.0
    with pytest.raises(EnvironmentFailure, match="no worker did anything for 100 s"):
        watch.look()


def test_in_the_process_of_the_command_no_case_is_timed(tmp_path, monkeypatch):
    """Its end would be the end of the run."""
    monkeypatch.setattr("critflow.workflow.batch.attempt", lambda *_: pytest.fail("timed"))
    assert main(words(tmp_path, ["none"], "--workers=0")) == 0


def test_a_report_that_failed_cases_spoil_does_not_hide_them(tmp_path, capsys):
    source = Path(__file__).with_name("plain_study.py").read_text()
    claims = "return [Claim", "assert ds.total.notnull().all(); return [Claim"
    changes = {"broken: set[int] = set()": "broken = {1}", claims[0]: claims[1]}
    for old, new in changes.items():
        assert old in source
        source = source.replace(old, new)
    (tmp_path / "plain.py").write_text(source)
    assert main(["run", str(tmp_path / "plain.py"), "--out", str(tmp_path / "out"), "--workers=0"]) == 3
    err = capsys.readouterr().err
    assert "the claims could not be made" in err
    assert "1 case failed" in err
