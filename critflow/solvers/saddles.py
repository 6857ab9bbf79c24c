"""Whether a descent has ended at a saddle, and the way down from it.

A gradient that vanishes does not tell a minimum from a saddle, and a start with a symmetry of the network leads a
descent to points that are least among the symmetric ones only.  Products with the Hessian do tell: Lanczos' method
finds the ends of a spectrum first.
"""

from __future__ import annotations

import numpy as np
import scipy.linalg

from critflow.linalg.vectors import quasi_random
from critflow.networks.network import Array
from critflow.solvers.minimize import Function, Point

# Products with the Hessian for one look; standard networks of 1,000 vertices need 60 evaluations or more to get there.
_PRODUCTS = 20
# Curvature this far below zero, against the steepest, is not rounding, nor are so many times the largest slope:
# where the slope does not quite vanish, directions that are flat seem curved by as much.
_CLEAR, _SLOPES = 1e-6, 10.0
# The largest component of a first step to the side, and how many times it is shortened to a third at most.
_ASIDE, _SHORTER = 0.3, 12


def downhill(function: Function, point: Point, products: int = _PRODUCTS) -> tuple[Array | None, int]:
    """A direction along which the function curves down from a stationary point, or None; and the products taken.

    By Lanczos' method with full orthogonalisation on S H S, whose curvatures have the signs of those of H.  S takes
    out the known diagonal, which would hide all others.  The first vector has no symmetry.
    """
    n = len(point.x)
    first = quasi_random(n) - 0.5
    diagonal, taken = function.stiff_diagonal(point), 0
    scale = np.ones(n)
    if np.any(diagonal):
        rest = function.curvature(point, first) - diagonal * first
        scale, taken = 1 / np.sqrt(1 + diagonal * np.linalg.norm(first) / np.linalg.norm(rest)), 1
    products = min(products, n)
    basis = np.empty((products + 1, n))
    basis[0] = first / np.linalg.norm(first)
    along, beside = np.zeros(products), np.zeros(products)
    for k in range(products):
        curved = scale * function.curvature(point, scale * basis[k])
        along[k] = curved @ basis[k]
        for _ in range(2):
            curved -= basis[: k + 1].T @ (basis[: k + 1] @ curved)
        beside[k] = np.linalg.norm(curved)
        if k + 1 == products or beside[k] < _CLEAR * np.abs(along).max():
            break
        basis[k + 1] = curved / beside[k]
    values, vectors = scipy.linalg.eigh_tridiagonal(along[: k + 1], beside[:k])
    direction = scale * (vectors[:, 0] @ basis[: k + 1])
    # The curvature of H itself along it, per unit length.
    curvature = values[0] / (direction @ direction)
    noise = max(_CLEAR * float(np.abs(values).max()), _SLOPES * float(np.abs(point.gradient).max()))
    return direction if curvature < -noise else None, taken + k + 1


def aside(function: Function, point: Point, direction: Array) -> tuple[Point | None, int]:
    """The lower of two points either way along a direction of negative curvature; and the evaluations taken.

    None where the value does not fall that way as far as rounding can tell.
    """
    step = _ASIDE / float(np.abs(direction).max()) * direction
    for tried in range(1, _SHORTER + 1):
        best = min((function.at(point.x + step), function.at(point.x - step)), key=lambda trial: trial.value)
        if best.value < point.value:
            return best, 2 * tried
        step = step / 3
    return None, 2 * _SHORTER
