"""Failing cases: the others are computed, the failed one is recorded, and nothing hangs."""

import shlex
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from critflow.command.main import main
from critflow.engine import dask_workers
from critflow.engine.code_digest import load_file
from critflow.engine.settings import select
from critflow.result import Status

STUDY = Path(__file__).with_name("poisoned_study.py")
RAISING = {  # kinds, and a word of their records
    "raises": "acts",
    "unprintable": "Unprintable",
    "outside": "Outside",
    "surrogate": "ValueError",
    "long": "xxx",
    "exits": "SystemExit",
    "returns_function": "object",
    "returns_list": "dict",
    "recurses": "RecursionError",
}


def case_of(kind, *settings):
    return select(load_file(STUDY).study, [f"kinds={kind}", *settings]).case(kind=kind, seed=1)


def record(folder, kind, *settings):
    return (folder / "failed" / f"{case_of(kind, *settings).id}.txt").read_text()


def assert_only_the_bad_cases_failed(folder, kinds):
    """Of the three cases of every kind the middle one failed."""
    with xr.open_dataset(folder / "poisoned.nc") as dataset:
        status = dataset.status.transpose("kind", "seed").values
    assert (status == np.array([Status.ok, Status.failed, Status.ok])).all(), status
    assert len(list((folder / "failed").iterdir())) == len(kinds)
    assert len(list((folder / "shards").iterdir())) == len(kinds)  # one for each value of the first axis


def test_whatever_a_case_raises_or_returns_the_others_are_computed(tmp_path, run, capsys):
    assert run(tmp_path, f"kinds={','.join(RAISING)}", study="poisoned") == 3
    err = capsys.readouterr().err
    assert f"{len(RAISING)} cases failed" in err
    assert max(map(len, err.splitlines())) < 400
    assert_only_the_bad_cases_failed(tmp_path, RAISING)
    for kind, word in RAISING.items():
        assert word in record(tmp_path, kind)
        assert len(record(tmp_path, kind)) < 25_000


DEADLY = {"kills_itself": "SIGKILL|died|ended", "leaks": "memory", "hangs_in_compiled_code": "time limit"}


@pytest.mark.timeout(300)
def test_whatever_a_case_does_to_its_worker_the_others_are_computed(tmp_path, run, capsys, monkeypatch, forked):
    """Also of tasks that are submitted when others have ended."""
    monkeypatch.setattr(dask_workers, "_SUBMITTED", 2)
    limits = ("--time-limit=2", "--memory-limit=0.6")
    assert run(tmp_path, f"kinds={','.join(DEADLY)}", workers=2, more=limits, study="poisoned") == 3
    assert "Traceback" not in capsys.readouterr().err
    assert_only_the_bad_cases_failed(tmp_path, DEADLY)
    for kind, words in DEADLY.items():
        assert any(word in record(tmp_path, kind) for word in words.split("|")), record(tmp_path, kind)


@pytest.mark.timeout(300)
def test_a_case_whose_worker_died_once_is_computed(tmp_path, run, monkeypatch):
    monkeypatch.setenv("CRITFLOW_TEST_MARKS", str(tmp_path))
    assert run(tmp_path / "out", "kinds=kills_itself_once", workers=1, study="poisoned") == 0
    assert (tmp_path / "kills_itself_once").exists()
    assert (xr.load_dataset(tmp_path / "out" / "poisoned.nc").status == Status.ok).all()


def test_the_record_of_a_failed_case_contains_its_parameters_and_the_command_that_runs_it_alone(tmp_path, run):
    setting = "label=a b's"
    assert run(tmp_path / "out", "kinds=none,raises", setting, study="poisoned") == 3
    text = record(tmp_path / "out", "raises", setting)
    assert "Traceback" in text and text.rstrip().endswith("acts")
    assert all(line in text for line in ("kind = raises", "seed = 1", "bad = 1", "label = a b's"))
    (command,) = [line.lstrip("# $") for line in text.splitlines() if "critflow run" in line]
    words = shlex.split(command)[1:]
    chosen = [word.removeprefix("--set=") for word in words if word.startswith("--set=")]
    assert [case.id for case in select(load_file(STUDY).study, chosen).cases] == [case_of("raises", setting).id]
    assert main([*(word for word in words if not word.startswith("--workers")), "--workers=0"]) == 3


def test_a_report_that_fails_with_a_failed_case_does_not_hide_it(tmp_path, run, source, capsys):
    claims = "return [Claim"
    broken = "broken: set[int] = set()"
    path = source(broken, "broken = {1}", claims, f"assert ds.total.notnull().all(); {claims}", study="plain")
    assert run(tmp_path / "out", study=path) == 3
    err = capsys.readouterr().err
    assert "claims" in err
    assert "1 case failed" in err
