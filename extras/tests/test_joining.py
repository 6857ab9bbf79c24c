"""How critflow-extras joins the scene: its words after `critflow`, its quantities and public names, by entry points."""

import json
import subprocess
import sys
import tomllib
from importlib.metadata import distribution
from pathlib import Path

import pytest

import critflow as cf
from critflow.command.main import main
from critflow.extensions import joined, loaded, more, quantity_entry

TINY = str(Path(__file__).parents[2] / "tests" / "engine" / "tiny_study.py")
WORDS = ("convert", "examine", "explore", "make")
# What takes the time of a start, and no help needs.
SLOW = ("scipy", "xarray", "matplotlib", "networkx", "tornado")

HELP = """
import json, sys
from critflow.command.main import main
main(["--help"])
print(json.dumps(sorted(sys.modules)))
"""


def test_help_has_the_words_and_imports_nothing_that_computes():
    done = subprocess.run([sys.executable, "-c", HELP], check=True, capture_output=True, text=True)
    text, _, modules = done.stdout.rstrip().rpartition("\n")
    for word in WORDS:
        assert f"  {word} " in text
    loaded_modules = json.loads(modules)
    assert not {name.split(".")[0] for name in loaded_modules}.intersection(SLOW)
    ours = {name for name in loaded_modules if name.count(".") == 2 and name.startswith("critflow_extras.")}
    assert {name.rpartition(".")[2] for name in ours} == {"command", "hints"}
    assert done.stderr == ""


def test_both_distributions_have_one_version_and_one_python():
    root = Path(__file__).parents[2]
    scene, extras = (tomllib.loads((f / "pyproject.toml").read_text())["project"] for f in (root, root / "extras"))
    assert extras["version"] == scene["version"] and f"critflow=={scene['version']}" in extras["dependencies"]
    assert extras["requires-python"] == scene["requires-python"]


@pytest.mark.parametrize("word", WORDS)
def test_each_word_explains_itself(capsys, word):
    assert main([word, "--help"]) == 0
    text = capsys.readouterr().out
    assert f"Usage: critflow {word} [OPTIONS]" in text
    assert all(len(line) <= 80 for line in text.splitlines())


def test_every_entry_point_is_one_that_can_be_used():
    for group in ("commands", "quantities"):
        ours = distribution("critflow-extras").entry_points.select(group=f"critflow.{group}")
        assert ours and {one.name for one in ours} <= set(joined(group))
        for entry in joined(group).values():
            assert callable(loaded(entry)), entry


def test_names_of_quantities_lead_to_their_entry_points():
    network = cf.lattice("honeycomb", 2, 2)
    for name in ("C_B", "C_xxyy", "S_xy", "length[0]", "local[0-2,1-3]", "onset[dilation]", "stiffening[dilation]"):
        assert quantity_entry(name).module.startswith("critflow_extras."), name
        assert cf.quantity(network, name).name


@pytest.mark.parametrize(("out", "word"), [("nowhere/x.png", "no folder"), ("x.doc", "ending")])
def test_a_wrong_file_for_the_drawing_of_a_case_is_one_sentence(tmp_path, monkeypatch, capsys, out, word):
    monkeypatch.chdir(tmp_path)
    assert main(["run", TINY, "--workers", "0", "--set", "seeds=0", "--out", "tiny"]) == 0
    capsys.readouterr()
    assert main(["show", "tiny/tiny.nc", "--out", out]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert word in line


def test_a_name_of_critflow_extras_is_shown_its_place():
    with pytest.raises(AttributeError, match="from critflow_extras import design"):
        _ = cf.design
    with pytest.raises(ImportError, match="from critflow_extras import design"):
        exec("from critflow import design")
    assert not hasattr(cf, "design")
    assert more("names") == ""
