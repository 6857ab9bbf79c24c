"""critflow: design spring networks that sit exactly at the rigidity transition."""

import sys
from importlib import import_module
from importlib.metadata import version
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from critflow.public import *  # noqa: F403 (its names are the public ones)

__version__ = version("critflow")

_FUNCTIONS = ("equilibrium", "optimize", "rigidity")  # public names that are also those of their modules


class _Package(ModuleType):
    """The public names come when the first of them is asked for: the command counts shards without any physics."""

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_") and name != "__all__":
            raise AttributeError(f"module 'critflow' has no attribute {name!r}")
        public = import_module("critflow.public")
        vars(self).update({each: getattr(public, each) for each in public.__all__})
        vars(self)["__all__"] = [*public.__all__, "__version__"]
        return super().__getattribute__(name)

    def __setattr__(self, name: str, value: Any) -> None:
        if not (name in _FUNCTIONS and isinstance(value, ModuleType)):  # as importing critflow.rigidity does
            super().__setattr__(name, value)

    def __dir__(self) -> list[str]:
        return sorted({*super().__dir__(), *self.__all__})


sys.modules[__name__].__class__ = _Package
