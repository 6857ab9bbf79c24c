"""How packages join the scene, by two groups of entry points, and what of critflow-extras the scene calls.

    critflow.commands    word = "module:command"     a `click.Command`, a word after `critflow`
    critflow.quantities  name = "module:factory"     (network, argument) -> `Quantity`

    [project.entry-points."critflow.quantities"]
    "onset[D]" = "critflow_extras.cables.onset_quantity:onset"

A module is imported when one of its names is used.  Functions of the scene whose arguments allow what only
critflow-extras computes, such as moduli of springs at rest, import it from there by `from_extras`.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import cache
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from importlib.util import find_spec
from typing import Any

from critflow.result import EnvironmentFailure, InputError

used: set[str] = set()
"""Names of quantities and functions that this process took from packages that joined, which a study must count."""

EXTRAS = "critflow_extras"  # the package of the distribution critflow-extras
INSTALL = "pip install . ./extras in a copy of the repository"


@cache
def joined(group: str) -> dict[str, EntryPoint]:
    """The entry points of a group, "commands" or "quantities", by name in alphabetical order."""
    found = entry_points(group=f"critflow.{group}")
    return {one.name: one for one in sorted(found, key=lambda one: one.name.casefold())}


def loaded(entry: EntryPoint) -> Any:
    """The object of an entry point; `EnvironmentFailure` where its package is broken."""
    used.add(entry.name)
    return _imported(entry.load, entry.name, entry.dist.name if entry.dist else entry.module)


def _imported(load: Callable[[], Any], name: str, owner: str) -> Any:
    """What `load` imports; `EnvironmentFailure` with any error, since each is one of the installation of its owner."""
    try:
        return load()
    except Exception as error:
        sentence = f"{name} of {owner} cannot be imported: {type(error).__name__}: {error}: install {owner} again"
        raise EnvironmentFailure(sentence) from error


def quantity_entry(name: str) -> EntryPoint | None:
    """The entry point of the quantity of a name, such as "onset[dilation]" or "C_xxyy"."""
    stem, bracket, _ = re.sub(r"^([SC])_[xyz]+$", r"\1_AXES", name).partition("[")
    entries = joined("quantities").items()
    return next((one for key, one in entries if key.partition("[")[:2] == (stem, bracket)), None)


@cache
def has_extras() -> bool:
    """Whether critflow-extras is installed."""
    return find_spec(EXTRAS) is not None


def more(word: str) -> str:
    """The end of a sentence on an unknown word: that critflow-extras has more, where it is not installed."""
    return "" if has_extras() else f" (critflow-extras has more {word}: {INSTALL})"


def from_extras(name: str, purpose: str, counts: bool = True) -> Any:
    """A public name of critflow-extras; `InputError` where it is not installed.

    purpose  what needs it, as the sentence begins: "moduli of springs at rest"
    counts   whether it decides numbers; a solver of linear systems is a library
    """
    if not has_extras():
        raise InputError(f"{purpose} need critflow-extras, which is not installed: {INSTALL}")
    if counts:
        used.add(name)
    return _imported(lambda: getattr(import_module(EXTRAS), name), name, "critflow-extras")
