"""The names of all extras, as `critflow/known_extras.toml` lists them; run this file to write that one again."""

from pathlib import Path

from extras_there import PUBLIC

import critflow
from critflow.extensions import extras

LIST = Path(critflow.__file__).with_name("known_extras.toml")


def declared():
    """All names of each extra that is installed: public names, quantities, commands and services."""
    names = {}
    for name, extra in extras().items():
        public = {one for one, owner in PUBLIC.items() if owner == name}
        names[name] = sorted({*public, *extra.quantities, *extra.commands, *extra.functions}, key=str.casefold)
    return names


def text(names):
    """The data file with these names."""
    lines = ["# The names of each extra of critflow, written by tests/known_extras.py."]
    for extra, listed in names.items():
        lines.append(f"{extra} = [" + ", ".join(f'"{name}"' for name in listed) + "]")
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    LIST.write_text(text(declared()), encoding="utf-8")
