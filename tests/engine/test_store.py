"""Stored cases: what is written is read back, and nothing else is accepted."""

import os
from dataclasses import replace

import netCDF4
import numpy as np
import pytest

from critflow.engine import store
from critflow.engine.settings import select
from critflow.engine.store import StoredCase, read_shard, shard_path, write_shard
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
