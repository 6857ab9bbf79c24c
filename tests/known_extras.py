"""The names of all extras, as `critflow/known_extras.toml` lists them; run this file to write that one again."""

import ast
from pathlib import Path

import critflow
from critflow.extensions import extras

LIST = Path(critflow.__file__).with_name("known_extras.toml")
STUB = Path(critflow.__file__).with_suffix(".pyi")


def public_names(extra):
    """The public names of critflow that live in an extra."""
    nodes = [node for node in ast.parse(STUB.read_text(encoding="utf-8")).body if isinstance(node, ast.ImportFrom)]
    return {alias.name for node in nodes for alias in node.names if node.module.startswith(f"extras.{extra.name}.")}


def declared():
    """All names of each extra that is installed: public names, quantities, commands and services."""
    return {
        name: sorted({*public_names(extra), *extra.quantities, *extra.commands, *extra.functions}, key=str.casefold)
        for name, extra in extras().items()
    }


def text(names):
    """The data file with these names."""
    lines = ["# The names of each extra of critflow, written by tests/known_extras.py."]
    for extra, listed in names.items():
        lines.append(f"{extra} = [" + ", ".join(f'"{name}"' for name in listed) + "]")
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    LIST.write_text(text(declared()), encoding="utf-8")
