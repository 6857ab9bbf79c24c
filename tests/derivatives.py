"""Derivatives against central differences."""

import numpy as np


def assert_derivative(f, gradient, x, directions, step=1e-3, rtol=1e-7, atol=0.0):
    """`gradient` is the derivative of f at x along each of the directions.

    f           function of x, a number or an array, with values of any shape
    gradient    array of the shape of x, for a function with one value; else the derivative, a function of the direction
    directions  arrays of the shape of x
    step        of the differences D(h) = (f(x + hu) − f(x − hu))/2h, with h = step and step/2

    4/3 D(h/2) − D(h)/3, with an error of fourth order, agrees to atol + rtol max|derivative|.  So differences must
    converge: up to this tolerance a halved step divides the error of D by four.
    """
    x, directions = np.asarray(x, float), list(directions)
    assert directions, "no direction was given"
    for direction in directions:
        u = np.asarray(direction, float)
        assert u.shape == x.shape, f"a direction has the shape {u.shape}, x has {x.shape}"
        exact = np.asarray(gradient(u) if callable(gradient) else np.sum(np.reshape(gradient, x.shape) * u))
        coarse, fine = ((np.asarray(f(x + h * u)) - np.asarray(f(x - h * u))) / (2 * h) for h in (step, step / 2))
        assert exact.shape == fine.shape, f"the derivative has the shape {exact.shape}, differences have {fine.shape}"
        tolerance = atol + rtol * np.abs(exact).max()
        np.testing.assert_allclose((4 * fine - coarse) / 3, exact, rtol=0, atol=tolerance)


def first_derivative(f, step=1e-3):
    """f'(0) of a function of one number, by central differences of fourth order."""
    values = {n: f(n * step) for n in (-2, -1, 1, 2)}
    return (8 * (values[1] - values[-1]) - (values[2] - values[-2])) / (12 * step)


def second_derivative(f, step=1e-3):
    """f''(0) of a function of one number, by central differences of fourth order."""
    values = {n: f(n * step) for n in (-2, -1, 0, 1, 2)}
    return (16 * (values[1] + values[-1]) - (values[2] + values[-2]) - 30 * values[0]) / (12 * step**2)
