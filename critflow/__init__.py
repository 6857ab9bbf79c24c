"""critflow: design spring networks that sit exactly at the rigidity transition.

The public names and their modules stand in `__init__.pyi`.  A module is imported at the first use of one of its names:
all together take longer than many a command.
"""

from importlib import import_module as _import_module
from typing import Any as _Any

import lazy_loader as _lazy_loader

_imported, _, __all__ = _lazy_loader.attach_stub(__name__, __file__)


def __getattr__(name: str) -> _Any:
    """A public name, imported; `AttributeError` says which extra is missing where its folder is."""
    if name == "__version__":
        return _import_module("importlib.metadata").version(__name__)
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    try:
        return _imported(name)
    except ModuleNotFoundError as error:
        package, _, module = str(error.name).partition(".extras.")
        if package != __name__:
            raise
        extra = module.partition(".")[0]
        relation = "belongs to" if _import_module("critflow.extensions").missing(name) == extra else "needs"
        sentence = f"critflow.{name} {relation} the extra {extra!r}, which is not installed: install critflow again"
        raise AttributeError(sentence) from error


def __dir__() -> list[str]:
    return ["__version__", *__all__]
