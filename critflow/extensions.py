"""How extras join the scene: each is a folder of `critflow/extras`, and its file `extra.toml` declares what it adds.

    needs       other extras that it imports
    numeric     false where nothing of it decides the numbers of a study
    kinds       classes of the scene that its package teaches to functions which are `extensible`
    quantities  name, such as "onset[D]" -> "module:factory" within its folder, as in `quantities.FACTORIES`
    commands    name -> `place`, "module:function" within its folder, and `help`, its line in `critflow --help`
    functions   name -> "module:function" within its folder, of a service that the scene calls by `provided`
    solvers     of sparse matrices: `module` within its folder, and `least`, numbers of entries from which it is asked,
                as `choose_backend` of `critflow.sparse` does

The scene reads the declarations and imports an extra when one of its names is used.  It names none of them, so that a
folder can be added or deleted without an edit.  The data file `known_extras.toml` lists the names of all extras of
critflow, so that a name of one that is not installed is an error that says which.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache, singledispatch, wraps
from importlib import import_module
from pathlib import Path
from typing import Any

from critflow.result import InputError

_FOLDER = Path(__file__).with_name("extras")
_KNOWN = Path(__file__).with_name("known_extras.toml")


@dataclass(frozen=True)
class Extra:
    """The declarations of one extra."""

    name: str
    needs: list[str] = field(default_factory=list)
    numeric: bool = True
    kinds: list[str] = field(default_factory=list)
    quantities: dict[str, str] = field(default_factory=dict)
    commands: dict[str, dict[str, str]] = field(default_factory=dict)
    functions: dict[str, str] = field(default_factory=dict)
    solvers: dict[str, Any] = field(default_factory=dict)

    @property
    def package(self) -> str:
        return f"{__package__}.{_FOLDER.name}.{self.name}"

    def named(self, place: str) -> Any:
        """The object at "module:name" within the folder; `InputError` where the extra needs one that is not there."""
        if absent := sorted(with_needs(set(self.needs)) - extras().keys()):
            raise InputError(
                f"the extra {self.name!r} of critflow needs the extra {absent[0]!r}, which is not installed: install "
                "critflow again"
            )
        return named(f"{self.package}.{place}")


def named(place: str) -> Any:
    """The object at "module:name", whose module is imported at its first use."""
    module, _, name = place.partition(":")
    return getattr(import_module(module), name)


@cache
def extras() -> dict[str, Extra]:
    """All extras that are there, by name, in alphabetical order."""
    files = sorted(_FOLDER.glob("*/extra.toml"))
    declared = {file.parent.name: tomllib.loads(file.read_text(encoding="utf-8")) for file in files}
    return {name: Extra(name, **entries) for name, entries in declared.items()}


def with_needs(names: set[str]) -> set[str]:
    """Extras and all that they import, installed or not."""
    needed, waiting = set[str](), set(names)
    while waiting:
        name = waiting.pop()
        needed.add(name)
        waiting |= set(extras()[name].needs) - needed if name in extras() else set()
    return needed


@cache
def quantities() -> dict[str, str]:
    """Quantities of all extras: "module:factory" by name."""
    return {name: f"{one.package}.{place}" for one in extras().values() for name, place in one.quantities.items()}


def missing(name: str) -> str | None:
    """The extra of critflow that would have a name, where that extra is not installed, else None.

    name  a public name, a command, a service for `provided`, or a quantity, such as "onset[dilation]"
    """
    absent = {extra: names for extra, names in known_names().items() if extra not in extras()}
    stem = name.partition("[")[0]
    return next((extra for extra, names in absent.items() if stem in {one.partition("[")[0] for one in names}), None)


@cache
def known_names() -> dict[str, list[str]]:
    """The names of all extras of critflow, installed or not."""
    return tomllib.loads(_KNOWN.read_text(encoding="utf-8"))


def provided(name: str, purpose: str) -> Any:
    """The function that an extra declares under a name; `InputError` without such an extra.

    purpose  what needs it, as the sentence of the error begins: "pressures in faces"
    """
    for extra in extras().values():
        if name in extra.functions:
            return extra.named(extra.functions[name])
    absent = missing(name)
    which = f"the extra {absent!r} of critflow, which" if absent else "an extra of critflow that"
    raise InputError(f"{purpose} belong to {which} is not installed: install critflow again")


def extensible(function: Callable[..., Any]) -> Any:
    """`functools.singledispatch`, which first imports the extras that declare the kind of the first argument.

    @extensible
    def elasticity(springs, ...): raise InputError(...)     # the kinds that nothing is registered for

    @elasticity.register
    def _(springs: CriticalConfiguration, ...): ...
    """
    dispatcher = singledispatch(function)

    @wraps(function)
    def dispatched(first: Any, *args: Any, **options: Any) -> Any:
        _import_extras_of(type(first))  # type: ignore[arg-type]
        return dispatcher(first, *args, **options)

    def takes(kind: type[Any]) -> bool:
        """Whether a function is registered for a class, or for one of its bases."""
        _import_extras_of(kind)  # type: ignore[arg-type]
        return dispatcher.dispatch(kind) is not function

    dispatched.register = dispatcher.register  # type: ignore[attr-defined]
    dispatched.takes = takes  # type: ignore[attr-defined]
    return dispatched


@cache
def _import_extras_of(kind: type[Any]) -> None:
    """Import the packages that declare a class or one of its bases: they register functions of it."""
    names = {base.__name__ for base in kind.__mro__}
    for extra in extras().values():
        if names & set(extra.kinds):
            import_module(extra.package)
