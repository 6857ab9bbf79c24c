"""Who imports whom in the extras, and how long a function may be, read from the source."""

import ast
import subprocess
import sys

import pytest
from sources import circle, functions, imported, length, modules_of, parsed
from test_result import records

import critflow
import critflow_extras as ce
from critflow.result import Record

SOURCES = modules_of("critflow_extras")
ROOT = SOURCES["critflow_extras.__init__"].parent
TREES = {name: parsed(path) for name, path in SOURCES.items()}
LONGEST = 60


def test_imports_run_in_one_direction():
    assert circle({name: imported(tree, SOURCES) for name, tree in TREES.items()}) == []


# The reason stands in the docstring of `critflow.command.main`; `hints` has what the words after `critflow` share.
@pytest.mark.parametrize("name", [name for name in SOURCES if not name.endswith((".command", ".hints"))])
def test_no_import_hides_inside_a_function(name):
    for node in ast.walk(TREES[name]):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda | ast.ClassDef):
            assert not imported(node), f"{name}: {node.lineno}"


def test_no_function_is_long():
    long = {name: length(node) for name, node in (functions(ROOT) | functions(ROOT.parent / "studies")).items()}
    assert {name: lines for name, lines in long.items() if lines > LONGEST} == {}


def test_every_public_name_is_there():
    assert all(hasattr(ce, name) for name in ce.__all__) and set(dir(ce)) == {*ce.__all__, "__version__"}
    # The writer of the scene has tables alone, that of critflow-extras all formats.
    assert set(critflow.__all__) & set(ce.__all__) == {"write_network"}


def test_the_import_of_a_folder_replaces_no_function_of_its_name():
    """`lazy_loader` guards these names since its version 0.5."""
    folders = {path.name for path in ROOT.iterdir()} & set(ce.__all__)
    words = "".join(f"import critflow_extras.{name}; " for name in folders)
    words += f"assert all(callable(getattr(critflow_extras, name)) for name in {folders})"
    assert folders and subprocess.run([sys.executable, "-c", words], check=False).returncode == 0


def test_no_record_replaces_its_representation():
    assert all(hasattr(ce, name) for name in ce.__all__)  # with all modules imported
    assert [kind.__name__ for kind in records(Record) if kind.__dataclass_params__.repr] == []
