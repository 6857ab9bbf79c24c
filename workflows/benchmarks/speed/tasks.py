"""All tasks of the benchmark, by word, with their methods, sizes and strains."""

from .. import moduli, strain
from . import configuration, optimum, stages

MODULES = strain, moduli, optimum, configuration

TASKS = {task.word: task for module in MODULES for task in module.TASKS}

# Names of all methods and stages, in the order of the tasks.
METHODS = tuple(dict.fromkeys([*(name for task in TASKS.values() for name in task.names), *stages.STAGES]))

# Sizes of every task, and those of a run: stages first, so that their memory is not that of other packages.
SIZES = {stages.WORD: stages.SIZES} | {word: task.sizes for word, task in TASKS.items()}
ALL_SIZES = tuple(sorted({size for sizes in SIZES.values() for size in sizes}))

# Distance to the transition where tasks past it are compared at all sizes; others are at its own distance, zero.
MAIN_GAMMA = 1e-3
GAMMAS = (0.0, 1e-8, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 1e-1)
# Largest size at which all networks are solved, else the first, and largest one with all strains.
ALL_NETWORKS, ALL_STRAINS = 1_000, 100


def has_size(word: str, n_vertices: int, seed: int) -> bool:
    """Whether a task runs at a size: one of its own, or one that no task lists up to its largest."""
    sizes = SIZES[word]
    if seed and (word == stages.WORD or n_vertices > ALL_NETWORKS):
        return False
    return n_vertices in sizes or (n_vertices not in ALL_SIZES and n_vertices <= max(sizes))


def strains_of(word: str, n_vertices: int, gammas: list[float]) -> list[int]:
    """Places of the strains of a task at a size."""
    if word == stages.WORD or not TASKS[word].strained:
        return [n for n, gamma in enumerate(gammas) if gamma == 0]
    return [n for n, gamma in enumerate(gammas) if gamma and (gamma == MAIN_GAMMA or n_vertices <= ALL_STRAINS)]
