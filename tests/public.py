"""The public functions: those whose arguments are checked, at the top level or in their folder."""

import inspect
import pkgutil
from importlib import import_module

import critflow

NAMES = sorted(critflow.__all__)
"""The names at the top level."""


def checked_functions():
    """Functions by name: those of all modules of physics whose arguments are checked, and those at the top level."""
    functions = {name: f for name in NAMES if inspect.isfunction(f := getattr(critflow, name))}
    for module in pkgutil.walk_packages(critflow.__path__, "critflow."):
        apart = ("command", "explore", "workflow", "progress", "__main__")
        of_command = module.name.endswith((".command", ".hints"))
        if of_command or module.name.startswith(tuple(f"critflow.{name}" for name in apart)):
            continue
        for name, f in vars(import_module(module.name)).items():
            if inspect.isfunction(f) and hasattr(f, "__wrapped__") and f.__module__ == module.name:
                # Those that are registered by the kind of their first argument have it checked by their caller.
                if not name.startswith("_") and not hasattr(f, "register"):
                    functions.setdefault(name, f)
    return functions
