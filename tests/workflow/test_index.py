"""The index of shards: it makes counting fast, and whatever happens to it, never wrong."""

import os

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from critflow.result import Status
from critflow.workflow import run as engine
from critflow.workflow import status as looking
from critflow.workflow.folder import Folder
from critflow.workflow.index import Stored, append_to_index, read_index
from critflow.workflow.plan import select
from critflow.workflow.status import folder_status


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    """A folder of a run with a failed case, and what its index holds."""
    return tmp_path_factory.mktemp("index")


@pytest.fixture
def folder(done, run):
    if not (done / "tiny.nc").exists():
        assert run(done, "trouble=1-random") == 3
    return Folder(done)


@pytest.fixture
def opened(monkeypatch):
    """The cases whose shards are opened to be counted."""
    seen = []

    def read(*where, **how):
        seen.append(where[2].id)
        return read_ending(*where, **how)

    read_ending = looking.read_ending
    monkeypatch.setattr(looking, "read_ending", read)
    return seen


def test_no_shard_is_opened_that_the_index_knows(folder, opened):
    assert folder_status(folder).total == {"done": 7, "failed": 1}
    assert opened == []


def test_a_failed_case_is_named_and_explained_without_its_shard(folder, opened):
    found = folder_status(folder)
    assert opened == []
    assert [found.plan.case_at(place).values for place in found.todo] == [{"seed": 1, "population": "random"}]
    assert found.why == {found.todo[0]: ("failed", "asked for")}


def test_without_an_index_every_shard_is_opened_and_the_next_run_writes_it_anew(folder, run, opened):
    folder.index.unlink()
    assert folder_status(folder).total == {"done": 7, "failed": 1}
    assert len(opened) == 8
    assert run(folder.path, "trouble=1-random") == 3
    del opened[:]
    assert folder_status(folder).total == {"done": 7, "failed": 1}
    assert opened == []


def test_a_run_that_was_stopped_leaves_an_index_of_what_it_stored(tmp_path, run, opened, monkeypatch):
    monkeypatch.setattr(engine, "write_dataset", lambda *_: 1 / 0)
    assert run(tmp_path, "trouble=1-random") == 1
    assert folder_status(Folder(tmp_path)).total == {"done": 7, "failed": 1}
    assert opened == []


def test_a_shard_that_changed_is_opened(folder, opened):
    path = next(folder.shards.glob("seed0-random*.nc"))
    whole, before = path.read_bytes(), path.stat()
    path.write_bytes(whole[:-10])
    assert folder_status(folder).total == {"done": 6, "failed": 1, "damaged": 1}
    path.write_bytes(whole)
    os.utime(path, ns=(before.st_atime_ns, before.st_mtime_ns))
    assert folder_status(folder).total == {"done": 7, "failed": 1}
    assert opened == [path.stem]


def test_an_index_cut_at_any_byte_counts_the_same(folder):
    """What is left tells nothing wrong, the shards tell the rest, and what is added behind a torn line counts."""
    whole, table = folder.index.read_bytes(), folder.selection()[1].study.table_digest
    right = read_index(folder.index)
    case_id, entry = list(right.items())[-1]
    stored = Stored(case_id, int(entry.split(" ")[3]), "code")
    try:
        for length in range(len(whole)):
            folder.index.write_bytes(whole[:length])
            assert read_index(folder.index).items() <= right.items()
            if length % 10 == 0:  # shards are opened
                assert folder_status(folder).total == {"done": 7, "failed": 1}
            append_to_index(folder.index, folder.shards, table, [stored])
            assert case_id in read_index(folder.index)
    finally:
        folder.index.write_bytes(whole)


@settings(max_examples=40)
@given(st.data())
def test_a_damaged_line_means_nothing(tmp_path_factory, data):
    shards = tmp_path_factory.mktemp("shards")
    for name in ("one", "two"):
        (shards / f"{name}.nc").write_bytes(b"x")
    index = shards / "index"
    append_to_index(index, shards, "table", [Stored("one", 0, "code"), Stored("two", 8, "code", "division by zero")])
    right = read_index(index)
    whole = bytearray(index.read_bytes())
    whole[data.draw(st.integers(0, len(whole) - 1))] ^= 1 << data.draw(st.integers(0, 7))
    index.write_bytes(whole)
    assert read_index(index).items() <= right.items()


def test_the_last_line_counts(tmp_path):
    (tmp_path / "one.nc").write_bytes(b"x")
    for status in (Status.failed, Status.ok):
        append_to_index(tmp_path / "index", tmp_path, "table", [Stored("one", status, "code")])
    assert read_index(tmp_path / "index")["one"].split()[3] == "0"


def test_ids_all_at_once_are_those_of_the_cases(tiny):
    words = ["seeds=3,0:2", "populations=wide,floppy", "strains=0.1,0.2", 'how=é " \\ ]']
    for more in ((), ("variables=residual",)):
        selection = select(tiny.study, [*words, *more])
        assert list(selection.ids()) == [case.id for case in selection.cases()]
