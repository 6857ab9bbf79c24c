"""What is read off a dataset says what it was made from, and is known again."""

import json
from hashlib import sha256
from pathlib import Path

import pytest
import xarray as xr

from critflow.cli import main

TINY = Path(__file__).with_name("tiny_study.py")


@pytest.fixture
def made(tmp_path):
    """A folder of the tiny study, and the words that run it."""
    words = ["run", str(TINY), "--out", str(tmp_path), "--workers", "0"]
    assert main(words) == 0
    return tmp_path, words


def manifest(folder):
    return json.loads((folder / "manifest.json").read_text())


def test_every_file_is_named_with_its_checksum_and_what_made_the_dataset(made):
    folder, _ = made
    said = manifest(folder)
    files = {str(path.relative_to(folder)) for path in (*folder.glob("figures/*"), *folder.glob("claims.*"))}
    assert files
    assert set(said["files"]) == files | ({"summary.json"} if (folder / "summary.json").exists() else set())
    assert {name: sha256((folder / name).read_bytes()).hexdigest() for name in said["files"]} == said["files"]
    with xr.open_dataset(folder / "tiny.nc") as dataset:
        assert said["dataset"] == dataset.attrs
    assert "critflow run tiny_study.py" in said["dataset"]["history"]


def test_figures_in_another_format_stand_beside_the_first(made, monkeypatch):
    folder, words = made
    first = manifest(folder)["files"]
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "1")
    assert main(words) == 0  # the same data, at another time
    assert main(["figures", str(folder), "--format", "svg"]) == 0
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "2")
    assert main(words) == 0
    both = manifest(folder)["files"]
    assert first.items() < both.items()
    assert any(name.endswith(".svg") for name in both)
    assert main([*words, "--set", "seeds=0:2"]) == 0  # another dataset: the vector figures are of the old one
    assert not any(name.endswith(".svg") for name in manifest(folder)["files"])


def change(path):
    path.write_bytes(path.read_bytes() + b" ")


def remove(path):
    path.unlink()


DAMAGE = {
    "a figure changed": ("figures/*.png", change, "is not the file that was written"),
    "a figure removed": ("figures/*.png", remove, "is missing"),
    "the manifest removed": ("manifest.json", remove, "does not say"),
    "the manifest empty": ("manifest.json", lambda path: path.write_bytes(b""), "does not say"),
    "the manifest cut": ("manifest.json", lambda path: path.write_bytes(path.read_bytes()[:-9]), "does not say"),
    "the manifest a list": ("manifest.json", lambda path: path.write_text("[1]"), "does not say"),
    "the manifest too deep": ("manifest.json", lambda path: path.write_text("[" * 100_000), "does not say"),
    "the manifest without files": ("manifest.json", lambda path: path.write_text('{"dataset": {}}'), "does not say"),
    "files no table": ("manifest.json", lambda path: path.write_text('{"dataset": {}, "files": 1}'), "does not say"),
}


@pytest.mark.parametrize("damage", DAMAGE)
def test_a_changed_file_is_named_and_made_anew(made, capsys, damage):
    folder, words = made
    pattern, harm, sentence = DAMAGE[damage]
    harm(next(folder.glob(pattern)))
    capsys.readouterr()
    assert main(["verify", str(folder)]) == 4
    assert sentence in capsys.readouterr().err
    assert main(words) == 0
    assert main(["verify", str(folder)]) == 0
