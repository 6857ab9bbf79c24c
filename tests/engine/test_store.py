"""A results folder: what is written is read back, one runner at a time, one account of what is stored."""

import errno
import json
import os
import platform
import threading
import time
from dataclasses import replace
from shutil import copytree

import netCDF4
import numpy as np
import pytest
from disturbed import STUDY, begun, ended, stamps_of, wait_until, words_of

from critflow.command.main import main
from critflow.engine import store
from critflow.engine.settings import select
from critflow.engine.store import Folder, StoredCase, read_shard, several, shard_path, write_shard, write_text
from critflow.result import EnvironmentFailure, Status


@pytest.fixture
def case(tiny):
    return select(tiny.study).cases[0]


@pytest.fixture
def arrays(tiny, case):
    """What is computed of the case, without its status."""
    made = dict(tiny.study.arrays(tiny.study.case(case.parameters, **case.values), case.parameters))
    del made["status"]
    return made


def complete(case, status, arrays, absent=()):
    return {case.id: StoredCase(case.values, status, "some code", "some libraries", absent, arrays)}


@pytest.fixture
def path(tmp_path, tiny, case, arrays):
    """The shard of the case alone, complete."""
    write_shard(tmp_path, tiny.study, case, complete(case, Status.stalled, arrays))
    return shard_path(tmp_path, case)


def test_what_is_written_is_read_back(tmp_path, tiny, case, arrays, path):
    (stored,) = read_shard(path, tiny.study, case)[0].values()
    assert replace(stored, arrays={}) == StoredCase(case.values, Status.stalled, "some code", "some libraries")
    assert {n: (a.dtype, a.tobytes()) for n, a in stored.arrays.items()} == {
        n: (a.dtype, a.tobytes()) for n, a in arrays.items()
    }
    assert [p.name for p in tmp_path.iterdir()] == [path.name]
    with netCDF4.Dataset(path) as file:  # any tool reads it
        assert set(arrays) <= set(file.variables)


def test_the_cases_of_a_shard_have_their_own_arrays_in_any_order(tmp_path, tiny, case, arrays):
    """They share the network; a case without some arrays lacks them when it is read."""
    other = select(tiny.study).case(seed=case.values["seed"], population="floppy")
    few = {"edges": arrays["edges"]}
    absent = tuple(name for name in tiny.study.inner_dims if name not in {*few, "status"})
    both = complete(case, Status.ok, arrays) | complete(other, Status.floppy, few, absent)
    write_shard(tmp_path, tiny.study, case, both)
    first = shard_path(tmp_path, case).read_bytes()
    write_shard(tmp_path, tiny.study, other, dict(reversed(both.items())))
    assert shard_path(tmp_path, other).read_bytes() == first
    found, _ = read_shard(shard_path(tmp_path, other), tiny.study, other)
    assert {name: set(stored.arrays) for name, stored in found.items()} == {case.id: set(arrays), other.id: {"edges"}}
    assert {name: stored.absent for name, stored in found.items()} == {case.id: (), other.id: absent}
    with netCDF4.Dataset(shard_path(tmp_path, case)) as file:
        assert file["sigma"].shape == (2, 6) and file["edges"].shape == (6, 2)


def test_a_write_that_does_not_read_back_keeps_the_old_file(tmp_path, tiny, case, arrays, path, monkeypatch):
    """A library or a disk that alters the data is detected before the file is put in place."""
    before, number, seal = path.read_bytes(), 123456789.125, store.append_seal

    def altered(file):
        whole = file.read_bytes()
        at = max(whole.find(np.array(number, kind).tobytes()) for kind in ("<f8", ">f8")) + 4
        file.write_bytes(whole[:at] + bytes([whole[at] ^ 1]) + whole[at + 1 :])
        return seal(file)

    monkeypatch.setattr(store, "append_seal", altered)
    with pytest.raises(EnvironmentFailure, match="back"):
        write_shard(tmp_path, tiny.study, case, complete(case, Status.ok, arrays | {"residual": np.array(number)}))
    assert path.read_bytes() == before


def test_a_file_is_synchronised_before_it_is_renamed_and_the_folder_after(tmp_path, tiny, case, arrays, monkeypatch):
    calls = []
    for name in ("fsync", "replace"):
        real = getattr(os, name)

        def recorded(first, *more, name=name, real=real):
            is_folder = name == "fsync" and os.path.isdir(f"/proc/self/fd/{first}")
            calls.append(f"{name} folder" if is_folder else name)
            return real(first, *more)

        monkeypatch.setattr(os, name, recorded)
    write_shard(tmp_path, tiny.study, case, complete(case, Status.ok, arrays))
    assert calls == ["fsync", "replace", "fsync folder"]


def test_a_text_that_cannot_be_synchronised_does_not_replace_the_old_one(tmp_path, monkeypatch):
    path = tmp_path / "study.json"
    write_text(path, "old")

    def refused(descriptor):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", refused)
    with pytest.raises(EnvironmentFailure, match="cannot write"):
        write_text(path, "new")
    assert path.read_text() == "old" and list(tmp_path.iterdir()) == [path]


SLOW = {"CRITFLOW_TEST_PAUSE": "100"}


@pytest.fixture
def holder(tmp_path):
    """A run in the middle of its first case."""
    process = begun(tmp_path / "out", environment=SLOW)
    wait_until((tmp_path / "out" / "study.json").exists, process.is_alive)
    yield process
    process.kill()
    process.join()


def test_a_second_run_is_refused_until_the_first_has_died(tmp_path, holder, said):
    out = tmp_path / "out"
    start = time.monotonic()
    (line,) = said(words_of(out), 5).err.splitlines()
    assert time.monotonic() - start < 5
    assert str(holder.pid) in line and platform.node() in line  # the holder is named
    assert not stamps_of(out) and not (out / "plain.nc").exists()
    for reading in (["status", str(out)], [*words_of(out), "--dry-run"]):
        assert main(reading) == 0  # to read needs no lock
    holder.kill()
    holder.join()
    assert main(words_of(out)) == 0


def test_of_runs_started_together_exactly_one_works(tmp_path):
    for attempt in range(3):
        environment = {"CRITFLOW_TEST_PAUSE": "0.3"}
        codes = [ended(p) for p in [begun(tmp_path / f"{attempt}", environment=environment) for _ in range(2)]]
        assert sorted(codes) == [0, 5]


def test_another_user_cannot_hold_the_lock(tmp_path):
    assert main(words_of(tmp_path)) == 0
    assert (tmp_path / ".lock").stat().st_mode & 0o007 == 0


@pytest.fixture
def mixed(tmp_path, source):
    """A folder with three stored cases, one of them damaged, one missing and one failed; and the words that run it."""
    study = source("broken: set[int] = set()", "broken = {2}", study="plain")
    words = ["run", str(study), "--out", str(tmp_path / "out"), "--workers=0", "--set=seeds=0:5"]
    assert main(words) == 3
    cases = select(STUDY, ["seeds=0:5"]).cases
    shard_path(tmp_path / "out" / "shards", cases[1]).unlink()
    damaged = shard_path(tmp_path / "out" / "shards", cases[4])
    damaged.write_bytes(damaged.read_bytes()[:-1])
    return tmp_path / "out", words


def test_status_dry_run_and_run_agree_on_what_is_stored(mixed, said, tally):
    """All of them read every shard, and find the damage; to look changes nothing."""
    out, words = mixed

    def state():
        paths = sorted(out.parent.rglob("*"))
        return [(p, p.stat().st_mtime_ns, p.read_bytes() if p.is_file() else "") for p in paths]

    before = state()
    found = json.loads(said(["status", str(out), "--json"]).out)
    assert found["total"] == {"done": 2, "failed": 1, "missing": 1, "damaged": 1}
    states = [(case["seed"], case["state"]) for case in found["to_compute"]]
    assert states == [(1, "missing"), (2, "failed"), (4, "damaged")]
    assert main(["verify", str(out), "--sample=0"]) == 4
    dry = [*words, "--dry-run"]
    for looking, parts in (
        (["status", str(out)], ("2 done, 1 failed, 1 missing, 1 damaged of 5 cases", "broken on demand")),
        (dry, ("2 of 5 cases to compute", "damaged: seed 4")),
        ([*dry, "--retry-failed"], ("3 of 5 cases to compute",)),
        ([*dry, "--set=scale=2"], ("replaces the dataset of scale=1.0",)),
        (["run", words[1], "--out", str(out.parent / "new"), "--dry-run"], ()),
    ):
        text = said(looking).out
        assert [part for part in parts if part not in text] == [], text
    assert state() == before
    tally()
    assert (main(words), sorted(tally())) == (3, [1, 4])
    assert (main([*words, "--retry-failed"]), tally()) == (3, [2])


def test_the_note_restores_the_study_and_the_settings(tmp_path, run, tiny):
    settings = ["seeds=5,2", "populations=floppy", "strains=0.5", "spread=3"]
    assert run(tmp_path, *settings) == 0
    loaded, selection = Folder(tmp_path).selection()
    assert loaded.path.samefile(tiny.path)
    assert [case.id for case in selection.cases] == [case.id for case in select(tiny.study, settings).cases]


def test_a_folder_can_be_moved(tmp_path, source):
    """The note names the study file relative to the folder."""
    study = source(study="plain")
    (tmp_path / "a").mkdir()
    assert main(["run", str(study), "--out", str(tmp_path / "a" / "out"), "--workers=0"]) == 0
    moved = tmp_path / "elsewhere"
    moved.mkdir()
    for name in ("a", "source"):
        (tmp_path / name).rename(moved / name)
    assert main(["verify", str(moved / "a" / "out")]) == 0


def test_a_copied_folder_needs_the_file_of_its_study(tmp_path, source, said):
    study, copied = source(study="plain"), tmp_path / "far" / "away" / "out"
    assert main(["run", str(study), "--out", str(tmp_path / "out"), "--workers=0"]) == 0
    copytree(tmp_path / "out", copied)
    for command in ("status", "verify", "figures"):
        assert "was moved or copied, and its study is not" in said([command, str(copied)], 2).err
        assert "add --study FILE" in said([command, str(copied), "--study", "ensemble"], 2).err
        said([command, str(copied), "--study", str(study)])


def test_partial_files_of_a_killed_run_are_removed_and_other_files_are_not(tmp_path):
    assert main(words_of(tmp_path)) == 0
    other = tmp_path / "download" / ".song.partial"
    ours = [tmp_path / folder / ".left.partial" for folder in (".", "shards", "figures")]
    ours += [tmp_path / "failed" / ".left.trace", tmp_path / ".stop"]
    notes = tmp_path / "notes.txt"
    for path in (other, *ours, notes):
        path.parent.mkdir(exist_ok=True)
        path.touch()
    assert main(words_of(tmp_path)) == 0
    assert other.exists() and notes.exists()
    assert not any(path.exists() for path in ours)


SHARED = ("EIO", "ESTALE")  # errors of a file system that many machines share


@pytest.mark.parametrize("name", SHARED)
@pytest.mark.parametrize("times", [2, 100])
def test_what_a_shared_file_system_refuses_is_tried_three_times_and_fails_one_network(
    tmp_path, output_of, monkeypatch, name, times
):
    real, number, tried = os.replace, getattr(errno, name), []

    def replace(source, target):
        if "seed1" in str(target) and "shards" in str(target) and len(tried) < times:
            tried.append(target)
            raise OSError(number, os.strerror(number), str(source))
        real(source, target)

    monkeypatch.setattr(os, "replace", replace)
    monkeypatch.setattr(store, "_PAUSES", (0.0, 0.0))
    err = output_of(tmp_path, study="plain", code=0 if times == 2 else 3).err
    assert ("1 case failed" in err and os.strerror(number) in err) == (times == 100)
    assert len(stamps_of(tmp_path)) == 3 + (times == 2)
    monkeypatch.undo()
    assert main([*words_of(tmp_path), "--retry-failed"]) == 0
    assert len(stamps_of(tmp_path)) == 4


def test_each_thousand_of_networks_has_a_folder_and_shards_of_one_folder_stay(tmp_path, run, tally):
    """Earlier versions stored all shards in one folder."""
    shards = tmp_path / "shards"
    assert run(tmp_path, "seeds=999,1000,2500", study="plain") == 0
    places = {str(path.relative_to(shards)).rpartition("-")[0] for path in shards.rglob("*.nc")}
    assert places == {"seed999", "1/seed1000", "2/seed2500"}
    for path in [*shards.glob("*/*.nc")]:
        path.rename(shards / path.name)
    tally()
    assert run(tmp_path, "seeds=999,1000,2500,2501", study="plain") == 0
    assert tally() == [2501]
    assert len([*shards.glob("*.nc")]) == 3 and len([*shards.glob("2/*.nc")]) == 1
    assert main(["verify", str(tmp_path)]) == 0


def test_a_resumed_run_reads_each_shard_once_at_its_start_and_several_at_once(tmp_path, run, monkeypatch):
    """A shard that was replaced is read again."""
    assert run(tmp_path, study="plain") == 0
    real, read, together = store.verified_checksum, [], threading.Barrier(2, timeout=20)

    def counted(path, *content):
        read.append(path)
        together.wait()
        return real(path, *content)

    monkeypatch.setattr(store, "verified_checksum", counted)
    assert run(tmp_path, study="plain", more=("--dry-run",)) == 0
    assert len(read) == len({*read}) == 4
    monkeypatch.undo()
    folder, selection = Folder(tmp_path), select(STUDY)
    assert {one.state for one in folder.states(selection)} == {"done"}
    path = shard_path(folder.shards, selection.cases[2])
    path.write_bytes(path.read_bytes()[:-1])
    assert [one.state for one in folder.states(selection)] == ["done", "done", "damaged", "done"]


def test_no_thread_reads_while_the_caller_has_a_result():
    """It may write with the netCDF library then, which is not thread-safe."""
    working = list[int]()

    def work(item):
        working.append(item)
        time.sleep(1e-3 * item)
        working.remove(item)
        return item

    results = []
    for item in several(work, range(20), at_once=4):
        assert not working
        results.append(item)
    assert results == list(range(20))
