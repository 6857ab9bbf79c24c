"""A damaged file of any kind is never used: `verify` names it, and `run` makes exactly it again."""

import shutil

import netCDF4
import numpy as np
import pytest
from disturbed import PLAIN, STUDY, contents_of, stamps_of, words_of

from critflow.command.main import main
from critflow.engine.settings import select
from critflow.engine.store import shard_path
from critflow.engine.study import Study

CASES = select(STUDY).cases


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """The folder of an undisturbed run; tests copy it."""
    folder = tmp_path_factory.mktemp("finished") / "out"
    assert main(words_of(folder)) == 0
    return folder


@pytest.fixture
def out(tmp_path, finished):
    """A copy in the same parent folder, so that its note names the same study file."""
    copy = finished.parent / tmp_path.name
    shutil.copytree(finished, copy)
    yield copy
    shutil.rmtree(copy)


def cut(part):
    return lambda path: path.write_bytes(path.read_bytes()[: int(path.stat().st_size * part)])


def flip(part):
    """One bit at a part of the length, from the start, or at a number of bytes from the end."""

    def damage(path):
        whole = bytearray(path.read_bytes())
        whole[int(part * len(whole)) if part >= 0 else part] ^= 1
        path.write_bytes(whole)

    return damage


def folder(path):
    path.unlink()
    path.mkdir()
    (path / "precious").write_text("not ours to delete")


ANY = {
    "empty": lambda path: path.write_bytes(b""),
    "one byte": lambda path: path.write_bytes(path.read_bytes()[:1]),
    **{f"cut at {part:.0%}": cut(part) for part in (0.25, 0.75, 0.99)},
    "text": lambda path: path.write_text("not a result " * 100),
    "folder": folder,
    "header": flip(0.0),
}


def another_case(path):
    shutil.copy(next(other for other in sorted(path.parent.glob("*.nc")) if other != path), path)


def another_run(path):
    """The same seed with another parameter."""
    other = path.parent.parent / "other"
    assert main(words_of(other, ["scale=2"])) == 0
    shutil.copy(next((other / "shards").glob(f"{path.name.split('-')[0]}-*")), path)
    shutil.rmtree(other)


def edited(change):
    """Changed by a program that knows how netCDF files are written."""

    def damage(path):
        with netCDF4.Dataset(path, "a") as file:
            change(file)

    return damage


def change_number(file):
    file["total"][1] = 77.0


def enormous(path):
    """The length of a dimension in the header, as large as the netCDF library finds no memory for."""
    whole = bytearray(path.read_bytes())
    whole[16] ^= 2
    path.write_bytes(whole)


def flip_number(path):
    """One bit of a number, which the netCDF library cannot detect."""
    whole = path.read_bytes()
    number = next(n for n in (np.arange(1.0, 5.0, dtype=kind).tobytes() for kind in ("<f8", ">f8")) if n in whole)
    at = whole.index(number) + 13
    path.write_bytes(whole[:at] + bytes([whole[at] ^ 1]) + whole[at + 1 :])


REPORTS = ("claims.json", "claims.md", "summary.json")
KINDS = {
    "shard": ANY
    | {f"bit at {part:.0%}": flip(part) for part in (0.2, 0.4, 0.6, 0.8, 0.95)}
    | {
        "last byte": flip(-1),
        "enormous": enormous,
        "number": flip_number,
        "another case": another_case,
        "another run": another_run,
    },
    "dataset": ANY
    | {
        "number": flip_number,
        "edited number": edited(change_number),
        "edited unit": edited(lambda file: file["total"].setncattr("units", "m")),
        "edited parameters": edited(lambda file: file.setncattr("parameters", "{}")),
        "one variable more": edited(lambda file: file.createVariable("more", "i4", ("seed",))),
    },
    "study.json": ANY | {"edited setting": lambda path: path.write_text(path.read_text().replace("1.0", "2.0"))},
    **{name: {damage: ANY[damage] for damage in ("text", "folder")} for name in REPORTS},
}


@pytest.mark.parametrize(("kind", "damage"), [(kind, damage) for kind, table in KINDS.items() for damage in table])
def test_a_damaged_file_is_named_and_made_again(out, finished, tally, said, kind, damage):
    path = {"shard": shard_path(out / "shards", CASES[1]), "dataset": out / "plain.nc"}.get(kind, out / kind)
    KINDS[kind][damage](path)
    before = stamps_of(out)
    tally()
    err = said(["verify", str(out), "--sample=0"], 4).err
    assert path.name in err and "Traceback" not in err
    undamaged = [case.id for case in CASES if case.id != path.stem]
    assert damage == "another case" or not any(name in err for name in undamaged)
    assert stamps_of(out) == before  # verify changes nothing
    assert "Traceback" not in said(words_of(out)).err
    assert tally() == ([1] if kind == "shard" else [])
    assert {name for name, stamp in stamps_of(out).items() if stamp != before.get(name)} == (
        {path.name} if kind == "shard" else set()
    )
    assert contents_of(out / "plain.nc") == contents_of(finished / "plain.nc")
    for name in ("study.json", *REPORTS):
        assert (out / name).read_bytes() == (finished / name).read_bytes()
    assert len(list(out.rglob("precious"))) == (damage == "folder")
    assert main(["verify", str(out), "--sample=0"]) == 0


@pytest.mark.parametrize("damage", ["empty", "cut at 25%", "text", "folder", "deleted"])
def test_a_damaged_record_of_a_failed_case_changes_no_result(tmp_path, tally, damage):
    """Its existence says that the case failed; without it the case is computed again."""
    study = tmp_path / "plain.py"
    study.write_text(PLAIN.read_text().replace("broken: set[int] = set()", "broken = {2}"))
    words = ["run", str(study), *words_of(tmp_path / "out")[2:]]
    assert main(words) == 3
    (path,) = (tmp_path / "out" / "failed").iterdir()
    whole, before = path.read_text(), contents_of(tmp_path / "out" / "plain.nc")
    (ANY | {"deleted": lambda file: file.unlink()})[damage](path)
    tally()
    lost = damage in ("folder", "deleted")
    assert main(["verify", str(tmp_path / "out"), "--sample=0"]) == (4 if lost else 0)
    assert (main(words), tally()) == (3, [2] * lost)
    assert (main([*words, "--retry-failed"]), tally()) == (3, [2])
    assert path.read_text() == whole
    assert contents_of(tmp_path / "out" / "plain.nc") == before


@pytest.mark.parametrize("words", [["figures"], ["show", "--set", "seed=0"]])
def test_nothing_is_drawn_from_a_dataset_with_a_flipped_bit(out, said, words):
    flip_number(out / "plain.nc")
    place = str(out if words == ["figures"] else out / "plain.nc")
    assert "plain.nc" in said([words[0], place, *words[1:]], 4).err


@pytest.mark.parametrize(
    ("elsewhere", "change", "code"), [(False, 0.0, 0), (False, 1e-15, 4), (True, 0.9e-6, 0), (True, 1e-5, 4)]
)
def test_a_case_computed_again_is_the_same_to_the_bit_and_elsewhere_to_a_part_of_its_largest_number(
    out, said, monkeypatch, elsewhere, change, code
):
    computed = Study.computed

    def perturbed(study, parameters, values):
        arrays = computed(study, parameters, values)
        numbers = np.array(arrays["values"])
        numbers[0] += change * numbers.max()  # the smallest one
        return arrays | {"values": numbers}

    monkeypatch.setattr(Study, "computed", perturbed)
    if elsewhere:
        monkeypatch.setattr("critflow.engine.verify.environment", lambda: "another machine")
    assert ("values is another one" in said(["verify", str(out), "--sample=4"], code).err) == (code == 4)
