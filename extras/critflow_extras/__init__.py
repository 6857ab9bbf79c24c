"""critflow-extras: what critflow computes beyond the paper.  Each folder is one capability.

The public names and their modules stand in `__init__.pyi`.  A module is imported at the first use of one of its names.
"""

from importlib import import_module as _import_module
from typing import Any as _Any

import lazy_loader as _lazy_loader

_imported, _, __all__ = _lazy_loader.attach_stub(__name__, __file__)


def __getattr__(name: str) -> _Any:
    if name == "__version__":
        return _import_module("importlib.metadata").version("critflow-extras")
    return _imported(name)


def __dir__() -> list[str]:
    return ["__version__", *__all__]
