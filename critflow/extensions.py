"""How extras join the scene: each is a folder of `critflow/extras`, and its file `extra.toml` declares what it adds.

    needs       other extras that it imports
    kinds       class -> "module" within its folder, which registers functions of that class with those that are
                `extensible`; or a list of classes, whose functions the package registers
    quantities  name, or the part before brackets -> "module:factory" within its folder
    commands    name -> "module:function" within its folder
    functions   name -> "module:function" within its folder, of a service that the scene calls by `provided`

The scene reads the declarations and imports an extra when one of its names is used.  It names none of them, so that a
folder can be added or deleted without an edit.
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


@dataclass(frozen=True)
class Extra:
    """The declarations of one extra."""

    name: str
    needs: tuple[str, ...] = ()
    kinds: dict[str, str] = field(default_factory=dict)
    quantities: dict[str, str] = field(default_factory=dict)
    commands: dict[str, str] = field(default_factory=dict)
    functions: dict[str, str] = field(default_factory=dict)

    @property
    def package(self) -> str:
        return f"{__package__}.{_FOLDER.name}.{self.name}"

    def named(self, place: str) -> Any:
        """The object at "module:name" within the folder."""
        module, _, name = place.partition(":")
        return getattr(import_module(f"{self.package}.{module}"), name)


@cache
def extras() -> dict[str, Extra]:
    """All extras that are there, by name, in alphabetical order."""
    files = sorted(_FOLDER.glob("*/extra.toml"))
    declared = {file.parent.name: tomllib.loads(file.read_text(encoding="utf-8")) for file in files}
    return {
        name: Extra(
            name,
            tuple(entries.get("needs", ())),
            _by_module(entries.get("kinds", {})),
            entries.get("quantities", {}),
            entries.get("commands", {}),
            entries.get("functions", {}),
        )
        for name, entries in declared.items()
    }


def _by_module(kinds: dict[str, str] | list[str]) -> dict[str, str]:
    return kinds if isinstance(kinds, dict) else dict.fromkeys(kinds, "")


def provided(name: str, purpose: str) -> Any:
    """The function that an extra declares under a name; `InputError` without such an extra.

    purpose  what needs it, as the sentence of the error begins: "pressures in faces"
    """
    for extra in extras().values():
        if name in extra.functions:
            return extra.named(extra.functions[name])
    raise InputError(f"{purpose} belong to an extra of critflow that is not installed: install critflow again")


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
    """Import what the extras declare for a class or one of its bases: it registers functions of it."""
    names = {base.__name__ for base in kind.__mro__}
    for extra in extras().values():
        for module in {extra.kinds[name] for name in names & extra.kinds.keys()}:
            import_module(f"{extra.package}.{module}" if module else extra.package)
