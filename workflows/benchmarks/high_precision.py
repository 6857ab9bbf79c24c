"""High-precision numbers and linear systems: arrays of mpmath numbers, Gaussian elimination with a residual check.

Floating-point input is exact input.  A solution is checked by its residual in twice the digits; where fewer than
`WANTED` digits are correct, `precise` repeats the computation with three times the digits, and above `MOST` digits
`Unknown` is raised.  mpmath's `lu_solve` takes one right side and does not skip zeros, hence the elimination here.

Pure Python: 60 unknowns with 60 digits take 0.3 s, and the time grows with the cube of their number.
"""

from functools import wraps

import mpmath
import numpy as np

# Digits of the first attempt, correct digits required of an answer, and digits of the last attempt.
DIGITS, WANTED, MOST = 60, 30, 2000
# A context of this module: the precision of other users of mpmath does not change.
MP = mpmath.mp.clone()
MP.dps = DIGITS


class Unknown(Exception):
    """The reference has no answer."""


# Numbers


def numbers(*parts):
    """The exact sum of floating-point arrays (the parts of a double-double number) as an array of mpmath numbers."""
    arrays = [np.asarray(part) for part in parts]
    convert = np.vectorize(MP.mpf, otypes=[object])
    return sum(a if a.dtype == object else convert(a.astype(float)) for a in arrays)


def largest(values):
    """Largest magnitude, as a float."""
    return float(max(abs(v) for v in np.ravel(values)))


def largest_error(values, truth, moved=False):
    """Largest difference between floating-point numbers and the reference; infinite where a value is not finite.

    moved  whether the first row of the values (n, d) is the origin of the reference
    """
    if not np.isfinite(np.asarray(values, dtype=float)).all():
        return np.inf
    values = numbers(values)
    return largest(values - values[0] - truth if moved else values - truth)


roots = np.frompyfunc(MP.sqrt, 1, 1)


def zeros(*shape):
    return numbers(np.zeros(shape))


def dot(a, b):
    return (a * b).sum(axis=1)


# Linear systems


def precise(answer):
    """Decorator: repeat with more digits until there is an answer; `digits` are those of the first attempt."""

    @wraps(answer)
    def run(*arguments, digits=DIGITS, **options):
        while True:
            try:
                with MP.workdps(digits):
                    return answer(*arguments, **options)
            except (Unknown, ZeroDivisionError) as error:
                digits *= 3
                if digits > MOST:
                    raise Unknown(str(error)) from None

    return run


def solve(matrix, right):
    """The solution (n, m) of a dense system with right sides (n, m), to `WANTED` digits of its largest entry.

    Raises `Unknown` for a matrix that is singular in the current precision, and where too few digits are correct.
    """
    digits = MP.dps
    rows, order = _factorized(matrix)
    x = _substituted(rows, order, right)
    with MP.workdps(2 * digits):
        residual = right - matrix @ x
    correction = _substituted(rows, order, residual)
    if largest(correction) > 10.0**-WANTED * largest(x):
        raise Unknown(f"{digits} digits are too few for this system")
    return x + correction


def _factorized(matrix):
    """L and U in one array, and the order of the rows: partial pivoting, zeros skipped."""
    rows, order = matrix.copy(), np.arange(len(matrix))
    for k in range(len(rows)):
        pivot = k + int(np.argmax(abs(rows[k:, k])))
        if not rows[pivot, k]:
            raise Unknown("the matrix is singular")
        rows[[k, pivot]], order[[k, pivot]] = rows[[pivot, k]], order[[pivot, k]]
        below = k + 1 + np.flatnonzero(rows[k + 1 :, k])
        right = k + 1 + np.flatnonzero(rows[k, k + 1 :])
        rows[below, k] /= rows[k, k]
        rows[np.ix_(below, right)] -= np.multiply.outer(rows[below, k], rows[k, right])
    return rows, order


def _substituted(rows, order, right):
    x = right[order].copy()
    for k in range(1, len(x)):
        x[k] -= rows[k, :k] @ x[:k]
    for k in range(len(x) - 1, -1, -1):
        x[k] = (x[k] - rows[k, k + 1 :] @ x[k + 1 :]) / rows[k, k]
    return x
