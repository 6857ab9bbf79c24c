"""A near point that meets targets and linear limits, by sequential quadratic programs in a trust region.

    minimise ½|r(x)|²   subject to   low ≤ c(x) ≤ high,  A x ≥ b.

Each step d solves the program with c and r linearised, |R d| ≤ radius, by Clarabel; linear limits hold at every step.
Targets may be missed at a price for each unit (an exact penalty), so that every program has a solution, and where no
step reduces ½|r|² + price Σ|miss| at the highest price the point is the best compromise found.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import clarabel
import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.linalg import splu

from critflow.result import Status
from critflow.solvers.tolerances import (
    ARMIJO,
    GAINS,
    GAINS_OF_MISS,
    IDLE_STEPS,
    NEARLY_MET,
    PRICE,
    PRICED,
    RADIUS,
    RESTORING,
    SEQUENTIAL_STEP,
    TARGETS_MET,
)

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Limits:
    """Limits of targets low ≤ c ≤ high (n,), infinite where there are none, and linear ones A x ≥ b."""

    low: Array
    high: Array
    A: sp.csr_array
    b: Array

    def miss(self, values: Array) -> Array:
        """c minus the nearest value inside its limits, (n,)."""
        return np.asarray(values - np.clip(values, self.low, self.high))


class Nearest(NamedTuple):
    """The nearest point.

    x            unknowns
    values       c(x)
    multipliers  (n,) derivatives of ½|r|² by the targets
    status       `ok`, `infeasible` (best compromise), `step_limit` or `stalled`
    steps        quadratic programs
    """

    x: Array
    values: Array
    multipliers: Array
    status: Status
    steps: int


@dataclass(frozen=True, eq=False)
class _Point:
    """x, c(x) and its Jacobian J, r(x) and its Jacobian R."""

    x: Array
    c: Array
    J: Array
    r: Array
    R: sp.csr_array

    @property
    def gradient(self) -> Array:
        """Gradient of ½|r|²."""
        return np.asarray(self.R.T @ self.r)


class _Step(NamedTuple):
    """A step d, the multipliers of the targets, and whether the program was solved."""

    d: Array
    multipliers: Array
    solved: bool

    def size(self, point: _Point) -> float:
        """Largest component of R d."""
        return float(np.abs(point.R @ self.d).max(initial=0.0))


Targets = Callable[[Array], tuple[Array, Array]]
Distance = Callable[[Array], tuple[Array, sp.csr_array]]


@dataclass(frozen=True, eq=False)
class _Problem:
    targets: Targets
    limits: Limits
    distance: Distance

    def at(self, x: Array) -> _Point:
        return _Point(x, *self.targets(x), *self.distance(x))

    def cost(self, point: _Point, price: float) -> float:
        """½|r|² + ρ Σ|miss|."""
        return float(0.5 * point.r @ point.r + price * np.abs(self.limits.miss(point.c)).sum())

    def step(self, point: _Point, c: Array, price: float, hessian: sp.csr_array, radius: float) -> _Step:
        """The quadratic program with targets c + J d: unknowns d, and misses p, q ≥ 0 below and above."""
        limits, n, N = self.limits, len(c), len(point.x)
        same = limits.low == limits.high
        above, below = ~same & np.isfinite(limits.high), ~same & np.isfinite(limits.low)
        J, unit, nothing = sp.csc_array(point.J), sp.eye_array(n, format="csc"), sp.csc_array((len(limits.b), 2 * n))
        region = sp.csc_array((len(point.r), 2 * n))
        rows = [
            sp.hstack([J, unit, -unit])[same],
            sp.hstack([J, 0 * unit, -unit])[above],
            sp.hstack([-J, -unit, 0 * unit])[below],
            sp.hstack([-limits.A, nothing]),
            sp.hstack([point.R, region]),
            sp.hstack([-point.R, region]),
            sp.hstack([sp.csc_array((2 * n, N)), -sp.eye_array(2 * n)]),
        ]
        right = [(limits.high - c)[same], (limits.high - c)[above], (c - limits.low)[below]]
        right += [limits.A @ point.x - limits.b, np.full(2 * len(point.r), radius), np.zeros(2 * n)]
        P = sp.block_diag([sp.triu(hessian), sp.csc_array((2 * n, 2 * n))], format="csc")
        q = np.concatenate([point.gradient, np.full(2 * n, price)])
        free, signed = int(same.sum()), sum(len(part) for part in right) - int(same.sum())
        cones = [clarabel.ZeroConeT(free)] * (free > 0) + [clarabel.NonnegativeConeT(signed)]
        found = _solve(P, q, sp.vstack(rows, format="csc"), np.concatenate(right), cones)
        z, mu = np.array(found.z), np.zeros(n)
        ends = np.cumsum([len(part) for part in right])
        mu[same] -= z[: ends[0]]
        mu[above] -= z[ends[0] : ends[1]]
        mu[below] += z[ends[1] : ends[2]]
        solved = str(found.status) in ("Solved", "AlmostSolved", "InsufficientProgress")
        return _Step(np.array(found.x)[:N], mu, solved and bool(np.isfinite(found.x).all()))

    def restored(self, point: _Point) -> Array:
        """x after the shortest step, in r, to the targets that are missed; tight limits stay as they are."""
        limits, x, c = self.limits, point.x, point.c
        miss, spare = limits.miss(c), limits.A @ x - limits.b
        active = (np.minimum(np.abs(c - limits.low), np.abs(limits.high - c)) < NEARLY_MET) | (miss != 0)
        tight = spare < NEARLY_MET
        J = np.concatenate([point.J[active], limits.A[np.flatnonzero(tight)].toarray()])
        right = np.concatenate([miss[active], np.zeros(int(tight.sum()))])
        inverse = splu(sp.csc_matrix(point.R.T @ point.R)).solve(J.T)
        return np.asarray(x - inverse @ np.linalg.lstsq(J @ inverse, right, rcond=1e-13)[0])


def nearest_point(targets: Targets, limits: Limits, distance: Distance, start: Array, max_steps: int) -> Nearest:
    """The point of about the least ½|r|² near `start` (N,), which must meet the linear limits.

    targets   function of x that returns c (n,), of order one, and its Jacobian (n, N)
    distance  function of x that returns r (m,) and its Jacobian (m, N)

    Along the curved surface of the targets the last digits of the distance are slow, so that the descent ends where a
    few steps gain little, and the shortest steps to the targets follow.
    """
    problem, price, radius, idle = _Problem(targets, limits, distance), PRICE, RADIUS, 0
    point = problem.at(start)
    for n in range(max_steps):
        hessian = sp.csr_array(point.R.T @ point.R)
        step = problem.step(point, point.c, price, hessian, radius)
        error = float(np.abs(limits.miss(point.c)).max())
        ended = not step.solved or step.size(point) < SEQUENTIAL_STEP or idle >= IDLE_STEPS
        if ended and error > NEARLY_MET and price < PRICED:
            price, radius, idle = min(10 * price, PRICED), RADIUS, 0
            continue
        if ended:
            return _finished(problem, point, step, n)
        moved, ratio = _moved(problem, point, step, price, hessian, radius)
        before, size = problem.cost(point, price), step.size(point)
        if ratio > ARMIJO:
            point = moved
            gain = before - problem.cost(point, price)
            idle = idle + 1 if gain < before * (GAINS if error <= NEARLY_MET else GAINS_OF_MISS) else 0
        if ratio > 0.75:
            radius = max(radius, min(2 * radius, 2 * size))
        elif ratio < 0.25:
            radius = 0.25 * min(radius, size)
        if error > NEARLY_MET and np.abs(step.multipliers).max() > 0.5 * price:
            price = min(10 * price, PRICED)
    return _finished(problem, point, step, max_steps, limited=True)


def _finished(problem: _Problem, point: _Point, step: _Step, n: int, limited: bool = False) -> Nearest:
    """The nearest point after shortest steps to the targets; a compromise where they are far."""
    if not np.abs(problem.limits.miss(point.c)).max() <= NEARLY_MET:
        status = Status.stalled if not step.solved else Status.step_limit if limited else Status.infeasible
        return Nearest(point.x, point.c, step.multipliers, status, n)
    for _ in range(RESTORING):
        error = np.abs(problem.limits.miss(point.c)).max()
        if error < TARGETS_MET:
            break
        trial = problem.at(problem.restored(point))
        if not np.abs(problem.limits.miss(trial.c)).max() < error:
            break
        point = trial
    met = np.abs(problem.limits.miss(point.c)).max() < TARGETS_MET
    return Nearest(point.x, point.c, step.multipliers, Status.ok if met else Status.stalled, n)


def _moved(
    problem: _Problem, point: _Point, step: _Step, price: float, hessian: sp.csr_array, radius: float
) -> tuple[_Point, float]:
    """The point after a step, corrected for the curvature of the targets if needed, and its gain over the predicted."""
    before, d, miss = problem.cost(point, price), step.d, problem.limits.miss
    gained = float(np.abs(miss(point.c)).sum() - np.abs(miss(point.c + point.J @ d)).sum())
    decrease = price * gained - float(point.gradient @ d) - 0.5 * float(d @ (hessian @ d))
    if not decrease > 0:
        return point, 0.0
    trial = problem.at(point.x + d)
    ratio = (before - problem.cost(trial, price)) / decrease
    if ratio < 0.25:
        second = problem.step(point, trial.c - point.J @ d, price, hessian, radius)
        if second.solved:
            corrected = problem.at(point.x + second.d)
            better = (before - problem.cost(corrected, price)) / decrease
            if better > ratio:
                return corrected, better
    return trial, ratio


def _solve(P: sp.csc_array, q: Array, A: sp.csc_array, b: Array, cones: list) -> clarabel.DefaultSolution:
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.max_threads = 1
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-13
    return clarabel.DefaultSolver(sp.csc_matrix(P), q, sp.csc_matrix(A), b, cones, settings).solve()
