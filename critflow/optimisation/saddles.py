"""Minimisation past saddle points.

A zero gradient does not distinguish a minimum from a saddle, and a start with a symmetry of the network leads a descent
to points that are minimal only among the symmetric ones.  Products with the Hessian distinguish them: Lanczos' method
finds the ends of a spectrum first.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import scipy.linalg

from critflow.linalg.vectors import quasi_random
from critflow.minimisers import Array, Function, Minimum, Point
from critflow.result import Status

# Negative curvature that is not rounding, relative to the steepest: well above FLAT, as the few Lanczos vectors do not
# resolve the end of the spectrum.
NEGATIVE = 1e-6
# The same in units of the largest component of the gradient: where the gradient does not quite vanish, flat directions
# have an apparent curvature of that size.
NEGATIVE_GRADIENTS = 10.0

# Hessian-vector products of one saddle test, fewer than the evaluations of a descent (60 at 1,000 vertices).
_PRODUCTS = 20
# Largest component of the first step off a saddle, and the number of times that it is divided by three.
_FIRST_STEP, _SHORTER = 0.3, 12
# Upper limit of saddles on one descent; not reached on any tested network.
_MAX_SADDLES = 20

Descent = Callable[[Array, int | None], Minimum]
"""A minimisation from x (n,) within a number of steps, or the default number for None."""


def minimise_past_saddles(
    function: Function, descend: Descent, x0: Array, max_steps: int | None, tested: Callable[[Minimum], bool]
) -> tuple[Minimum, int | None]:
    """A descent from x0 (n,), continued from every saddle at which it ends; and the number of saddles.

    tested  whether an end is to be tested, which costs as much as half of a descent; where it is not, the number of
            saddles is None if no other was met

    `Status.stalled` where no step off a saddle decreases the value.
    """
    end = descend(x0, max_steps)
    steps, saddles = end.steps, 0
    while end.status is Status.ok and tested(end):
        direction = negative_curvature_direction(function, end.point)
        if direction is None:
            return Minimum(end.point, end.status, steps), saddles
        saddles += 1
        lower = step_off_saddle(function, end.point, direction)
        left = None if max_steps is None else max_steps - steps
        if lower is None or left == 0 or saddles > _MAX_SADDLES:
            end = replace(end, status=Status.stalled if lower is None else Status.step_limit)
            break
        end = descend(lower.x, left)
        steps += end.steps
    return Minimum(end.point, end.status, steps), saddles or None


def negative_curvature_direction(function: Function, point: Point, products: int = _PRODUCTS) -> Array | None:
    """A direction (n,) of negative curvature at a stationary point, or None.

    By Lanczos' method with full orthogonalisation on S H S, whose curvatures have the signs of those of H.  S scales
    out the known diagonal, which would hide all other curvatures.  The first vector has no symmetry.
    """
    n = len(point.x)
    first = quasi_random(n) - 0.5
    diagonal = function.preconditioner(point)
    scale = np.ones(n)
    if np.any(diagonal):
        rest = function.hessian_product(point, first) - diagonal * first
        scale = 1 / np.sqrt(1 + diagonal * np.linalg.norm(first) / np.linalg.norm(rest))
    products = min(products, n)
    basis = np.empty((products + 1, n))
    basis[0] = first / np.linalg.norm(first)
    main, off = np.zeros(products), np.zeros(products)
    for k in range(products):
        curved = scale * function.hessian_product(point, scale * basis[k])
        main[k] = curved @ basis[k]
        for _ in range(2):
            curved -= basis[: k + 1].T @ (basis[: k + 1] @ curved)
        off[k] = np.linalg.norm(curved)
        if k + 1 == products or off[k] <= NEGATIVE * np.abs(main).max():
            break
        basis[k + 1] = curved / off[k]
    values, vectors = scipy.linalg.eigh_tridiagonal(main[: k + 1], off[:k])
    direction = scale * (vectors[:, 0] @ basis[: k + 1])
    # The curvature of H itself in this direction, per unit length.
    curvature = values[0] / (direction @ direction)
    noise = max(NEGATIVE * float(np.abs(values).max()), NEGATIVE_GRADIENTS * float(np.abs(point.gradient).max()))
    return direction if curvature < -noise else None


def step_off_saddle(function: Function, point: Point, direction: Array) -> Point | None:
    """The lower of two points at ± a step in a direction of negative curvature; None if neither decreases the value."""
    step = _FIRST_STEP / float(np.abs(direction).max()) * direction
    for _ in range(_SHORTER):
        best = min((function.at(point.x + step), function.at(point.x - step)), key=lambda trial: trial.value)
        if best.value < point.value:
            return best
        step = step / 3
    return None
