"""Which extras are there, and which of them a program uses: its tests run only where all of these are.

Any folder of `critflow/extras` may be deleted.  The tests of an extra that imports another are then left out with it.
"""

from __future__ import annotations

import ast
import re
from pathlib import Path

import critflow
from critflow.extensions import extras

PACKAGE = Path(critflow.__file__).parent
_IMPORT = re.compile(r"from (?:critflow)?\.extras\.(\w+)[\w.]* import (\w+) as")

PUBLIC = {name: extra for extra, name in _IMPORT.findall((PACKAGE / "__init__.pyi").read_text(encoding="utf-8"))}
"""The public names of extras, and the extra of each, also of those that are not there."""

MODULES = ("critflow", "cf", "call")  # by which programs and tests name the package


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
        elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id in MODULES:
            found |= {PUBLIC[node.attr]} if node.attr in PUBLIC else set()
    return found


def with_needs(names: set[str]) -> set[str]:
    """Extras and all that they import."""
    needed, waiting = set[str](), set(names)
    while waiting:
        name = waiting.pop()
        needed.add(name)
        waiting |= set(extras()[name].needs) - needed if name in extras() else set()
    return needed


def missing(program: str, *folders: str) -> set[str]:
    """The extras that a program needs, or that are named, and that are not there."""
    return with_needs(used(program) | set(folders)) - extras().keys()
