"""Smooth optimisation with few constraints and many unknowns: constraints first, then the objective as well.

    minimise f(z)  subject to  l ≤ c(z) ≤ u,
with z (N,), and n ≪ N constraints of size one that matter at a time.  With H the inverse of a limited-memory BFGS
matrix of the Lagrangian, started from the unit matrix or another one, a step is
    d = −H (∇f + Jᵀμ),
where μ is the solution of the dual quadratic program, of the size of the constraints: free for l = u, of one sign at a
limit.  A step along the surface that does not reduce the merit function is followed by a shortest one, in the same
metric, towards the constraints: their curvature otherwise blocks all but very short steps.
Restoration is damped where the gradients of the constraints are nearly dependent (Levenberg and Marquardt).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Protocol, Self

import numpy as np
import scipy
from numpy.typing import NDArray

from critflow.minimisers import ARMIJO, ROUNDING
from critflow.result import Status

RESTORED = 1e-11  # violation of a constraint that counts as satisfied, in units of its size
# Eigenvalue of the Gram matrix of gradients below which they count as dependent, relative to the largest: the rounding
# of gradients, squared, is below it.
DEPENDENT = 1e-14
# Least eigenvalue of the Gram matrix with limits, relative to the largest: multipliers of dependent limits stay
# finite, and the limits hold to this part.
FLOOR = 1e-12
CURVED = 1e-8  # cosine between a step and its change of gradient below which it says nothing about the curvature

Array = NDArray[np.float64]
Product = Callable[[Array], Array]
First = Callable[[Array], Product]

# Pairs of the limited-memory matrix; steps to the constraints after one that reduces no merit, and at the end.
_MEMORY, _RESTORING, _AT_END = 20, 1, 30
# Pairs for few unknowns, up to which number they cost little.
_LONG_MEMORY, _FEW = 60, 100
# Largest and smallest damping of restoration, in units of the mean square gradient; shortest part of a step.
_MOST_DAMPED, _LEAST_DAMPED, _SHORTEST = 1e4, 1e-10, 1e-4
# Part of a step below which the pairs of the matrix are forgotten.
_SHORT = 0.05
# Distance from a limit within which a constraint takes part in a step.
_NEAR = 0.02


@dataclass(frozen=True, eq=False)
class Point:
    """Values at z: f, ∇f (N,), constraints c (n,), and their gradients by index, rows(indices) (m, N)."""

    z: Array
    value: float
    gradient: Array
    constraints: Array
    rows: Callable[[NDArray[np.intp]], Array] = field(repr=False)
    # Rounding error of the value, where a difference has removed digits.
    rounding: float = 0.0


class Problem(Protocol):
    """A constrained problem: limits (n,), and a function of z; a value that is not finite is outside the domain."""

    low: Array
    high: Array

    def at(self, z: Array) -> Point: ...


@dataclass(frozen=True, eq=False)
class Minimum:
    """The end of a search: z, multipliers (n,) with ∇f + Jᵀμ = 0, remaining violation and gradient, and the outcome."""

    point: Point
    multipliers: Array
    violation: float
    residual: float
    steps: int
    status: Status

    @property
    def reached(self) -> bool:
        """Whether all constraints are satisfied."""
        return self.violation <= RESTORED


class _Working:
    """The constraints that matter at a point: all equations, and those near or beyond a limit, as c − limit."""

    def __init__(self, problem: Problem, point: Point):
        c, low, high = point.constraints, problem.low, problem.high
        equal = low == high
        near = np.flatnonzero(equal | (c < low + _NEAR) | (c > high - _NEAR))
        self.indices, self.equal, self._point = near, equal[near], point
        lower = ~self.equal & (c[near] - low[near] < high[near] - c[near])
        # Signed so that a limit means c − limit ≤ 0 and μ ≥ 0.
        self.sign = np.where(lower, -1.0, 1.0)
        limit = np.where(lower, low[near], high[near])
        self.excess = self.sign * (c[near] - limit)

    @cached_property
    def rows(self) -> Array:
        return self.sign[:, None] * self._point.rows(self.indices)

    def multipliers(self, gram: Array, right: Array) -> Array:
        """μ of least ½μᵀ gram μ − right·μ, where μ ≥ 0 for limits."""
        if not len(right):
            return right
        if not np.isfinite(gram).all() or not np.isfinite(right).all():
            return np.full(len(right), np.nan)
        if self.equal.all():
            return np.asarray(np.linalg.lstsq(gram, right, rcond=DEPENDENT)[0])
        values, vectors = np.linalg.eigh(gram)
        # Dependent limits have their own signs, so that directions without an eigenvalue remain.
        root = np.sqrt(np.maximum(values, FLOOR * max(values[-1], np.finfo(float).tiny)))
        A = root[:, None] * vectors.T
        # Free multipliers as differences of two that are not negative.
        parts, _ = scipy.optimize.nnls(np.hstack([A, -A[:, self.equal]]), (vectors.T @ right) / root)
        mu = parts[: len(right)]
        mu[self.equal] -= parts[len(right) :]
        return np.asarray(mu)

    def optimality(self) -> tuple[Array, float]:
        """The multipliers of the constraints that hold, and the largest component of ∇f + Jᵀμ."""
        J, g = self.rows, self._point.gradient
        mu = self.multipliers(J @ J.T, np.where(self.equal, 0.0, np.minimum(self.excess, 0.0)) - J @ g)
        return mu, float(np.abs(g + mu @ J).max(initial=0.0))


class _Metric:
    """H, the inverse of a limited-memory BFGS matrix: products with vectors (N,) or rows (n, N)."""

    def __init__(self, first: First | None, n_unknowns: int, growth: float = 1.0):
        longest = _LONG_MEMORY if n_unknowns <= _FEW else _MEMORY
        self._pairs: deque[tuple[Array, Array, float]] = deque(maxlen=longest)
        self._first, self._scale, self._growth = first, 1.0, growth
        self._product: Product | None = None

    def at(self, z: Array) -> Self:
        """The same pairs with the first matrix at z."""
        self._product = None if self._first is None else self._first(z)
        return self

    def add(self, s: Array, y: Array) -> None:
        curvature = float(s @ y)
        if curvature > CURVED * float(np.linalg.norm(s) * np.linalg.norm(y)):
            self._pairs.append((s, y, 1 / curvature))
            self._scale = curvature / float(y @ (y if self._product is None else self._product(y)))
        elif not self._pairs:
            # Downwards without an end in sight: no pair says how far, so that steps become longer.
            self._scale *= self._growth

    def forget(self) -> bool:
        """Forget all pairs; whether there were any."""
        some = bool(self._pairs)
        self._pairs.clear()
        self._scale = 1.0
        return some

    def times(self, rows: Array) -> Array:
        q, parts = np.array(rows, copy=True), []
        for s, y, rho in reversed(self._pairs):
            part = rho * (q @ s)
            q -= part[..., None] * y
            parts.append(part)
        q = self._scale * (q if self._product is None else self._product(q))
        for (s, y, rho), part in zip(self._pairs, reversed(parts), strict=True):
            q += (part - rho * (q @ y))[..., None] * s
        return q


def minimise_constrained(
    problem: Problem,
    start: Array,
    tolerance: float,
    longest: float,
    max_steps: int,
    first: First | None = None,
    restoring: int | None = None,
    growth: float = 1.0,
) -> Minimum:
    """A local minimum from a start (N,).

    tolerance  largest component of ∇f + Jᵀμ, relative to 1 + |∇f|
    longest    largest change of a component in one step
    first      at z, products of rows (n, N) with the first inverse Hessian, the unit matrix by default
    restoring  steps in which the constraints must be satisfied first, all by default
    growth     of each step while the function curves downwards from the start on

    `Status.not_reached` where the violation cannot be reduced to first order or is NaN at the start;
    `Status.step_limit` and `Status.stalled` for the objective: the constraints are then satisfied.
    """
    metric, search = _Metric(first, len(start), growth), _Search(problem, longest)
    point = feasible = search.restored(
        problem.at(start), metric, max_steps if restoring is None else min(max_steps, restoring)
    )
    if not violation(problem, point) <= RESTORED:
        status = Status.step_limit if search.steps >= max_steps else Status.not_reached
        return search.end(point, status)
    while True:
        step = search.step(point, metric)
        optimal = step.residual <= tolerance * (1 + float(np.abs(point.gradient).max()))
        if optimal and violation(problem, point) <= tolerance:
            status = Status.ok
        elif search.steps >= max_steps:
            status = Status.step_limit
        else:
            moved = search.along(point, step, metric)
            if moved is not None:
                change = moved.z - point.z
                if np.linalg.norm(change) < _SHORT * np.linalg.norm(step.d):
                    # The model is far off: where the curvature is negative, no later pair would replace it.
                    metric.forget()
                else:
                    # The change of the gradient of the Lagrangian.
                    working = step.working
                    rows = working.sign[:, None] * moved.rows(working.indices) - working.rows
                    metric.add(change, moved.gradient - point.gradient + step.multipliers @ rows)
                point = moved
                if violation(problem, point) <= RESTORED and point.value < feasible.value:
                    feasible = point
                continue
            if metric.forget():
                continue
            status = Status.stalled
        point = search.restored(point, _Metric(first, len(start)), _AT_END)
        if not violation(problem, point) <= RESTORED:
            # The minimum was that of the point which rounding keeps off the constraints.
            point, status = feasible, Status.stalled if status is Status.ok else status
        return search.end(point, status)


def violation(problem: Problem, point: Point) -> float:
    """The largest distance of a constraint from its limits."""
    return float(np.abs(_beyond(problem, point)).max(initial=0.0))


def _beyond(problem: Problem, point: Point) -> Array:
    return point.constraints - np.clip(point.constraints, problem.low, problem.high)


@dataclass(frozen=True, eq=False)
class _Step:
    """A step (N,) with the multipliers of the working constraints and the residual of optimality."""

    d: Array
    multipliers: Array
    working: _Working
    residual: float


class _Search:
    """The steps of one search and their number."""

    def __init__(self, problem: Problem, longest: float):
        self.problem, self.longest, self.steps, self.penalty = problem, longest, 0, 0.0

    def step(self, point: Point, metric: _Metric) -> _Step:
        """The step to the minimum of the quadratic model, at linearised constraints."""
        working = _Working(self.problem, point)
        J, g = working.rows, point.gradient
        H = metric.at(point.z).times(np.vstack([J, g]))
        HJ, Hg = H[:-1], H[-1]
        mu = working.multipliers(J @ HJ.T, working.excess - J @ Hg)
        return _Step(-(Hg + mu @ HJ), mu, working, working.optimality()[1])

    def along(self, point: Point, step: _Step, metric: _Metric) -> Point | None:
        """A point with a smaller value of f + penalty·Σ|violation|, or None."""
        self.penalty = 1.2 * float(np.abs(step.multipliers).max(initial=0.0))
        here = self._merit(point)
        rate = float(point.gradient @ step.d) - self.penalty * float(np.abs(_beyond(self.problem, point)).sum())
        part = min(1.0, self.longest / max(float(np.abs(step.d).max()), 1e-300))
        while part > _SHORTEST:
            self.steps += 1
            moved = self.problem.at(point.z + part * step.d)
            acceptable = here - ARMIJO * part * abs(rate) + ROUNDING * (1 + abs(here))
            if not self._merit(moved) <= acceptable and np.isfinite(self._merit(moved)):
                # Curvature of the constraints may hide a decrease: return towards their surface.
                moved = self.restored(moved, metric, _RESTORING)
            if self._merit(moved) <= acceptable or self._nearer(point, step, moved, part):
                return moved
            part *= 0.3
        return None

    def _nearer(self, point: Point, step: _Step, moved: Point, part: float) -> bool:
        """Whether a point whose value differs by rounding only is nearer to a stationary one, by the gradients.

        Along the step the derivative of the Lagrangian is then smaller in size (Hager and Zhang, 2005).
        """
        if not (moved.rounding > 0 and self._merit(moved) <= self._merit(point) + moved.rounding):
            return False
        working = step.working
        rows = working.sign[:, None] * moved.rows(working.indices)
        before = (point.gradient + step.multipliers @ working.rows) @ step.d
        return bool(abs((moved.gradient + step.multipliers @ rows) @ step.d) <= 0.8 * abs(before))

    def _merit(self, point: Point) -> float:
        return point.value + self.penalty * float(np.abs(_beyond(self.problem, point)).sum())

    def restored(self, point: Point, metric: _Metric, most: int) -> Point:
        """The point after at most `most` damped Gauss-Newton steps that reduce the violation."""
        damping, size, last = 0.0, self._size(point), self.steps + most
        step: tuple[_Working, Array, Array] | None = None
        part = 1.0
        while size > 0 and violation(self.problem, point) > 0.01 * RESTORED and self.steps < last:
            if step is None:
                working = _Working(self.problem, point)
                HJ = metric.at(point.z).times(working.rows)
                step = working, HJ, working.rows @ HJ.T
            working, HJ, gram = step
            # Limits that hold are not damped: linear ones then hold after the step.
            violated = working.equal | (working.excess > RESTORED)
            damped = gram + np.diag(damping * (np.trace(gram) / max(len(gram), 1)) * violated)
            d = -part * (working.multipliers(damped, working.excess) @ HJ)
            d *= min(1.0, self.longest / max(float(np.abs(d).max()), 1e-300))
            self.steps += 1
            moved = self.problem.at(point.z + d)
            there = self._size(moved)
            if not np.isfinite(there) and part > _SHORTEST:
                part *= 0.3
            elif there < (1 - 1e-3 * part) * size:
                point, size, step, part = moved, there, None, 1.0
                damping = 0.1 * damping if damping > _LEAST_DAMPED else 0.0
            elif violation(self.problem, point) <= RESTORED or damping > _MOST_DAMPED:
                break
            else:
                damping, part = max(10 * damping, _LEAST_DAMPED), 1.0
        return point

    def _size(self, point: Point) -> float:
        size = float(np.linalg.norm(_beyond(self.problem, point)))
        return size if np.isfinite(size) and np.isfinite(point.value) else np.inf

    def end(self, point: Point, status: Status) -> Minimum:
        working = _Working(self.problem, point)
        mu, residual = working.optimality()
        multipliers = np.zeros(len(point.constraints))
        multipliers[working.indices] = working.sign * mu
        return Minimum(point, multipliers, violation(self.problem, point), residual, self.steps, status)
