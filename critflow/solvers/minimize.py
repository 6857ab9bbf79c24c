"""Minimisers of a smooth function of a vector: FIRE, L-BFGS and Newton with conjugate gradients.

A method sees a `Function` and knows no networks.  Progress is judged by the residual that the function defines (its
gradient in the units of the problem), never by a relative change of the value: near the transition a small change of
energy is not a small error.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from critflow.networks.network import Array
from critflow.result import Status


@dataclass(frozen=True, eq=False)
class Point:
    """A place x with the value, the gradient and the residual (a norm of the gradient) of the function there."""

    x: Array
    value: float
    gradient: Array
    residual: float


class Function(Protocol):
    """What the methods minimise.  `curvature` and `verdict` may assume that their point was evaluated last."""

    def at(self, x: Array) -> Point: ...

    def stiff_diagonal(self, point: Point) -> Array | float:
        """A diagonal part of the Hessian that is known, ≥ 0; zero where nothing is."""

    def verdict(self, point: Point) -> Status | None:
        """A status that ends the minimisation where going on is pointless, else None."""

    def curvature(self, point: Point, direction: Array) -> Array:
        """The Hessian times a direction."""


@dataclass(frozen=True, eq=False)
class Minimum:
    """Where a minimiser ended, and why."""

    point: Point
    status: Status
    iterations: int
    evaluations: int


def fire(function: Function, x: Array, tolerance: float, max_steps: int, time_step: float, max_move: float) -> Minimum:
    """FIRE 2.0, the method of the paper: damped dynamics that stop whenever they run uphill (Guénolé et al., 2020).

    Semi-implicit Euler with unit masses; after 20 downhill steps the time step grows, after an uphill step it shrinks
    and half a step is taken back.  No component moves by more than `max_move` a step, none to an infinite value.
    """
    start_mixing, longest = 0.25, 10 * time_step
    velocity, mixing, downhill = np.zeros_like(x), start_mixing, 0
    point = function.at(x)
    for step in range(max_steps):
        if point.residual < tolerance:
            return Minimum(point, Status.ok, step, step + 1)
        verdict = function.verdict(point)
        if verdict is not None:
            return Minimum(point, verdict, step, step + 1)
        force = -point.gradient
        if force @ velocity > 0:
            downhill += 1
            if downhill > 20:
                time_step, mixing = min(1.1 * time_step, longest), 0.99 * mixing
        else:
            x = point.x - 0.5 * time_step * velocity
            velocity = np.zeros_like(velocity)
            time_step, mixing, downhill = max(0.5 * time_step, 2e-3 * longest), start_mixing, 0
            point = Point(x, point.value, point.gradient, point.residual)
        velocity = velocity + time_step * force
        speed, strength = np.linalg.norm(velocity), np.linalg.norm(force)
        if strength > 0:
            velocity = (1 - mixing) * velocity + (mixing * speed / strength) * force
        move = time_step * float(np.abs(velocity).max())
        if move > max_move:
            velocity = velocity * (max_move / move)
        trial = function.at(point.x + time_step * velocity)
        if trial.value == np.inf:
            # A wall is in the way: stop before it and go on more slowly.
            velocity, time_step = np.zeros_like(velocity), 0.5 * time_step
        else:
            point = trial
    status = Status.ok if point.residual < tolerance else Status.step_limit
    return Minimum(point, status, max_steps, max_steps + 1)


def lbfgs(
    function: Function, x: Array, tolerance: float, max_steps: int, memory: int = 15, longest: float = 0.7
) -> Minimum:
    """L-BFGS with backtracking (Nocedal & Wright, algorithms 7.4 and 3.1); no component moves by more than `longest`.

    Three things that library versions lack matter here: the limit keeps trials away from the wall of a barrier, the
    known diagonal of the Hessian takes the wall's curvature out of what has to be learned, and where a fall of the
    value is lost in rounding, a step is judged by the slope at its end instead.
    """
    point = function.at(x)
    pairs: deque[tuple[Array, Array, float]] = deque(maxlen=memory)
    evaluations, fresh = 1, True
    for step in range(max_steps):
        if point.residual < tolerance:
            return Minimum(point, Status.ok, step, evaluations)
        verdict = function.verdict(point)
        if verdict is not None:
            return Minimum(point, verdict, step, evaluations)
        direction = _two_loops(point.gradient, pairs, function.stiff_diagonal(point))
        slope = point.gradient @ direction
        if not slope < 0:
            pairs.clear()
            direction, slope = -point.gradient, -(point.gradient @ point.gradient)
        length = min(1.0 if pairs else np.inf, longest / float(np.abs(direction).max()))
        for _ in range(30):
            trial = function.at(point.x + length * direction)
            evaluations += 1
            if trial.value <= point.value + 1e-4 * length * slope:
                break
            # Within rounding of the value, a slope that has fallen says the same (Hager and Zhang, 2005).
            if trial.value <= point.value + _ROUNDING * abs(point.value) and trial.gradient @ direction <= -0.8 * slope:
                break
            length *= 0.3
        else:
            if fresh:
                return Minimum(point, Status.stalled, step, evaluations)
            pairs.clear()
            fresh = True
            continue
        moved, turned = trial.x - point.x, trial.gradient - point.gradient
        product = float(moved @ turned)
        if product > 1e-12 * np.sqrt((moved @ moved) * (turned @ turned)):
            pairs.append((moved, turned, product))
        point, fresh = trial, False
    return Minimum(point, Status.ok if point.residual < tolerance else Status.step_limit, max_steps, evaluations)


# Curvatures this much below the steepest are rounding: such directions are flat.
_FLAT = 1e-11
# Relative changes of the value below this are rounding.
_ROUNDING = 1e-14


def _two_loops(gradient: Array, pairs: deque[tuple[Array, Array, float]], diagonal: Array | float) -> Array:
    """−H⁻¹ gradient with the inverse Hessian that the stored pairs (moved, turned) and the diagonal imply."""
    direction = -gradient
    weights = []
    for moved, turned, product in reversed(pairs):
        weights.append(moved @ direction / product)
        direction -= weights[-1] * turned
    if pairs:
        moved, turned, product = pairs[-1]
        rest = turned - diagonal * moved
        along = rest @ moved
        direction /= diagonal + (rest @ rest / along if along > 0 else turned @ turned / product)
    for (moved, turned, product), weight in zip(pairs, reversed(weights), strict=True):
        direction += (weight - turned @ direction / product) * moved
    return direction


def newton(function: Function, x: Array, tolerance: float, max_steps: int, max_inner: int = 400) -> Minimum:
    """Newton's method with truncated conjugate gradients on the exact Hessian, safe where it is indefinite.

    Inside a trust region (Steihaug).  A step is kept when the value falls as the model says, or, once the fall is
    lost in rounding, when the gradient shrinks.
    """
    point = function.at(x)
    radius, evaluations = 1.0 + 0.1 * float(np.linalg.norm(x)), 1
    for step in range(max_steps):
        if point.residual < tolerance:
            return Minimum(point, Status.ok, step, evaluations)
        verdict = function.verdict(point)
        if verdict is not None:
            return Minimum(point, verdict, step, evaluations)
        direction, predicted, inner, inside = _steihaug(function, point, radius, max_inner)
        trial = function.at(point.x + direction)
        evaluations += inner + 1
        fall = point.value - trial.value
        rounding = 10 * _ROUNDING * abs(point.value) + 1e-300
        lost = predicted < rounding and abs(fall) < 10 * rounding
        good = np.isfinite(trial.value) and (trial.residual < 0.9 * point.residual if lost else fall > 1e-4 * predicted)
        if good:
            if not inside and (lost or fall > 0.75 * predicted):
                radius *= 2.0
            point = trial
        else:
            # Along flat directions rounding makes steps of any length; short ones still reach what is not flat.
            radius = (0.1 if lost else 0.25) * float(np.linalg.norm(direction))
            point = function.at(point.x)  # the curvature belongs to the point evaluated last
            evaluations += 1
            if radius < 1e-14 * (1.0 + float(np.linalg.norm(point.x))):
                return Minimum(point, Status.stalled, step, evaluations)
    return Minimum(point, Status.ok if point.residual < tolerance else Status.step_limit, max_steps, evaluations)


def _steihaug(function: Function, point: Point, radius: float, max_inner: int) -> tuple[Array, float, int, bool]:
    """Step, predicted fall, products used and whether it stays inside, of the quadratic model in a trust region."""
    residual = -point.gradient
    size = float(np.linalg.norm(residual))
    # Few iterations far away, many near the minimum, so that the convergence is superlinear.
    goal = size * min(0.1, np.sqrt(size))
    step, product = np.zeros_like(residual), np.zeros_like(residual)
    direction, square, steepest = residual, residual @ residual, 0.0
    for inner in range(1, max_inner + 1):
        curved = function.curvature(point, direction)
        curvature = direction @ curved
        steepest = max(steepest, float(abs(curvature) / (direction @ direction)))
        if inner > 1 and abs(curvature) < _FLAT * steepest * (direction @ direction):
            break
        length = square / curvature if curvature > 0 else np.inf
        longer = step + min(length, 1e300) * direction if curvature > 0 else step
        if curvature <= 0 or np.linalg.norm(longer) >= radius:
            length = _to_boundary(step, direction, radius)
            step, product = step + length * direction, product + length * curved
            return step, -float(point.gradient @ step + 0.5 * step @ product), inner, False
        step, product = longer, product + length * curved
        residual = residual - length * curved
        new_square = residual @ residual
        if np.sqrt(new_square) < goal:
            break
        direction, square = residual + (new_square / square) * direction, new_square
    return step, -float(point.gradient @ step + 0.5 * step @ product), inner, True


def _to_boundary(step: Array, direction: Array, radius: float) -> float:
    """The positive length t at which |step + t·direction| reaches the radius."""
    a, b, c = direction @ direction, step @ direction, step @ step - radius**2
    return float((-b + np.sqrt(b * b - a * c)) / a)
