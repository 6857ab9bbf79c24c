"""Parts of a run: several processes share one folder, each computes its part of the seeds, the last one merges."""

import pytest
from filelock import FileLock

from critflow.workflow import folder

FILES = ("tiny.nc", "claims.md", "claims.json", "summary.json", "study.json")


@pytest.fixture(autouse=True)
def fixed_date(monkeypatch):
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "0")


@pytest.fixture
def part(run):
    """`part(folder, "i/n", *settings)` runs a part of the tiny study."""
    return lambda out, word, *settings: run(out, *settings, more=("--part", word))


def test_parts_in_any_order_give_the_bytes_of_one_run(tmp_path, run, part, capsys):
    assert run(tmp_path / "one") == 0
    parts = tmp_path / "parts"
    for word in ("3/3", "1/3"):
        assert part(parts, word) == 0
        assert not (parts / "tiny.nc").exists() and "other parts are missing" in capsys.readouterr().err
    assert part(parts, "2/3") == 0
    for name in FILES:
        assert (parts / name).read_bytes() == (tmp_path / "one" / name).read_bytes(), name
    shards = {path.name for path in (parts / "shards").iterdir()}
    assert shards == {path.name for path in (tmp_path / "one" / "shards").iterdir()}


def test_parts_at_the_same_time_merge_once(tmp_path, run, start):
    assert run(tmp_path / "one") == 0
    processes = [start(tmp_path / "parts", more=("--part", f"{i}/2")) for i in (1, 2)]
    assert [process.wait(120) for process in processes] == [0, 0], [p.stderr.read() for p in processes]
    for name in FILES:
        assert (tmp_path / "parts" / name).read_bytes() == (tmp_path / "one" / name).read_bytes(), name


def test_a_failed_case_is_told_by_its_part_and_by_the_last(tmp_path, part, capsys):
    settings = ("trouble=1-random", "how=raise")
    assert part(tmp_path, "2/2", *settings) == 3
    assert "seed1-random" in capsys.readouterr().err
    assert part(tmp_path, "1/2", *settings) == 3
    assert (tmp_path / "tiny.nc").exists()


def test_a_part_and_a_run_of_the_whole_exclude_each_other(tmp_path, run, part, capsys, monkeypatch):
    monkeypatch.setattr(folder, "_PATIENCE", 0.1)
    assert part(tmp_path, "1/2") == 0
    for held, attempt, code in (
        (".lock", lambda: part(tmp_path, "2/2"), 5),
        (".lock-2-of-2", lambda: part(tmp_path, "2/2"), 5),
        (".lock-2-of-2", lambda: run(tmp_path), 5),
        (".lock-1-of-2", lambda: part(tmp_path, "2/2"), 0),
    ):
        with FileLock(tmp_path / held):
            assert attempt() == code, (held, capsys.readouterr().err)
