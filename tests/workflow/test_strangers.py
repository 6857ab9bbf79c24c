"""A file from a stranger, well formed and rightly sealed, can at worst be refused: no crash, no memory, no hang."""

import os
import re
import resource
from pathlib import Path

import netCDF4
import numpy as np
import pytest

from critflow.cli import main
from critflow.result import IntegrityError, Status
from critflow.workflow import store
from critflow.workflow.folder import Folder, _note_text
from critflow.workflow.load import load_file
from critflow.workflow.plan import select
from critflow.workflow.provenance import code_version, shard_attributes

PLAIN = Path(__file__).with_name("plain_study.py")
STUDY = load_file(PLAIN).study
CASE = select(STUDY).cases()[1]
RIGHT = {"shared": ("i4", ("place",)), "values": ("f8", ("place",)), "total": ("f8", ())}


def shard(path, variables=RIGHT, *, places=4, layout="NETCDF3_64BIT_DATA", status=0, error=""):
    """A shard of the case as a stranger may make it."""
    with netCDF4.Dataset(path, "w", format=layout) as file:
        file.set_fill_off()
        file.createDimension("place", places)
        for name, (dtype, dims) in variables.items():
            file.createVariable(name, dtype, dims, fill_value=False)[...] = 0
        file.setncatts({**shard_attributes(STUDY, CASE), **store._identity(STUDY, CASE)})
        file.setncatts({"status": status, "error": error})
    store.append_seal(path)


def huge(path):
    """A head that declares eight exabytes: the length of its only dimension is written over."""
    shard(path)
    whole = path.read_bytes()[: -store._SEAL_LENGTH]
    at = whole.index(b"place\0\0\0") + 8
    path.write_bytes(whole[:at] + (2**60).to_bytes(8, "big") + whole[at + 8 :])
    store.append_seal(path)


def cut(path):
    """A head of eight thousand bytes of arrays, most of which are not there."""
    shard(path, places=1000)
    path.write_bytes(path.read_bytes()[:1500])
    store.append_seal(path)


def wordless(path):
    """A head that does not say whether there was an error."""
    shard(path)
    path.write_bytes(path.read_bytes()[: -store._SEAL_LENGTH])
    with netCDF4.Dataset(path, "a") as file:
        file.delncattr("error")
    store.append_seal(path)


def pipe(path):
    path.unlink(missing_ok=True)
    os.mkfifo(path)


SHARDS = {
    "another name": (
        lambda path: shard(path, RIGHT | {"intruder": ("f8", ())}),
        "'intruder', which is not in the table",
    ),
    "no arrays": (lambda path: shard(path, {}), "complete without"),
    "too large": (huge, r"declares|readable"),
    "larger than its file": (cut, "declares"),
    "an attribute less": (wordless, "Attribute not found"),
    "another type": (lambda path: shard(path, RIGHT | {"values": ("i4", ("place",))}), "'values' is int32"),
    "text for numbers": (lambda path: shard(path, RIGHT | {"values": ("S1", ("place",))}), "'values' is"),
    "other dimensions": (lambda path: shard(path, RIGHT | {"values": ("f8", ())}), "'values' is float64 along"),
    "HDF5": (lambda path: shard(path, layout="NETCDF4"), "CDF-5"),
    "classic": (lambda path: shard(path, layout="NETCDF3_CLASSIC"), "CDF-5"),
    "no such outcome": (lambda path: shard(path, status=77), "77"),
    "no outcome": (lambda path: shard(path, status="fine"), "fine"),
    "many outcomes": (lambda path: shard(path, status=np.arange(5)), "readable"),
    "a number for words": (lambda path: shard(path, error=7.0), "not text"),
    "pipe": (pipe, "not a file"),
}


@pytest.mark.timeout(30)
@pytest.mark.parametrize("kind", SHARDS)
def test_a_strange_shard_is_refused(tmp_path, kind):
    make, reason = SHARDS[kind]
    make(store.shard_path(tmp_path, CASE))
    for read in (store.read_shard, lambda *asked: store.read_ending(*asked, verify=True)):
        with pytest.raises(IntegrityError, match=reason):
            read(tmp_path, STUDY, CASE)


def test_the_shard_that_the_strange_ones_differ_from_is_read(tmp_path):
    shard(store.shard_path(tmp_path, CASE))
    assert store.read_shard(tmp_path, STUDY, CASE).status is Status.ok


def test_labels_of_another_length_are_refused(tmp_path):
    """Where a parameter gives the labels of a dimension, a shard has as many; what is not so is not even stored."""
    tiny = load_file(PLAIN.with_name("tiny_study.py")).study
    case = select(tiny).cases()[0]
    store.write_shard(tmp_path, tiny, case, Status.stalled, {"steps": np.ones(3, "i2")})
    with pytest.raises(IntegrityError, match="2 along 'strain', not 3"):
        store.write_shard(tmp_path, tiny, case, Status.stalled, {"steps": np.ones(2, "i2")})
    assert store.read_shard(tmp_path, tiny, case).arrays["steps"].shape == (3,)


def dataset(path, *, size=4, axes="seed", status="i1", spoil=lambda file: None):
    """What `show` and `verify` take for a dataset of the study, as a stranger may make it."""
    with netCDF4.Dataset(path, "w") as file:
        file.setncatts({"study": "plain", "axes": axes})
        file.createDimension("seed", size)
        file.createVariable("seed", "i4", ("seed",), chunksizes=(4,))[0] = 0
        file.createVariable("status", status, ("seed",), chunksizes=(4,))[0] = 0
        spoil(file)
    store.append_seal(path)


def groups(file):
    for _ in range(1500):
        file = file.createGroup("g")


def types(file, levels=200):
    inner = np.dtype([("a", "i4")])
    for level in range(levels):
        file.createCompoundType(inner, f"t{level}")
        inner = np.dtype([("a", inner)])


def large(file):
    file.createDimension("place", 2**40)
    file.createVariable("values", "f8", ("place",), chunksizes=(8,))


def scaled(file):
    file["status"].scale_factor = "no number"


DATASETS = {
    "too large": (lambda path: dataset(path, size=2**33), "it declares 42,949,672,960 bytes of arrays"),
    "one large array": (lambda path: dataset(path, spoil=large), "it declares 8,796,093,022,228 bytes of arrays"),
    "a group": (lambda path: dataset(path, spoil=lambda f: f.createGroup("g")), "groups or types of its own"),
    "a type": (lambda path: dataset(path, spoil=lambda f: types(f, 1)), "groups or types of its own"),
    "groups in groups": (lambda path: dataset(path, spoil=groups), "its head cannot be read"),
    "types of types": (lambda path: dataset(path, spoil=types), "crashes the netCDF library or takes for ever"),
    "long words": (
        lambda path: dataset(path, spoil=lambda f: f.createVariable("words", str, ())),
        "its 'words' is of a type that no study has",
    ),
    "decoding fails": (lambda path: dataset(path, spoil=scaled), "no status along labelled axes"),
    "no such axis": (lambda path: dataset(path, axes="nowhere"), "no status along labelled axes"),
    "axes of numbers": (lambda path: dataset(path, axes=np.arange(3)), "it names no study"),
    "outcome of decimals": (lambda path: dataset(path, status="f8"), "no status along labelled axes"),
    "no such outcome": (
        lambda path: dataset(path, spoil=lambda f: f["status"].__setitem__(0, 77)),
        "its status has no meaning",
    ),
    "only numbers": (dataset, "its status has no meaning"),
    "pipe": (pipe, "it is not a file"),
}


@pytest.mark.timeout(120)
@pytest.mark.parametrize("kind", DATASETS)
def test_a_strange_dataset_is_refused(tmp_path, capsys, kind):
    path = tmp_path / "plain.nc"
    make, reason = DATASETS[kind]
    make(path)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    assert main(["show", str(path), "--set", "seed=0", "--out", str(tmp_path / "x.png")]) in (2, 4)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 300_000  # kB
    err = capsys.readouterr().err
    assert reason in err
    assert err.count("\n") == 1
    assert not (tmp_path / "x.png").exists()


NOTES = {
    "axis of decimals": {"axes": {"seed": [0.5]}},
    "axis of lists": {"axes": {"seed": [[0], [1]]}},
    "axis of one word": {"axes": {"seed": "abc"}},
    "no axes": {"axes": [1, 2]},
    "too many cases": {"axes": {"seed": list(range(1001)), "other": list(range(1000))}},
    "parameters without names": {"parameters": [1.0]},
    "a word for a number": {"parameters": {"scale": "1.0"}},
    "a tree for a number": {"parameters": {"scale": [[[1.0]]]}},
    "names of numbers": {"study": 7},
    "a path cut short": {"file": "plain_study.py\0.txt"},
    "variables without names": {"variables": [None]},
    "a word for a version": {"study_version": "1"},
    "code of numbers": {"code": 7},
    "a table of numbers": {"table": 7},
    "files without digests": {"files": {"plain_study.py": None}},
    "a file cut short": {"files": {"plain_study.py\0": ""}},
    "files without names": {"files": [["plain_study.py"]]},
}


@pytest.mark.parametrize("kind", NOTES)
def test_a_strange_note_is_refused(tmp_path, kind):
    loaded, folder = load_file(PLAIN), Folder(tmp_path)
    right = {
        "schema_version": store.SCHEMA_VERSION,
        "study": "plain",
        "study_version": 1,
        "file": os.path.relpath(PLAIN, tmp_path),
        "axes": {"seed": [0, 1]},
        "parameters": dict(STUDY.parameters),
        "variables": [],
        "table": STUDY.table_digest,
        "code": code_version(STUDY),
        "files": loaded.files,
    }
    folder.note.write_text(_note_text(right))
    assert folder.selection()[0].path.samefile(loaded.path)
    folder.note.write_text(_note_text(right | NOTES[kind]))
    with pytest.raises(IntegrityError, match=r"study\.json"):
        folder.selection()


def test_deep_text_is_refused(tmp_path):
    folder = Folder(tmp_path)
    folder.note.write_text("[" * 100_000)
    with pytest.raises(IntegrityError, match="not readable"):
        folder.selection()


def test_nothing_is_unpickled_from_disk():
    """Only what dask carries between the processes of one run is pickled, and dask does that."""
    for path in Path(store.__file__).parents[1].rglob("*.py"):
        source = path.read_text(encoding="utf-8")
        assert not re.search(r"\b(pickle|cloudpickle|dill|marshal|shelve|joblib)\b|\bnp\.load\(", source), path
