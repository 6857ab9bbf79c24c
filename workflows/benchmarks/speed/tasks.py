"""All tasks of the benchmark, by word, and their methods."""

from . import configuration, moduli, optimum, stages, strain

MODULES = configuration, optimum, strain, moduli

TASKS = {task.word: task for module in MODULES for task in module.TASKS}

# Names of all methods and stages, in the order of the tasks.
METHODS = tuple(dict.fromkeys([*(name for task in TASKS.values() for name in task.names), *stages.STAGES]))

# Sizes of every task, and those of a run: stages first, so that their memory is not that of other packages.
SIZES = {stages.WORD: stages.SIZES} | {word: task.sizes for word, task in TASKS.items()}
ALL_SIZES = tuple(sorted({size for sizes in SIZES.values() for size in sizes}))


def has_size(word: str, n_vertices: int) -> bool:
    """Whether a task runs at a size: one of its own, or one that no task lists up to its largest."""
    sizes = SIZES[word]
    return n_vertices in sizes or (n_vertices not in ALL_SIZES and n_vertices <= max(sizes))
