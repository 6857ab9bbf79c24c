"""Whether an answer was right, said why not, or was silently wrong."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from enum import IntEnum
from typing import Any

import numpy as np

from critflow import InputError, SolveError, Status

from ..reference import Unknown

# Relative to the largest coordinate, or to the value: what rounding alone may do.
ROUNDING = 1e-13
# What a method may miss that is iterated to a tolerance and claims no bound of its own.
TOLERANCE = 1e-9


class Outcome(IntEnum):
    """What became of one point of the map."""

    absent = 0  # not asked
    exact = 1  # right to rounding
    bounded = 2  # right within the bound that it claims
    tolerated = 3  # right within the tolerance of a method that claims no bound
    said = 4  # a status says why not
    refused = 5  # a sentence says why not
    unknown = 6  # the reference does not know
    violation = 7


class Violation(IntEnum):
    """What is wrong about a silent wrong answer."""

    none = 0
    above_bound = 1  # status ok, and the error exceeds the claimed bound
    above_tolerance = 2  # status ok, no bound claimed, and the error exceeds the tolerance
    not_finite = 3  # status ok, and an answer that is no number
    warning = 4
    exception = 5  # an error that no user can read
    status = 6  # a status that contradicts the network, such as ok for a floppy one


class Carried(Exception):
    """What the question rests on had no answer; its status says why."""

    def __init__(self, status: Status):
        super().__init__(status.message)
        self.status = status


@dataclass(frozen=True)
class Answer:
    """What the library says: a status, numbers, and bounds on their errors (NaN: none claimed), of one shape or scalar.

    proper  statuses that say the truth about this network; others than ok need no numbers
    """

    status: Status
    values: Any
    bounds: Any = np.nan
    proper: tuple[Status, ...] = ()


@dataclass(frozen=True)
class Judgement:
    """Error and bound relative to the size of the answer, what became of it, and the sentence where there is one."""

    outcome: Outcome
    error: float = np.nan
    bound: float = np.nan
    status: Status = Status.missing
    violation: Violation = Violation.none
    note: str = ""


def judged(ask, compare, tolerance=TOLERANCE):
    """The judgement of an answer: `ask()` calls the library, `compare(answer)` gives its errors and the scales of them.

    Whatever the library does wrong on the way counts: warnings, and exceptions that are not its own.
    """
    with warnings.catch_warnings(record=True) as heard:
        warnings.simplefilter("always")
        try:
            answer = ask()
        except Carried as error:
            return Judgement(Outcome.said, status=error.status)
        except (InputError, SolveError) as error:
            return Judgement(Outcome.refused, note=str(error))
        except Exception as error:  # whatever else comes is what this looks for
            return _violation(Violation.exception, note=f"{type(error).__name__}: {error}")
    if heard:
        return _violation(Violation.warning, status=answer.status, note=str(heard[0].message))
    if answer.proper and answer.status not in answer.proper:
        return _violation(Violation.status, status=answer.status, note=f"not {answer.proper[0].name}")
    if answer.status is not Status.ok and answer.status not in answer.proper:
        return Judgement(Outcome.said, status=answer.status)
    values = np.asarray(answer.values, dtype=float)
    if not np.isfinite(values).all():
        return _violation(Violation.not_finite, status=answer.status)
    try:
        errors, scales = compare(answer)
    except Unknown as error:
        return Judgement(Outcome.unknown, status=answer.status, note=str(error))
    return weighed(errors, answer.bounds, scales, answer.status, tolerance)


def weighed(errors, bounds, scales, status=Status.ok, tolerance=TOLERANCE):
    """The judgement of errors against bounds, each relative to its scale; of several numbers the worst counts."""
    errors, bounds, scales = np.broadcast_arrays(
        np.atleast_1d(np.asarray(errors, dtype=float)), bounds, np.asarray(scales, dtype=float)
    )
    claimed = np.isfinite(bounds)
    limits = np.where(claimed, bounds, tolerance * scales)
    wrong = ~(errors <= limits)
    if wrong.any() or claimed.any():
        # Of numbers that keep their bounds, the one that comes nearest to breaking it.
        excess = np.where(limits > 0, errors / np.where(limits > 0, limits, 1.0), np.where(errors > 0, np.inf, 0.0))
        worst = int(np.argmax(np.where(wrong, np.inf, excess) if wrong.any() else excess))
    else:
        worst = int(np.argmax(errors / scales))
    error, bound = float(errors[worst] / scales[worst]), float(bounds[worst] / scales[worst])
    if wrong.any():
        kind = Violation.above_bound if claimed[worst] else Violation.above_tolerance
        return Judgement(Outcome.violation, error, bound, status, kind)
    if error <= ROUNDING:
        return Judgement(Outcome.exact, error, bound, status)
    return Judgement(Outcome.bounded if claimed[worst] else Outcome.tolerated, error, bound, status)


def _violation(kind, status=Status.missing, note=""):
    return Judgement(Outcome.violation, status=status, violation=kind, note=note)
