"""Outcome of one point of the failure map: correct, refused with a reason, or silently wrong."""

import warnings
from dataclasses import dataclass
from enum import IntEnum
from typing import Any

import numpy as np

from critflow import InputError, SolveError, Status

from ..reference import Unknown

# Error of rounding, relative to the largest coordinate or to the value.
ROUNDING = 1e-13
# Error of an iterative method without an error bound.
TOLERANCE = 1e-9


class Outcome(IntEnum):
    """Outcome of one point, as stored in data files: append, never renumber."""

    absent = 0  # not computed
    exact = 1  # correct to rounding
    bounded = 2  # correct within the claimed bound
    tolerated = 3  # correct within the tolerance of a method without a bound
    reported = 4  # a status with the reason
    refused = 5  # an error message with the reason
    unknown = 6  # the reference has no answer
    violation = 7  # a silent wrong answer


class Violation(IntEnum):
    """Kind of a silent wrong answer, as stored in data files: append, never renumber."""

    none = 0
    above_bound = 1  # status ok, and the error exceeds the claimed bound
    above_tolerance = 2  # status ok, no bound claimed, and the error exceeds the tolerance
    not_finite = 3  # status ok, and an answer that is not a number
    warning = 4
    exception = 5  # an exception that is not a CritflowError


class Unavailable(Exception):
    """A quantity that requires another quantity without an answer; `status` is the status of the latter."""

    def __init__(self, status: Status):
        super().__init__(status.message)
        self.status = status


@dataclass(frozen=True)
class Answer:
    """Status, numbers and bounds on their errors returned by the library; NaN without a bound."""

    status: Status
    values: Any
    bounds: Any = np.nan


@dataclass(frozen=True)
class Finding:
    """Outcome of an answer, with error and bound relative to its size, and the calls of a peer."""

    outcome: Outcome
    error: float = np.nan
    bound: float = np.nan
    status: Status = Status.missing
    violation: Violation = Violation.none
    calls: int = 0


def assessed(compute, compare):
    """The finding on an answer: `compute()` calls the library, `compare(answer)` returns its errors and their scales.

    Warnings and exceptions other than `CritflowError` are violations.
    """
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            answer = compute()
        except Unavailable as error:
            return Finding(Outcome.reported, status=error.status)
        except (InputError, SolveError):
            return Finding(Outcome.refused)
        except Exception:  # any other exception is a violation
            return _violation(Violation.exception)
    if caught:
        return _violation(Violation.warning, answer.status)
    if answer.status is not Status.ok:
        return Finding(Outcome.reported, status=answer.status)
    values = np.asarray(answer.values, dtype=float)
    if not np.isfinite(values).all():
        return _violation(Violation.not_finite, answer.status)
    try:
        errors, scales = compare(answer)
    except Unknown:
        return Finding(Outcome.unknown, status=answer.status)
    return compared(errors, answer.bounds, scales, answer.status)


def compared(errors, bounds, scales, status=Status.ok):
    """The finding on errors and bounds, each relative to its scale; of several numbers the worst counts."""
    errors, bounds, scales = np.broadcast_arrays(
        np.atleast_1d(np.asarray(errors, dtype=float)), bounds, np.asarray(scales, dtype=float)
    )
    claimed = np.isfinite(bounds)
    limits = np.where(claimed, bounds, TOLERANCE * scales)
    wrong = ~(errors <= limits)
    if wrong.any() or claimed.any():
        # Of numbers within their bounds, the one nearest to its bound.
        excess = np.where(limits > 0, errors / np.where(limits > 0, limits, 1.0), np.where(errors > 0, np.inf, 0.0))
        worst = int(np.argmax(np.where(wrong, np.inf, excess) if wrong.any() else excess))
    else:
        worst = int(np.argmax(errors / scales))
    error, bound = float(errors[worst] / scales[worst]), float(bounds[worst] / scales[worst])
    if wrong.any():
        kind = Violation.above_bound if claimed[worst] else Violation.above_tolerance
        return Finding(Outcome.violation, error, bound, status, kind)
    if error <= ROUNDING:
        return Finding(Outcome.exact, error, bound, status)
    return Finding(Outcome.bounded if claimed[worst] else Outcome.tolerated, error, bound, status)


def _violation(kind, status=Status.missing):
    return Finding(Outcome.violation, status=status, violation=kind)
