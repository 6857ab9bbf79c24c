"""How packages join the scene by entry points, broken ones too, and what is said where critflow-extras is missing."""

import os
import subprocess
import sys

import pytest

from critflow import InputError, extensions, lattice, quantity
from critflow.command.main import main
from critflow.extensions import from_extras
from critflow.result import EnvironmentFailure


@pytest.fixture
def joining(tmp_path, monkeypatch):
    """`joining(entries, **modules)` puts a distribution of modules on the path, with the lines of its entry points."""
    # Not those that this environment has.
    monkeypatch.setattr(extensions, "has_extras", lambda: True)

    def join(entries, name="guest", **modules):
        info = tmp_path / f"{name}-1.dist-info"
        info.mkdir()
        (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1\n")
        (info / "entry_points.txt").write_text(entries)
        for module, text in modules.items():
            (tmp_path / f"{module}.py").write_text(text)
        monkeypatch.syspath_prepend(tmp_path)
        extensions.joined.cache_clear()

    yield join
    extensions.joined.cache_clear()
    for module in [one for one in sys.modules if one.startswith("guest_")]:
        del sys.modules[module]


COMMAND = """
import click

@click.command()
@click.argument("word")
def greet(word):
    "Print a word."
    print("hello", word)
"""


def test_a_command_joins_by_an_entry_point(joining, said):
    joining("[critflow.commands]\ngreet = guest_command:greet\nrun = guest_command:greet\n", guest_command=COMMAND)
    assert said(["greet", "world"]).out == "hello world\n"
    assert "  greet    Print a word.\n" in said(["--help"]).out
    # A word of the scene stays that of the scene.
    assert "Compute a study" in said(["run", "--help"]).out


QUANTITY = """
from critflow.quantities import LengthVariance

def pair(network, text):
    found = LengthVariance()
    found.text = text
    return found
"""


def test_a_quantity_joins_and_gets_what_stands_in_brackets(joining):
    """Names in other words than EDGE, FACE and D, such as a pair of vertices."""
    joining("[critflow.quantities]\nshare[I-J] = guest_quantity:pair\n", guest_quantity=QUANTITY)
    network = lattice("honeycomb", 2, 2)
    extensions.used.clear()
    assert quantity(network, "share[3-5:1:0]").text == "3-5:1:0"
    assert extensions.used == {"share[I-J]"}
    with pytest.raises(InputError, match=r"did you mean 'share\[I-J\]'.*share\[I-J\].* of a deformation D"):
        quantity(network, "shar[3-5]")


def test_the_entry_point_of_a_name_is_that_of_its_whole_form(joining):
    joining("[critflow.quantities]\nshare[I-J] = guest_quantity:pair\n")
    assert extensions.quantity_entry("share[1-2]").module == "guest_quantity"
    assert not any(map(extensions.quantity_entry, ("share", "sharing[1-2]", "B_0")))


BROKEN = {  # the text of its module, and a word of the sentence
    "a missing module": (None, "guest_broken"),
    "a missing dependency": ("import no_such_module_at_all", "no_such_module_at_all"),
    "a syntax error": ("def greet(:", "SyntaxError"),
    "a wrong attribute": ("greeting = 1", "greet"),
    "an error": ("1 / 0", "ZeroDivisionError"),
}


@pytest.mark.parametrize("mistake", BROKEN)
def test_a_broken_package_does_not_break_the_scene(joining, said, mistake):
    text, word = BROKEN[mistake]
    entries = "[critflow.commands]\ngreet = guest_broken:greet\n[critflow.quantities]\nguest = guest_broken:greet\n"
    joining(entries, **({"guest_broken": text} if text else {}))
    out, err = said(["--help"])
    assert "  run " in out and "  greet " not in out
    sentence = err.splitlines()
    assert len(sentence) == 1 and word in err and "install guest again" in err
    assert said(["greet", "world"], 6).err == err
    assert main(["list", "ensemble"]) == 0
    network = lattice("honeycomb", 2, 2)
    assert quantity(network, "B_0").name == "B_0"
    with pytest.raises(EnvironmentFailure, match=word):
        quantity(network, "guest")


def test_a_module_that_a_command_imports_late_and_cannot_is_one_sentence(joining, said):
    command = "import click\n\n@click.command()\ndef greet():\n    import no_such_module_at_all\n"
    joining("[critflow.commands]\ngreet = guest_late:greet\n", guest_late=command)
    err = said(["greet"], 6).err
    assert len(err.splitlines()) == 1 and "no_such_module_at_all" in err and "again" in err


def test_a_broken_copy_of_critflow_extras_is_one_sentence(tmp_path, monkeypatch):
    """Functions of the scene that need nothing of it work."""
    package = tmp_path / "critflow_extras"
    package.mkdir()
    (package / "__init__.py").write_text("def broken(:")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(extensions, "has_extras", lambda: True)
    for module in [one for one in sys.modules if one.split(".")[0] == "critflow_extras"]:
        monkeypatch.delitem(sys.modules, module)
    with pytest.raises(EnvironmentFailure, match="response_at_rest of critflow-extras cannot be imported: SyntaxError"):
        from_extras("response_at_rest", "moduli of springs at rest")


# A start of Python without critflow-extras, also where it is installed.
HIDDEN = """
import importlib.metadata
from importlib.machinery import PathFinder

def hidden(find):
    return lambda name, *where: None if name.split(".")[0] == "critflow_extras" else find(name, *where)

def scene(find):
    return lambda **which: (one for one in find(**which) if one.name != "critflow-extras")

PathFinder.find_spec = hidden(PathFinder.find_spec)
importlib.metadata.distributions = scene(importlib.metadata.distributions)
"""

STUDY = """
from critflow import lattice, quantity
from critflow.engine import Axis, Study, Variable
from critflow.result import Status

def check(parameters, axes):
    quantity(lattice("honeycomb", 2, 2), parameters["quantity"])

study = Study(
    name="own", title="A quantity", axes=[Axis("seed", [0], "seed")], parameters={"quantity": "B_0"}, check=check,
    case=lambda parameters, *, seed: {"status": Status.ok},
    variables=[Variable("status", ("seed",), "i1", long_name="outcome", flags=Status)],
)
"""


@pytest.fixture
def scene_alone(tmp_path):
    """`scene_alone(code)`: what a process without critflow-extras prints, and its exit code."""
    (tmp_path / "sitecustomize.py").write_text(HIDDEN)
    (tmp_path / "own.py").write_text(STUDY)

    def run(code):
        words, environment = [sys.executable, "-c", code], os.environ | {"PYTHONPATH": str(tmp_path)}
        done = subprocess.run(words, cwd=tmp_path, env=environment, capture_output=True, text=True)
        return done.stdout, done.stderr, done.returncode

    return run


COMMANDS = """
from critflow.command.main import main
for words in (["--help"], ["examine", "x.csv"], ["run", "own.py", "--set=quantity=local[0-1,2-3]"], ["run", "plane"]):
    print(main(words))
print(main(["run", "own.py", "--workers=0"]))
"""


def test_the_command_without_critflow_extras(scene_alone):
    out, err, code = scene_alone(COMMANDS)
    assert code == 0, err
    assert "  run " in out and "  examine " not in out
    assert [line for line in out.splitlines() if line.isdigit()] == ["0", "2", "2", "2", "0"]
    sentences = [line for line in err.splitlines() if line.startswith("critflow: ")]
    for line, word in zip(sentences, ("'examine'", "'local[0-1,2-3]'", "'plane'"), strict=True):
        assert word in line and "critflow-extras has more" in line and "pip install . ./extras" in line


PYTHON = """
import critflow as cf
network = cf.lattice("honeycomb", 2, 2)
for call in (
    lambda: cf.design,
    lambda: cf.optimise,
    lambda: cf.quantity(network, "onset[dilation]"),
    lambda: cf.optimize(network, "C_B"),
):
    try:
        call()
    except (AttributeError, cf.InputError) as error:
        print(type(error).__name__, error)
"""


def test_python_without_critflow_extras(scene_alone):
    out, err, code = scene_alone(PYTHON)
    assert code == 0, err
    kinds = [line.split()[0] for line in out.splitlines()]
    assert kinds == ["AttributeError", "AttributeError", "InputError", "InputError"]
    found, misspelt, *others = out.splitlines()
    assert "did you mean 'optimize'?" in misspelt and "critflow-extras" not in misspelt
    assert all("critflow-extras has more" in line and "pip install" in line for line in (found, *others))


def test_a_function_that_needs_critflow_extras_says_so(scene_alone):
    code = "from critflow.extensions import from_extras; from_extras('cable_path', 'paths of cables')"
    assert "InputError: paths of cables need critflow-extras, which is not installed" in scene_alone(code)[1]
