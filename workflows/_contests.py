"""All tasks of the charts of error against time, by their words."""

from __future__ import annotations

from . import (
    _contest_coefficients,
    _contest_configuration,
    _contest_lengths,
    _contest_moduli,
    _contest_optimum,
    _contest_strain,
)

MODULES = (
    _contest_configuration,
    _contest_optimum,
    _contest_lengths,
    _contest_strain,
    _contest_moduli,
    _contest_coefficients,
)

TASKS = {task.word: task for module in MODULES for task in module.TASKS}

# Every name once, in the order of the tasks.
CONTESTANTS = tuple(dict.fromkeys(name for task in TASKS.values() for name in task.names))
