"""The page for contributors: what it says of folders, files and functions is there."""

import ast
import re
from functools import cache
from pathlib import Path

import pytest
from layers import LAYERS

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "docs" / "contributing.md").read_text(encoding="utf-8")
PACKAGE = ROOT / "critflow"

# `name` in `file.py`, the form in which the page names a function, a method, a class or a table.
NAMED = sorted(set(re.findall(r"`([\w.]+)`(?: and `[\w.]+`)? in `([\w/]+\.py)`", PAGE)))
PATHS = sorted(set(re.findall(r"`((?:critflow|tests|docs|workflows|results)/[\w/.]*)`", PAGE)))


def table(name):
    """The rows of the table between the comments of this name, without its head."""
    rows = PAGE.split(f"<!-- {name} -->\n")[1].split(f"<!-- /{name} -->")[0].splitlines()[2:]
    return [tuple(cell.strip() for cell in row.strip("|").split("|")) for row in rows]


@cache
def defined(file):
    """The names that a module defines at its top and in its classes, as NAME and CLASS.NAME."""
    names = set()
    for node in ast.parse((ROOT / file).read_text(encoding="utf-8")).body:
        if isinstance(node, ast.Assign):
            names |= {target.id for target in node.targets if isinstance(target, ast.Name)}
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            names |= {node.name, *(f"{node.name}.{one.name}" for one in node.body if hasattr(one, "name"))}
    return names


@pytest.mark.parametrize("name, file", NAMED, ids=lambda word: word.rpartition("/")[2])
def test_a_function_is_where_the_page_says(name, file):
    assert name in defined(file)


def test_the_page_answers_twenty_questions():
    rows = PAGE.split("## Twenty questions\n")[1].split("\n### ")[0].strip().splitlines()[2:]
    assert len(rows) == 20 and all(re.search(r"`(critflow|workflows|tests)/[\w/]+\.py`", row) for row in rows)
    assert len(NAMED) > 20


@pytest.mark.parametrize("path", PATHS)
def test_a_path_exists(path):
    assert (ROOT / path).exists() or "NAME" in path or path.startswith("docs/_build")


def test_the_table_of_the_scene_lists_its_files():
    listed = [name for cell, _ in table("scene") for name in re.findall(r"`(\w+)(?:\.py|/)`", cell)]
    assert listed == [layer for layer in LAYERS if layer not in ("studies", "__main__")]
    assert all((PACKAGE / f"{name}.py").exists() or (PACKAGE / name).is_dir() for name in listed)
