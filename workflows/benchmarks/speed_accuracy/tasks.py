"""All tasks of the charts of error against time, by their words."""

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

# Every name once, in the order of the tasks.
CONTESTANTS = tuple(dict.fromkeys(name for task in TASKS.values() for name in task.names))
