"""critflow: design spring networks that sit exactly at the rigidity transition.

The public names and their modules stand in `__init__.pyi`.  A module is imported at the first use of one of its names:
all together take longer than many a command.
"""

import ast
import sys
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

_STUB = ast.parse(Path(__file__).with_suffix(".pyi").read_text(encoding="utf-8"))
_IMPORTS = [node for node in _STUB.body if isinstance(node, ast.ImportFrom)]
_MODULES = {alias.name: str(node.module) for node in _IMPORTS for alias in node.names}
__all__ = list(_MODULES)


class _Package(ModuleType):
    """The package, in which `design` and `rigidity` are the functions also after an import from their folders."""

    def __getattr__(self, name: str) -> Any:
        if name == "__version__":
            value = import_module("importlib.metadata").version("critflow")
        elif name in _MODULES:
            value = getattr(import_module(_MODULES[name]), name)
        else:
            raise AttributeError(f"module 'critflow' has no attribute {name!r}")
        vars(self)[name] = value
        return value

    def __setattr__(self, name: str, value: object) -> None:
        # The import of a folder sets its name here.
        if name not in _MODULES or not isinstance(value, ModuleType):
            super().__setattr__(name, value)

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *__all__]


sys.modules[__name__].__class__ = _Package
