"""Minimisers of a smooth function of a vector: FIRE, L-BFGS and Newton's method with conjugate gradients.

`minimise` owns the loop, the step limit and the stop status; a method yields one point after the other.
Convergence is judged by the residual that the function defines (a norm of its gradient in the units of the problem),
not by a relative change of the value: near the transition a small change of energy is not a small error.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from scipy.linalg.lapack import dtrtrs

from critflow.arguments import Array
from critflow.result import Status

ARMIJO = 1e-4  # part of the predicted decrease that a step must reach (Nocedal & Wright, section 3.1)
ROUNDING = 1e-14  # relative change of a value that is rounding: the roundings of one sum over the edges
FLAT = 1e-11  # curvature of a flat direction, relative to the steepest: the precision of Hessian-vector products
IDLE = 100  # steps of L-BFGS without a smaller value or residual after which rounding has stopped it
MEMORY = 15  # pairs of L-BFGS
LONGEST = 0.7  # largest change of a component of x in one step of L-BFGS
MIXING = 0.25  # of FIRE, where the velocity is reset
PRODUCTS = 400  # Hessian-vector products of one step of Newton's method


@dataclass(frozen=True, eq=False)
class Point:
    """A function at x: value, gradient (n,), residual (a norm of the gradient), and the state of its derivatives.

    state  data of the function at x that Hessian-vector products need, independent of later evaluations
    """

    x: Array
    value: float
    gradient: Array
    residual: float
    state: Any = None


class Function(ABC):
    """A smooth function of a vector x (n,)."""

    @abstractmethod
    def at(self, x: Array) -> Point:
        """Value and derivatives at x; a value that is not finite marks x as outside the domain."""

    def preconditioner(self, point: Point) -> Array | float:
        """A diagonal part of the Hessian that is known, ≥ 0; zero without one."""
        return 0.0

    def hessian_product(self, point: Point, direction: Array) -> Array:
        """The Hessian at a point times a direction (n,); only Newton's method and the saddle test need it."""
        raise NotImplementedError(f"{type(self).__name__} has no Hessian: choose FIRE or L-BFGS")


Method = Callable[[Function, Point], Iterator[tuple[Point, bool]]]
"""One algorithm, from a point: after each step the next point, and whether further progress is possible."""

Monitor = Callable[[Point], Status | None]
"""Called with the start and the point after each step; a status other than None ends the minimisation."""


Minimum: TypeAlias = tuple[Point, Status, int]
"""Last point of a minimisation, its stop status and the number of steps."""


def minimise(
    function: Function,
    method: Method,
    x0: Array,
    tolerance: float,
    max_steps: int,
    monitor: Monitor | None = None,
    stationary: float = np.inf,
) -> Minimum:
    """Minimise a function from x0 (n,) until its residual is below the tolerance.

    stationary  residual of a start above which a step is tried even if it meets the tolerance: a rough tolerance may be
                met where the function is largest

    Other stop statuses: `singular` for a value that is not finite, `stalled`, `step_limit`, and those of the monitor.
    """
    point = function.at(x0)
    points = method(function, point)
    for step in range(max_steps):
        if point.residual < tolerance and (step or point.residual <= stationary):
            return point, Status.ok, step
        if not np.isfinite(point.value):
            return point, Status.singular, step
        if monitor is not None and (status := monitor(point)) is not None:
            return point, status, step
        point, progress = next(points)
        if not progress:
            return point, Status.ok if point.residual < tolerance else Status.stalled, step
    return point, Status.ok if point.residual < tolerance else Status.step_limit, max_steps


def fire(function: Function, point: Point, time_step: float, max_move: float = 0.5) -> Iterator[tuple[Point, bool]]:
    """FIRE 2.0, the method of the paper: damped dynamics, stopped when the value rises (Guénolé et al., 2020).

    Semi-implicit Euler with unit masses.  After 20 steps of descent the time step grows, up to tenfold; after a step
    against the force it shrinks and half the step is reversed.

    time_step  initial time step
    max_move   largest change of a component of x in one step
    """
    x, velocity, mixing, descending = point.x, np.zeros_like(point.x), MIXING, 0
    longest = 10 * time_step
    while True:
        force = -point.gradient
        if force @ velocity > 0:
            descending += 1
            if descending > 20:
                time_step, mixing = min(1.1 * time_step, longest), 0.99 * mixing
        else:
            x = x - 0.5 * time_step * velocity
            velocity = np.zeros_like(velocity)
            time_step, mixing, descending = max(0.5 * time_step, 2e-3 * longest), MIXING, 0
        velocity = velocity + time_step * force
        speed, strength = np.linalg.norm(velocity), np.linalg.norm(force)
        if strength > 0:
            velocity = (1 - mixing) * velocity + (mixing * speed / strength) * force
        move = time_step * float(np.abs(velocity).max())
        if move > max_move:
            velocity = velocity * (max_move / move)
        trial = function.at(x + time_step * velocity)
        if trial.value == np.inf:
            # Outside the domain: stop in front of its boundary and continue more slowly.
            velocity, time_step = np.zeros_like(velocity), 0.5 * time_step
        else:
            point, x = trial, trial.x
        yield point, True


class Pairs:
    """The last changes of x and of the gradient, s_i and y_i: the inverse Hessian of L-BFGS.

    With S and Y from old to new, R the upper triangle of Sᵀ Y and D its diagonal, the two loops over the pairs are two
    triangular systems (Nocedal & Wright, algorithm 7.4):
        R a = Sᵀ g,   r = H₀ (g − Y a),   Rᵀ w = D a − Yᵀ r,   H⁻¹ g = r + S w.
    """

    def __init__(self, memory: int, n: int):
        # The place of the oldest pair takes the next one.
        self._dx, self._dgradient, self._products = (np.empty((memory, size)) for size in (n, n, memory))
        self.order: list[int] = []

    def append(self, dx: Array, dgradient: Array) -> None:
        place = self.order.pop(0) if len(self.order) == len(self._dx) else len(self.order)
        self.order.append(place)
        self._dx[place], self._dgradient[place] = dx, dgradient
        stored = slice(len(self.order))
        self._products[stored, place] = self._dx[stored] @ dgradient

    def direction(self, gradient: Array, diagonal: Array | float) -> Array:
        """−H⁻¹ g with the inverse Hessian implied by the pairs and a diagonal part of the Hessian that is known."""
        if not self.order:
            return -gradient
        order, scattered = np.array(self.order), np.empty(len(self.order))
        S, Y = self._dx[: len(order)], self._dgradient[: len(order)]
        R = self._products[order][:, order]
        first = dtrtrs(R, (S @ gradient)[order])[0]
        scattered[order] = first
        direction = scattered @ Y - gradient
        dx, dgradient = S[order[-1]], Y[order[-1]]
        rest = dgradient - diagonal * dx
        curvature = rest @ dx
        direction /= diagonal + (rest @ rest / curvature if curvature > 0 else dgradient @ dgradient / R[-1, -1])
        scattered[order] = dtrtrs(R, R.diagonal() * first + (Y @ direction)[order], trans=1)[0]
        return direction - scattered @ S


def lbfgs(function: Function, point: Point) -> Iterator[tuple[Point, bool]]:
    """L-BFGS with backtracking (Nocedal & Wright, algorithms 7.4 and 3.1).

    Three properties that library versions lack: the limit of a step keeps trials off the wall of a barrier, the known
    diagonal of the Hessian takes the curvature of the wall out of the pairs, and where a decrease of the value is below
    rounding, a step is judged by the gradient at its end.
    """
    n, fresh = len(point.x), True  # whether the pairs were discarded since the last step
    pairs, lowest, least, idle = Pairs(MEMORY, n), point.value, point.residual, 0
    while True:
        direction = pairs.direction(point.gradient, function.preconditioner(point))
        slope = float(point.gradient @ direction)
        length = min(1.0 if pairs.order else np.inf, LONGEST / float(np.abs(direction).max()))
        # Rounding of the pairs may turn the direction uphill.
        trial = _backtrack(function, point, direction, slope, length) if slope < 0 else None
        if trial is None:
            yield point, not fresh
            pairs, fresh = Pairs(MEMORY, n), True
            continue
        dx, dgradient = trial.x - point.x, trial.gradient - point.gradient
        if dx @ dgradient > 1e-12 * np.sqrt((dx @ dx) * (dgradient @ dgradient)):
            pairs.append(dx, dgradient)
        lower = trial.value < lowest - ROUNDING * abs(lowest)
        idle = 0 if lower or trial.residual < least else idle + 1
        point, fresh, lowest, least = trial, False, min(lowest, trial.value), min(least, trial.residual)
        yield point, idle <= IDLE


def _backtrack(function: Function, point: Point, direction: Array, slope: float, length: float) -> Point | None:
    """The first of 30 shorter and shorter steps that decreases the value enough, or None."""
    for _ in range(30):
        trial = function.at(point.x + length * direction)
        if trial.value <= point.value + ARMIJO * length * slope:
            return trial
        # Within rounding of the value, a smaller directional derivative is equivalent (Hager and Zhang, 2005).
        if trial.value <= point.value + ROUNDING * abs(point.value) and trial.gradient @ direction <= -0.8 * slope:
            return trial
        length *= 0.3
    return None


def newton(function: Function, point: Point) -> Iterator[tuple[Point, bool]]:
    """Newton's method with truncated conjugate gradients in a trust region (Steihaug), for any inertia of the Hessian.

    A step is accepted when the value decreases as the model predicts, or, where the decrease is below rounding, when
    the residual does.
    """
    radius, progress = 1.0 + 0.1 * float(np.linalg.norm(point.x)), True
    while True:
        # The wall of a barrier may overflow; an infinite step is then refused.
        with np.errstate(over="ignore", invalid="ignore"):
            direction, predicted, inside = _steihaug(function, point, radius)
        trial = function.at(point.x + direction)
        decrease = point.value - trial.value
        rounding = 10 * ROUNDING * abs(point.value) + 1e-300
        below_rounding = predicted < rounding and abs(decrease) < 10 * rounding
        enough = trial.residual < 0.9 * point.residual if below_rounding else decrease > ARMIJO * predicted
        if np.isfinite(trial.value) and enough:
            point = trial
            if not inside and (below_rounding or decrease > 0.75 * predicted):
                radius = 2.0 * radius
        else:
            # In flat directions rounding makes steps of any length; short ones still converge in the others.
            radius = (0.1 if below_rounding else 0.25) * float(np.linalg.norm(direction))
            progress = not radius < 1e-14 * (1.0 + float(np.linalg.norm(point.x)))
        yield point, progress


def _steihaug(function: Function, point: Point, radius: float) -> tuple[Array, float, bool]:
    """Step of the quadratic model in a trust region, its predicted decrease, and whether it stays inside."""
    residual = -point.gradient
    size = float(np.linalg.norm(residual))
    # Few iterations far from the minimum, many near it, so that the convergence is superlinear.
    small_enough = size * min(0.1, np.sqrt(size))
    step, product = np.zeros_like(residual), np.zeros_like(residual)
    direction, square, steepest = residual, residual @ residual, 0.0
    for inner in range(1, PRODUCTS + 1):
        curved = function.hessian_product(point, direction)
        curvature = direction @ curved
        steepest = max(steepest, float(abs(curvature) / (direction @ direction)))
        if inner > 1 and abs(curvature) < FLAT * steepest * (direction @ direction):
            break
        length = square / curvature if curvature > 0 else np.inf
        longer = step + min(length, 1e300) * direction if curvature > 0 else step
        if curvature <= 0 or np.linalg.norm(longer) >= radius:
            # The positive length at which the step reaches the radius.
            a, b, c = direction @ direction, step @ direction, step @ step - radius**2
            length = float((-b + np.sqrt(b * b - a * c)) / a)
            step, product = step + length * direction, product + length * curved
            return step, -float(point.gradient @ step + 0.5 * step @ product), False
        step, product = longer, product + length * curved
        residual = residual - length * curved
        new_square = residual @ residual
        if np.sqrt(new_square) < small_enough:
            break
        direction, square = residual + (new_square / square) * direction, new_square
    return step, -float(point.gradient @ step + 0.5 * step @ product), True


METHODS: dict[str, Callable[..., Iterator[tuple[Point, bool]]]] = {"fire": fire, "lbfgs": lbfgs, "newton": newton}
