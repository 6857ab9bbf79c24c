"""Which extras are there, and which of them a program or a page uses: its tests run only where all of these are.

Any folder of `critflow/extras` may be deleted.  The tests of an extra that imports another are then left out with it.
"""

from __future__ import annotations

import ast
import re
import tomllib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path

import pytest

import critflow
from critflow.extensions import extras, with_needs

PACKAGE = Path(critflow.__file__).parent
ROOT = PACKAGE.parent
_IMPORT = re.compile(r"from (?:critflow)?\.extras\.(\w+)[\w.]* import (\w+) as")

PUBLIC = {name: extra for extra, name in _IMPORT.findall((PACKAGE / "__init__.pyi").read_text(encoding="utf-8"))}
"""The public names of extras, and the extra of each, also of those that are not there."""

MODULES = ("critflow", "cf", "call")  # by which programs and tests name the package

_ABSENT = re.compile(r"the extra '\w+'[\w ]*, which is not installed")
_LISTED = tomllib.loads((PACKAGE / "known_extras.toml").read_text(encoding="utf-8"))


def used(program: str) -> set[str]:
    """The extras whose modules or public names a Python program names."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(program)):
        if isinstance(node, ast.ImportFrom) and node.module:
            parts = node.module.split(".")
            if parts[:2] == ["critflow", "extras"]:
                found |= {parts[2]} if len(parts) > 2 else {alias.name for alias in node.names}
            if parts == ["critflow"]:
                found |= {PUBLIC[alias.name] for alias in node.names if alias.name in PUBLIC}
        elif isinstance(node, ast.Import):
            found |= set(re.findall(r"critflow\.extras\.(\w+)", " ".join(alias.name for alias in node.names)))
        elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id in MODULES:
            found |= {PUBLIC[node.attr]} if node.attr in PUBLIC else set()
    return found


def used_by_file(file: Path) -> set[str]:
    """The extras that a file uses, itself or by the files of tests and studies that it imports."""
    seen, waiting, found = set[Path](), {file}, set[str]()
    while waiting:
        path = waiting.pop()
        seen.add(path)
        extras_of_it, files = _read(path)
        found |= extras_of_it
        waiting |= files - seen
    return found


@cache
def _read(file: Path) -> tuple[set[str], set[Path]]:
    """The extras that a file uses itself, and the files of tests and studies that it imports."""
    program, found = file.read_text(encoding="utf-8"), set[Path]()
    for node in ast.walk(ast.parse(program)):
        if isinstance(node, ast.ImportFrom) and not (node.module or "").startswith("critflow"):
            folders = [file.parents[node.level - 1]] if node.level else [ROOT, ROOT / "tests"]
            stems = [folder.joinpath(*(node.module or "").split(".")) for folder in folders]
            stems += [stem / alias.name for stem in stems for alias in node.names]
            found |= {stem.with_suffix(".py") for stem in stems if stem.with_suffix(".py").is_file()}
    return used(program), found


def mentioned(text: str) -> set[str]:
    """The extras of which the code in a text names a function, a module, a command or a quantity."""
    found = set(re.findall(r"critflow\.extras\.(\w+)", text))
    imported = " ".join(re.findall(r"from critflow import (\([^)]*\)|.*)", text))
    for extra, names in _LISTED.items():
        for name in names:
            word = rf"{re.escape(name.partition('[')[0])}{re.escape('[') if '[' in name else chr(92) + 'b'}"
            if re.search(rf"\b(cf|critflow)[. ]{word}|['\"]{word}", text) or re.search(rf"\b{word}", imported):
                found.add(extra)
    return found


def missing(program: str, *folders: str) -> set[str]:
    """The extras that a program needs, or that are named, and that are not there."""
    return absent(used(program) | set(folders))


def absent(names: Iterable[str]) -> set[str]:
    """Those of these extras, and of all that they import, that are not there."""
    return with_needs(set(names)) - extras().keys()


def skip_without(names: Iterable[str]) -> None:
    """Leave a test out where one of these extras, or one that they import, is not there."""
    if deleted := absent(names):
        pytest.skip(f"deleted: {', '.join(sorted(deleted))}")


@contextmanager
def left_out_without_services() -> Iterator[None]:
    """Leave a test out that fails by the sentence on an extra that is not installed, where one is deleted.

    It uses a service that no name in its code shows, such as the elasticity of networks at rest.
    """
    try:
        yield
    except Exception as error:
        if _ABSENT.search(str(error)) and _LISTED.keys() - extras().keys():
            pytest.skip(f"deleted: {_ABSENT.search(str(error))[0]}")
        raise
