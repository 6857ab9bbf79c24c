"""critflow: design spring networks that sit exactly at the rigidity transition.

The public names and their modules stand in `__init__.pyi`.  A module is imported at the first use of one of its names:
all together take longer than many a command.
"""

from importlib import import_module as _import_module
from typing import Any as _Any

import lazy_loader as _lazy_loader

_imported, _, __all__ = _lazy_loader.attach_stub(__name__, __file__)


def __getattr__(name: str) -> _Any:
    """A public name, imported; `AttributeError` says where other names may be."""
    if name == "__version__":
        return _import_module("importlib.metadata").version(__name__)
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}{_elsewhere(name)}")
    return _imported(name)


def _elsewhere(name: str) -> str:
    """That critflow-extras has a name, or may have it."""
    extensions = _import_module("critflow.extensions")
    if name.startswith("_") or not extensions.has_extras():
        return "" if name.startswith("_") else extensions.more("names")
    return f": from critflow_extras import {name}" * (name in _import_module(extensions.EXTRAS).__all__)


def __dir__() -> list[str]:
    return ["__version__", *__all__]
