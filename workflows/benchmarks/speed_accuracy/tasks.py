"""All tasks of the benchmark, by word, and their methods."""

from __future__ import annotations

from . import (
    coefficients,
    configuration,
    lengths,
    moduli,
    optimum,
    strain,
)

MODULES = (
    configuration,
    optimum,
    lengths,
    strain,
    moduli,
    coefficients,
)

TASKS = {task.word: task for module in MODULES for task in module.TASKS}

# Names of all methods, in the order of the tasks.
METHODS = tuple(dict.fromkeys(name for task in TASKS.values() for name in task.names))
