"""Outcomes: the status codes stored in data files, the solution of every solve, and the errors shown to users.

Bad input raises a `CritflowError` immediately.  Numerical failure is a `Status` inside a `Solution`; interactive calls
convert it into a `SolveError` that carries the solution.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from enum import IntEnum
from typing import Any, Generic, Self, TypeVar

import numpy as np

Value = TypeVar("Value")


class Status(IntEnum):
    """Outcome of a solve.  The integers are stored in files: append, never renumber."""

    ok = 0
    floppy = 1
    step_limit = 2
    stalled = 3
    singular = 4
    edge_collapse = 5
    slack_edges = 6
    unstable = 7
    failed = 8
    missing = 9
    ill_conditioned = 10
    undecided = 11
    rigid = 12
    infeasible = 13
    not_reached = 14
    out_of_range = 15
    compressed_edges = 16

    def __str__(self) -> str:
        return self.name

    def __format__(self, format_spec: str) -> str:
        return format(self.name, format_spec)

    @property
    def message(self) -> str:
        """The reason of the status, and a suggestion."""
        return _MESSAGES[self]


_MESSAGES = {
    Status.infeasible: "no configuration has the requested properties (proof): relax one of them",
    Status.not_reached: "the search ended without the requested properties: relax one, or give another start",
    Status.out_of_range: "the estimated error exceeds a tenth of the answer: relax the full energy in its place",
    Status.ok: "converged to the requested tolerance",
    Status.floppy: "the network has no self-stress, so every modulus is exactly zero: strain it to the transition",
    Status.step_limit: "the step limit came before the tolerance: raise max_steps",
    Status.stalled: "rounding stopped the convergence before the tolerance: loosen it",
    Status.singular: "the prestress matrix is singular here, so the stress has no configuration: move it away",
    Status.edge_collapse: "edges shrink to zero length towards the infimum: its value is a limit, not attained",
    Status.slack_edges: "some edges carry no tension at the transition: narrow the spread of the rest lengths",
    Status.compressed_edges: "some edges are compressed and none is slack: narrow the spread of the rest lengths",
    Status.unstable: "the equilibrium is a saddle of the energy: perturb it, or take smaller strain steps",
    Status.failed: "the case raised an error, which is stored with it",
    Status.missing: "not computed yet: run the study again",
    Status.rigid: "the network is rigid already: lengthen its rest lengths, or begin at a smaller strain",
    Status.ill_conditioned: "rounding errors may exceed the answer: choose stresses of more similar magnitude",
    Status.undecided: "a number that decides is too near its limit: give another tolerance, or move the configuration",
}


class Record:
    """Prints in one line: numbers, names, and shapes in place of arrays.  For classes with `@dataclass(repr=False)`."""

    def __repr__(self) -> str:
        return f"{type(self).__name__}({', '.join(_shown_fields(self))})"


# Arrays, tuples and mappings of more entries, and texts of more characters, are shortened.
_MOST_ENTRIES, _MOST_CHARACTERS = 6, 80


def _shown_fields(record: Any, without: tuple[str, ...] = ()) -> list[str]:
    """`name=value` of each field that has one."""
    values = {f.name: getattr(record, f.name) for f in fields(record) if f.repr and f.name not in without}
    empty = (type(None), str, tuple, dict)
    return [f"{name}={_brief(v)}" for name, v in values.items() if not isinstance(v, empty) or v]


def _brief(value: Any) -> str:
    """A value in a few characters."""
    if isinstance(value, Record):
        return f"{type(value).__name__}(...)"
    if isinstance(value, float | np.floating):
        return f"{value:.6g}"
    if isinstance(value, IntEnum):
        return str(value)
    if isinstance(value, np.ndarray):
        small = value.ndim == 1 and value.size <= _MOST_ENTRIES
        return f"[{', '.join(map(_brief, value.tolist()))}]" if small else f"array({', '.join(map(str, value.shape))})"
    if isinstance(value, tuple | list | dict):
        if len(value) > _MOST_ENTRIES:
            return f"{len(value)} entries"
        return f"({', '.join(map(_brief, value))})"
    text = repr(value)
    if len(text) <= _MOST_CHARACTERS and "\n" not in text:
        return text
    return f"{text[:_MOST_CHARACTERS]}..." if isinstance(value, str) else f"{type(value).__name__}(...)"


@dataclass(frozen=True, repr=False)
class Stats(Record):
    """Method, work and accuracy of a solve.  Pass the fields by keyword.

    method       name of the method
    steps        iterations of the method
    residual     norm of the equation that remains, in the units stated by the solver
    condition    condition number of the linear system, where it is estimated
    error_bound  upper limit of the error against the exact answer for the same floating-point input: one number, or
                 an object of the class of the value with a bound for each of its numbers
    """

    method: str
    steps: int = 0
    residual: float = np.nan
    condition: float = np.nan
    error_bound: Any = np.nan


@dataclass(frozen=True, repr=False)
class Solution(Record, Generic[Value]):
    """The outcome of a solve: `status` says whether `value` is trustworthy, `note` explains it in one sentence.

    A solution is true where its status is `ok`: `if solution:`.

    A solve with further results returns a frozen subclass with typed fields, defined next to the solver:

        @dataclass(frozen=True, kw_only=True, repr=False)
        class Optimum(Solution[CriticalConfiguration]):
            objective: float
    """

    value: Value
    status: Status
    stats: Stats
    note: str = ""

    def __repr__(self) -> str:
        note = [f"note={_brief(self.note)}"] * bool(self.note)
        rest = _shown_fields(self, ("value", "status", "stats", "note"))
        value = repr(self.value) if isinstance(self.value, Record) else _brief(self.value)
        return f"{type(self).__name__}({', '.join([self.status.name, value, *rest, *note])})"

    def __bool__(self) -> bool:
        return self.ok

    @property
    def ok(self) -> bool:
        return self.status is Status.ok

    @property
    def reason(self) -> str:
        """The note, or the message of the status where there is no note."""
        return self.note or self.status.message

    def or_raise(self, what: str) -> Self:
        """Return the solution if its status is `ok`, else raise a `SolveError` that carries the solution."""
        if not self.ok:
            raise SolveError(f"{what}: {self.reason}", self)
        return self


class CritflowError(Exception):
    """Base of the errors shown to users: one sentence with a suggestion."""


class InputError(CritflowError, ValueError):
    """An argument has a wrong value, type or shape."""


class NetworkError(InputError):
    """The edges, cell or pins do not describe a network whose stresses fix its configuration."""


class SolveError(CritflowError):
    """A solve failed and the caller requested an exception; `solution` contains the last state."""

    def __init__(self, message: str, solution: Solution[Any] | None = None):
        super().__init__(message)
        self.solution = solution


class StudyError(InputError):
    """A study file, a `--set` word or a results folder does not fit the command."""


class IntegrityError(CritflowError):
    """A stored file is damaged or belongs to something else."""


class EnvironmentFailure(CritflowError):
    """The disk or the machine refused an operation: full, read-only, out of memory."""
