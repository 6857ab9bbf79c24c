"""SciPy's minimisers of a function of critflow: value, gradient and products with the Hessian are its own."""

from collections.abc import Callable

import numpy as np
from scipy.optimize import minimize

from critflow import Status
from critflow.minimisers import Function, Point
from critflow.networks import Array

Gradient = Callable[[Array], tuple[float, Array]]
Solved = Callable[[float], tuple[Array, Status]]


def by_scipy(objective: Function, method: str, start: Array, max_steps: int) -> Solved:
    """Function from the largest component of the gradient at which a method is to stop, to x and the status."""
    latest = list[Point]()

    def function(x: Array) -> tuple[float, Array]:
        latest[:] = [objective.at(x.copy())]
        return latest[0].value, latest[0].gradient

    def curvature(x: Array, direction: Array) -> Array:
        if not np.array_equal(x, latest[0].x):
            function(x)
        return objective.hessian_product(latest[0], direction)

    return minimiser(function, start, method, max_steps, curvature if method == "trust-krylov" else None)


def minimiser(
    function: Gradient, start: Array, method: str, max_steps: int, curvature: Callable | None = None
) -> Solved:
    """As `by_scipy`, of a function that returns value and gradient; L-BFGS-B is not to stop by the value."""
    own = {"ftol": 0.0, "maxcor": 15, "maxfun": 2 * max_steps} if method == "L-BFGS-B" else {}

    def run(tolerance: float) -> tuple[Array, Status]:
        options = {"gtol": tolerance, "maxiter": max_steps, **own}
        with np.errstate(all="ignore"):
            end = minimize(function, start, jac=True, hessp=curvature, method=method, options=options)
        # Success of L-BFGS-B may mean that the value changes no more.
        if end.success and np.abs(end.jac).max() <= tolerance:
            return end.x, Status.ok
        return end.x, Status.step_limit if end.nit >= max_steps else Status.stalled

    return run
