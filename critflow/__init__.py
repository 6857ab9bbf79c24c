"""critflow: design spring networks that sit exactly at the rigidity transition.

The public names and their modules stand in `__init__.pyi`.  A module is imported at the first use of one of its names:
all together take longer than many a command.
"""

import sys as _sys
from importlib import import_module as _import_module
from typing import Any as _Any

import lazy_loader as _lazy_loader

_imported, _, __all__ = _lazy_loader.attach_stub(__name__, __file__)


def __getattr__(name: str) -> _Any:
    """A public name, imported; `AttributeError` says where other names may be."""
    if name == "__version__":
        return _import_module("importlib.metadata").version(__name__)
    if name not in __all__:
        sentence = f"module {__name__!r} has no attribute {name!r}{_elsewhere(name)}"
        # `from critflow import NAME` first asks by this function of importlib, and drops what an AttributeError says.
        asked = _sys._getframe(1).f_code.co_name == "_handle_fromlist"
        raise (ImportError if asked and "from critflow_extras import" in sentence else AttributeError)(sentence)
    return _imported(name)


def _elsewhere(name: str) -> str:
    """That critflow-extras has a name, which one is meant, or that critflow-extras may have it."""
    if name.startswith("_"):
        return ""
    extensions = _import_module("critflow.extensions")
    if extensions.has_extras() and name in _import_module(extensions.EXTRAS).__all__:
        return f": from critflow_extras import {name}"
    close = _import_module("difflib").get_close_matches(name, __all__, 1, 0.75)
    return f": did you mean {close[0]!r}?" if close else extensions.more("names")


def __dir__() -> list[str]:
    return ["__version__", *__all__]
