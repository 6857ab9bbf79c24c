"""Shards: what is written comes back, and nothing else is taken for it."""

import os
from dataclasses import replace

import numpy as np
import pytest

from critflow.result import EnvironmentFailure, IntegrityError, Status
from critflow.workflow import store
from critflow.workflow.plan import select
from critflow.workflow.provenance import code_version


@pytest.fixture
def case(tiny):
    return select(tiny.study).cases()[0]


@pytest.fixture
def path(tmp_path, tiny, case):
    """A shard of the case, complete."""
    arrays = tiny.study.arrays(tiny.study.case(case.parameters, **case.values), case.parameters)
    del arrays["status"]
    store.write_shard(tmp_path, tiny.study, case, Status.stalled, arrays)
    return store.shard_path(tmp_path, case)


def test_what_is_written_comes_back(tmp_path, tiny, case, path):
    shard = store.read_shard(tmp_path, tiny.study, case)
    again = tiny.study.arrays(tiny.study.case(case.parameters, **case.values), case.parameters)
    del again["status"]
    assert shard.status is Status.stalled
    assert {n: (a.dtype, a.tobytes()) for n, a in shard.arrays.items()} == {
        n: (a.dtype, a.tobytes()) for n, a in again.items()
    }
    assert [p.name for p in tmp_path.iterdir()] == [path.name]  # nothing was left beside it


def test_nothing_is_there_before(tmp_path, tiny, case):
    assert store.read_shard(tmp_path, tiny.study, case) is None
    assert store.read_ending(tmp_path, tiny.study, case, verify=False).status is Status.missing


def test_a_file_cut_anywhere_is_recognised(tmp_path, tiny, case, path):
    """From the head and the end alone, as `critflow status` looks, and to the last byte, as `critflow run` does."""
    whole = path.read_bytes()
    for length in [*range(0, len(whole), 7), len(whole) - 1]:
        path.write_bytes(whole[:length])
        for verify in (True, False):
            with pytest.raises(IntegrityError):
                store.read_ending(tmp_path, tiny.study, case, verify=verify)
        with pytest.raises(IntegrityError):
            store.read_shard(tmp_path, tiny.study, case)


def test_every_flipped_byte_is_recognised(tmp_path, tiny, case, path):
    whole = path.read_bytes()
    for at in range(len(whole)):
        path.write_bytes(whole[:at] + bytes([whole[at] ^ 1]) + whole[at + 1 :])
        with pytest.raises(IntegrityError, match=r"checksum|seal"):
            store.read_ending(tmp_path, tiny.study, case, verify=True)


def test_another_schema_is_recognised(tmp_path, tiny, case, path, monkeypatch):
    now = store.SCHEMA_VERSION
    monkeypatch.setattr(store, "SCHEMA_VERSION", now + 1)
    with pytest.raises(IntegrityError, match=f"schema_version is {now}, not {now + 1}"):
        store.read_shard(tmp_path, tiny.study, case)


def test_another_table_is_recognised(tmp_path, tiny, case, path):
    """A study that measures more than before must not pass its old shards off as complete."""
    changed = replace(tiny.study, variables=tiny.study.variables[2:])
    with pytest.raises(IntegrityError, match="its table is"):
        store.read_shard(tmp_path, changed, case)


def test_a_failed_write_leaves_the_old_file_and_nothing_beside_it(tmp_path, tiny, case, path, monkeypatch):
    before = path.read_bytes()

    def full(*_):
        raise OSError(28, os.strerror(28))

    monkeypatch.setattr(store.os, "replace", full)
    with pytest.raises(EnvironmentFailure, match="No space left"):
        store.write_shard(tmp_path, tiny.study, case, Status.stalled, {})
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == [path.name]


def test_what_is_written_is_read_back_before_it_counts(tmp_path, tiny, case, path, monkeypatch):
    """A library or disk that loses what it was given is found out while the old file is still there."""
    before = path.read_bytes()
    read = store._read

    def forgetful(*asked):
        shard = read(*asked)
        return replace(shard, arrays={name: array + 1 for name, array in shard.arrays.items()})

    monkeypatch.setattr(store, "_read", forgetful)
    with pytest.raises(EnvironmentFailure, match="read back"):
        store.write_shard(tmp_path, tiny.study, case, Status.stalled, {"residual": np.array(1.0)})
    assert path.read_bytes() == before


def test_the_file_is_synced_before_it_is_renamed_and_the_folder_after(tmp_path, tiny, case, monkeypatch):
    calls = []
    for name in ("fsync", "replace"):
        real = getattr(os, name)
        monkeypatch.setattr(store.os, name, lambda *a, name=name, real=real: (calls.append(name), real(*a))[1])
    store.write_shard(tmp_path, tiny.study, case, Status.stalled, {})
    assert calls == ["fsync", "replace", "fsync"]


def test_the_seal_of_a_large_file_is_that_of_all_its_bytes(tmp_path):
    path = tmp_path / "large"
    path.write_bytes(bytes(3 * 2**20 + 7))  # read in pieces of a megabyte
    assert not store.check_seal(path)
    store.append_seal(path)
    assert store.check_seal(path)
    for at in (0, 2**20, 3 * 2**20 + 6):
        with open(path, "rb+") as file:
            file.seek(at)
            file.write(b"\1")
            file.flush()
            with pytest.raises(IntegrityError, match="checksum"):
                store.check_seal(path)
            file.seek(at)
            file.write(b"\0")
    assert store.check_seal(path)


def test_a_head_that_does_not_say_what_computed_it_has_unknown_code(tiny, path):
    assert store.read_code(path) == code_version(tiny.study)
    path.write_bytes(b"CDF\x05 and no more")
    assert store.read_code(path) == "unknown code"
