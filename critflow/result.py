"""Outcomes: the status codes that data files store, the answer of every solve, and the errors that users read.

Bad input raises a `CritflowError` at once.  Numerical failure is a `Status` inside a `Solution`; interactive calls
turn it into a `SolveError` that still carries the solution.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum
from typing import Any, Generic, TypeVar

Value = TypeVar("Value")


class Status(IntEnum):
    """What a solve ended with.  The integers are stored in files: append, never renumber."""

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

    @property
    def message(self) -> str:
        """What happened and what to try next."""
        return _MESSAGES[self]


_MESSAGES = {
    Status.ok: "converged to the asked tolerance",
    Status.floppy: "the network has no self-stress, so every modulus is exactly zero: strain it to the transition",
    Status.step_limit: "the step limit came before the tolerance: raise max_steps, or choose method='auto'",
    Status.stalled: "rounding stopped the progress before the tolerance: loosen it, or choose method='auto'",
    Status.singular: "the prestress matrix is singular here, so the stress has no configuration: move it away",
    Status.edge_collapse: "edges shrink to zero length on the way to the infimum: its value is a limit, not attained",
    Status.slack_edges: "some edges carry no tension at the transition: narrow the spread of the rest lengths",
    Status.unstable: "the equilibrium is a saddle of the energy: perturb it, or take smaller strain steps",
    Status.failed: "the case raised an error, which is stored beside it",
    Status.missing: "not computed yet: run the study again",
    Status.ill_conditioned: "rounding may have taken every digit of the answer: bring the stresses closer together",
}


@dataclass(frozen=True)
class Stats:
    """How a solve went: method used, work done, and how small the residual became (its unit stands with the solver).

    condition    how much the solved system magnifies relative errors, where it was estimated
    error_bound  what the error of the value does not exceed, against the exact answer for the same floating-point
                 input: one number, or an object of the value's own class with a bound for each of its numbers
    """

    method: str
    iterations: int = 0
    evaluations: int = 0
    residual: float = float("nan")
    details: dict[str, Any] = field(default_factory=dict)
    condition: float = float("nan")
    error_bound: Any = float("nan")


@dataclass(frozen=True)
class Solution(Generic[Value]):
    """The answer of a solve: `value` is trustworthy as far as `status` says."""

    value: Value
    status: Status
    stats: Stats

    @property
    def ok(self) -> bool:
        return self.status is Status.ok

    def or_raise(self, what: str) -> Solution[Value]:
        """Return the solution itself when it is good, else raise a `SolveError` that carries it."""
        if not self.ok:
            note = self.stats.details.get("note", "")
            raise SolveError(f"{what}: {note or self.status.message}", self)
        return self


class CritflowError(Exception):
    """Base of every error that a user of critflow reads: one sentence that says what to do next."""


class InputError(CritflowError, ValueError):
    """An argument has a wrong value, type or shape."""


class NetworkError(InputError):
    """The edges, cell or pins do not describe a network whose stresses fix its configuration."""


class SolveError(CritflowError):
    """A solve failed and the caller asked to be told; `solution` holds what was reached."""

    def __init__(self, message: str, solution: Solution[Any] | None = None):
        super().__init__(message)
        self.solution = solution


class StudyError(InputError):
    """A study file, a `--set` word or a results folder is not what the command needs."""


class IntegrityError(CritflowError):
    """A stored file is damaged or belongs to something else."""


class EnvironmentFailure(CritflowError):
    """The disk or the machine refused: full, read-only, out of memory."""
