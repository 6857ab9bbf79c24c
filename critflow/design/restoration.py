"""Shortest changes of logarithms θ that reach targets: damped Gauss-Newton steps, and the nearest solution.

The unknowns are θ = log k, of which there are many more than targets.  Shortest steps restore the targets,
and steps along their surface reduce the distance to the start θ_0 until θ − θ_0 = Jᵀμ.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from critflow.design.tolerances import TARGET_REACHED, TARGET_STATIONARY
from critflow.networks.network import Array
from critflow.result import InputError, Status

# Longest change of log σ in one step; part of a step below which the search ends.
_LONGEST, _SHORTEST = 1.0, 1e-3
# Steps that may restore the targets after one along their surface.
_RESTORING, _APPROACHES = 6, 30

Interval = float | tuple[float, float]


class Goals(Protocol):
    """Targets as functions of θ."""

    def at(self, theta: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
        """Relative errors (n,), 0 inside an interval, their gradients (n, N), and the targets not inside (n,)."""
        ...


def nearest_solution(goals: Goals, origin: Array, max_steps: int) -> tuple[Array, Array, Array, int, Status, str]:
    """θ, θ_0, multipliers, steps, status and note: first the targets, then the distance at constant targets."""
    point, steps, reached = restored(goals, Point(origin, *goals.at(origin)), max_steps)
    if not reached:
        status = Status.step_limit if steps >= max_steps else Status.infeasible
        note = "the errors of the targets cannot be reduced together from here: relax one, or give another start"
        return point.theta, origin, point.multipliers(origin), steps, status, note if steps < max_steps else ""
    part = 1.0
    for _ in range(_APPROACHES):
        tangent = point.tangential(origin - point.theta)
        if float(np.abs(tangent).max()) < TARGET_STATIONARY or part < _SHORTEST:
            break
        moved = point.theta + min(part, _LONGEST / float(np.abs(tangent).max())) * tangent
        trial, more, reached = restored(goals, Point(moved, *goals.at(moved)), _RESTORING)
        steps += more + 1
        if reached and np.linalg.norm(trial.theta - origin) < np.linalg.norm(point.theta - origin):
            point, part = trial, min(1.0, 2 * part)
        else:
            part *= 0.25
    return point.theta, origin, point.multipliers(origin), steps, Status.ok, ""


@dataclass(frozen=True, eq=False)
class Point:
    """θ, the relative errors of the targets (n,), their gradients J (n, N_b), and those not inside limits (n,)."""

    theta: Array
    error: Array
    J: Array
    active: NDArray[np.bool_]

    def normal(self, damping: float) -> Array:
        """The shortest change of θ that removes the errors to first order."""
        weights = self.J @ self.J.T
        weights[np.diag_indices(len(weights))] += damping * np.trace(weights) + np.finfo(float).tiny
        return np.asarray(-self.J.T @ np.linalg.lstsq(weights, self.error, rcond=1e-13)[0])

    def multipliers(self, origin: Array) -> Array:
        """μ of θ − θ_0 = Jᵀμ in the sense of least squares, (n,)."""
        mu = np.zeros(len(self.J))
        mu[self.active] = np.linalg.lstsq(self.J[self.active].T, self.theta - origin, rcond=None)[0]
        return mu

    def tangential(self, change: Array) -> Array:
        """The part of a change that leaves the targets constant to first order."""
        J = self.J[self.active]
        return np.asarray(change - J.T @ np.linalg.lstsq(J.T, change, rcond=None)[0])


def restored(goals: Goals, point: Point, max_steps: int) -> tuple[Point, int, bool]:
    """Damped Gauss-Newton steps until all errors are below `TARGET_REACHED`; steps, and whether they are."""
    damping, size = 0.0, float(np.linalg.norm(point.error))
    for step in range(max_steps):
        if np.abs(point.error).max() < TARGET_REACHED:
            return point, step, True
        change = point.normal(damping)
        change *= min(1.0, _LONGEST / max(float(np.abs(change).max()), 1e-300))
        theta = point.theta + change
        trial = Point(theta, *goals.at(theta))
        there = float(np.linalg.norm(trial.error))
        if there < size:
            point, size, damping = trial, there, 0.1 * damping if damping > 1e-8 else 0.0
        elif size < 100 * TARGET_REACHED and not damping:
            return point, step, True
        elif damping > 1e6:
            return point, step, False
        else:
            damping = max(10 * damping, 1e-6)
    return point, max_steps, bool(np.abs(point.error).max() < TARGET_REACHED)


def limits_of(name: str, value: Interval) -> tuple[float, float]:
    """Low and high limit of a target."""
    low, high = value if isinstance(value, tuple | list) and len(value) == 2 else (value, value)
    try:
        limits = float(low), float(high)
    except (TypeError, ValueError):
        raise InputError(f"the target {name} must be a number or a pair of limits, not {value!r:.40}") from None
    if np.isnan(limits).any() or limits[0] > limits[1] or np.isinf(limits).all():
        raise InputError(f"the target {name} must be a number or a pair (low, high), not {value!r:.40}")
    return limits
