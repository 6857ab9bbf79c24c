"""critflow: design spring networks that sit exactly at the rigidity transition."""

from importlib.metadata import version

from critflow.result import (
    CritflowError,
    EnvironmentFailure,
    InputError,
    IntegrityError,
    NetworkError,
    Solution,
    SolveError,
    Stats,
    Status,
    StudyError,
)

__version__ = version("critflow")

__all__ = [
    "CritflowError",
    "EnvironmentFailure",
    "InputError",
    "IntegrityError",
    "NetworkError",
    "Solution",
    "SolveError",
    "Stats",
    "Status",
    "StudyError",
    "__version__",
]
