"""No damaged, foreign or hostile file is believed: `verify` names it, and `run` computes or writes exactly it anew."""

import json
import os
import shutil
from pathlib import Path
from zlib import crc32

import netCDF4
import numpy as np
import pytest
import xarray as xr

from critflow.cli import main
from critflow.result import IntegrityError
from critflow.workflow import store
from critflow.workflow.folder import Folder, _note_text
from critflow.workflow.index import read_index
from critflow.workflow.load import load_file
from critflow.workflow.plan import select
from critflow.workflow.status import folder_status
from critflow.workflow.store import _SEAL_LENGTH, SCHEMA_VERSION, append_seal, shard_path

PLAIN = Path(__file__).with_name("plain_study.py")
CASES = select(load_file(PLAIN).study).cases()


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """The folder of an undisturbed run, not to be touched."""
    folder = tmp_path_factory.mktemp("finished") / "out"
    assert main(["run", str(PLAIN), "--out", str(folder), "--workers", "0"]) == 0
    return folder


@pytest.fixture
def out(tmp_path, finished):
    """A copy of it beside it, so that its note names the same study file, to be damaged."""
    copy = finished.parent / tmp_path.name
    shutil.copytree(finished, copy)
    yield copy
    shutil.rmtree(copy)


def cut(part):
    return lambda path: path.write_bytes(path.read_bytes()[: int(path.stat().st_size * part)])


def flip(part):
    """One bit, at a place given as a part of the length or as words that stand there."""

    def damage(path):
        whole = bytearray(path.read_bytes())
        at = whole.index(part) if isinstance(part, bytes) else int(part * len(whole))
        whole[at] ^= 1
        path.write_bytes(whole)

    return damage


def flip_last_number(path):
    """One bit of the data, which stand just before the seal: only the checksum can tell."""
    whole = bytearray(path.read_bytes())
    whole[-_SEAL_LENGTH - 1] ^= 1
    path.write_bytes(whole)


def as_folder(path):
    path.unlink()
    path.mkdir()
    (path / "precious").write_text("not ours to delete")


def of_schema(version):
    """The same in another layout, as an older or a newer release writes it: whole and sealed, but not for this one."""

    def damage(path):
        if path.suffix == ".json":
            note = json.loads(path.read_text())
            del note["sha256"]
            path.write_text(_note_text(note | {"schema_version": version}))
            return
        resealed(lambda file: file.setncattr("schema_version", version))(path)

    return damage


def text(path):
    path.write_text("not what was looked for " * 100)


COMMON = {
    "empty": lambda path: path.write_bytes(b""),
    "one byte": lambda path: path.write_bytes(path.read_bytes()[:1]),
    **{f"cut at {part:.0%}": cut(part) for part in (0.25, 0.5, 0.75, 0.99)},
    "header": flip(0.0),
    "data": flip(0.7),
    "text": text,
    "folder": as_folder,
    "older": of_schema(SCHEMA_VERSION - 1),
    "newer": of_schema(SCHEMA_VERSION + 1),
}


def another_case(path):
    shutil.copy(next(other for other in sorted(path.parent.glob("*.nc")) if other != path), path)


def another_dataset(path):
    with xr.open_dataset(path) as before:
        changed = before.load()
    changed["total"] = changed.total + 1
    path.unlink()
    changed.to_netcdf(path)
    append_seal(path)


def resealed(change):
    """The file changed by someone who knows how it is sealed."""

    def damage(path):
        path.write_bytes(path.read_bytes()[: -store._SEAL_LENGTH])
        with netCDF4.Dataset(path, "a") as file:
            change(file)
        append_seal(path)

    return damage


def another_note(path):
    path.write_text(path.read_text().replace('"scale": 1.0', '"scale": 2.0'))


KINDS = {
    "shard": COMMON | {"attribute": flip(b"status"), "another": another_case, "last number": flip_last_number},
    "dataset": COMMON
    | {
        "attribute": flip(b"long_name"),
        "another": another_dataset,
        "unsealed": lambda path: os.truncate(path, path.stat().st_size - _SEAL_LENGTH),
        "other units": resealed(lambda file: file["total"].setncattr("units", "m")),
        "other settings": resealed(lambda file: file.setncattr("parameters", "{}")),
        "other origins": resealed(lambda file: file.setncattr("shards_sha256", "0" * 64)),
        "one array more": resealed(lambda file: file.createVariable("more", "i4", ("seed",))),
    },
    "study.json": COMMON | {"attribute": flip(b"seed"), "another": another_note},
}


def file_of(kind, out):
    """The file to damage, by its kind or its name."""
    if kind == "shard":
        return shard_path(out / "shards", CASES[1])
    return out / ("plain.nc" if kind == "dataset" else kind)


@pytest.fixture
def named(capsys):
    """`named(out, path)` runs `verify` and tells that exactly this file was named, in one line, with exit code 4."""

    def check(out, path):
        capsys.readouterr()
        code = main(["verify", str(out)])
        complaints = [line for line in capsys.readouterr().err.splitlines() if "things are wrong" not in line]
        assert code == 4, complaints
        assert all(path.name in line for line in complaints if "thing is wrong" not in line), complaints
        assert len(complaints) <= 2, complaints
        assert not any("Traceback" in line for line in complaints)

    return check


@pytest.fixture
def mended(stamps, contents, finished, capsys):
    """`mended(out, before, path)` runs again and tells that only this file was made anew and all is as it was."""

    def check(out, before, path):
        assert main(["run", str(PLAIN), "--out", str(out), "--workers", "0"]) == 0
        assert "Traceback" not in capsys.readouterr().err
        after = stamps(out)
        changed = {name for name in after if after[name] != before.get(name)}
        assert changed == ({path.name} if path.parent == out / "shards" else set())
        assert contents(out / "plain.nc") == contents(finished / "plain.nc")
        for name in ("study.json", "claims.json", "claims.md", "summary.json"):
            assert (out / name).read_bytes() == (finished / name).read_bytes()

    return check


@pytest.mark.parametrize(("kind", "damage"), [(kind, damage) for kind, table in KINDS.items() for damage in table])
def test_a_damaged_file_is_named_and_made_anew(out, stamps, named, mended, kind, damage):
    path, before = file_of(kind, out), stamps(out)
    KINDS[kind][damage](path)
    named(out, path)
    mended(out, {name: stamp for name, stamp in before.items() if name != path.name}, path)
    assert damage != "folder" or len(list(out.rglob("precious"))) == 1


def swapped(path):
    """Two lines tell each other's cases, with their own checksums: as in the index of another folder."""
    entries = sorted(read_index(path).items())
    bodies = [f"{case_id} {entry}" for (case_id, _), (_, entry) in zip(entries, entries[1:] + entries[:1], strict=True)]
    path.write_bytes(b"".join(b"%s %08x\n" % (body.encode(), crc32(body.encode())) for body in bodies))


def of_other_lines(path):
    """As an older or a newer release might write them: with a good checksum, and a field more."""
    bodies = [f"{case_id} v2 {entry}" for case_id, entry in read_index(path).items()]
    path.write_bytes(b"".join(b"%s %08x\n" % (body.encode(), crc32(body.encode())) for body in bodies))


INDEX = {name: damage for name, damage in COMMON.items() if name not in ("older", "newer")} | {
    "attribute": flip(0.3),
    "another": swapped,
    "another layout": of_other_lines,
    "deleted": os.unlink,
}


@pytest.mark.parametrize("damage", INDEX)
def test_a_damaged_index_is_not_believed_and_made_good(out, mended, stamps, capsys, damage):
    """It only makes counting fast: nothing is wrong with the folder, and the next run writes what is missing of it."""
    (out / "shards" / CASES[0].id).with_suffix(".nc").unlink()
    before = stamps(out)
    INDEX[damage](out / "shards.index")
    assert folder_status(Folder(out)).total == {"done": 3, "missing": 1}
    assert main(["verify", str(out)]) == 4  # the dataset holds a case more than the shards
    assert "shards.index" not in capsys.readouterr().err
    mended(out, before, shard_path(out / "shards", CASES[0]))
    found = folder_status(Folder(out))
    assert found.total == {"done": 4}
    assert found.read == []  # the index knows all
    assert damage != "folder" or len(list(out.rglob("precious"))) == 1


@pytest.mark.parametrize("kind", ["claims.json", "claims.md", "summary.json"])
@pytest.mark.parametrize("damage", ["empty", "cut at 99%", "header", "data", "text", "folder"])
def test_a_damaged_report_is_named(out, named, kind, damage):
    path = file_of(kind, out)
    COMMON[damage](path)
    named(out, path)


def test_a_folder_where_a_file_goes_is_set_aside(out, mended, stamps):
    before = stamps(out)
    for name in ("claims.json", "claims.md", "summary.json"):
        as_folder(out / name)
    mended(out, before, out / "claims.json")
    assert len(list(out.rglob("precious"))) == 3


def test_a_note_cut_anywhere_is_refused_and_written_anew(out, tmp_path):
    """Nothing of half a note is believed, and a run needs none."""
    folder, loaded = Folder(out), load_file(PLAIN)
    whole = folder.note.read_bytes()
    for length in range(len(whole)):
        folder.note.write_bytes(whole[:length])
        with pytest.raises(IntegrityError, match=r"study\.json is not readable"):
            folder.selection()
        folder.refuse_other(loaded)
    with folder.held(loaded, select(loaded.study)):
        assert folder.note.read_bytes() == whole


def test_every_flipped_bit_of_a_note_is_refused(out):
    folder = Folder(out)
    whole = folder.note.read_bytes()
    for at in range(len(whole)):
        for bit in (1, 4, 32):
            folder.note.write_bytes(whole[:at] + bytes([whole[at] ^ bit]) + whole[at + 1 :])
            with pytest.raises(IntegrityError, match=r"study\.json is not readable"):
                folder.selection()


@pytest.mark.parametrize("words", [["figures"], ["show", "--set", "seed=0"]])
def test_nothing_is_read_off_a_dataset_with_a_flipped_bit(out, capsys, words):
    path = out / "plain.nc"
    whole = path.read_bytes()
    at = whole.index(np.arange(2.0, 6.0).tobytes())  # numbers, of which the netCDF library knows no checksum
    path.write_bytes(whole[:at] + bytes([whole[at] ^ 1]) + whole[at + 1 :])
    assert main([words[0], str(out if words == ["figures"] else path), *words[1:]]) == 4
    assert "checksum" in capsys.readouterr().err
