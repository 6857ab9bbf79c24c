"""Saddle points: found by products with the Hessian, and left."""

import numpy as np
import pytest
from problems import Analytic, quadratic

from critflow import Status
from critflow.descent import minimise_past_saddles, negative_curvature_direction, step_off_saddle
from critflow.minimisers import LBFGS, Newton, minimise


def saddle(negative, n=12):
    """x⁴/4 − `negative` x²/2 in one hidden direction v, ½ x² to 50 x² in the others: a saddle at zero."""
    rng = np.random.default_rng(2)
    Q = np.linalg.qr(rng.standard_normal((n, n)))[0]
    v, curvatures = Q[:, 0], np.geomspace(1, 100, n)
    curvatures[0] = -negative
    A = Q @ np.diag(curvatures) @ Q.T
    A = 0.5 * (A + A.T)
    function = Analytic(
        lambda x: 0.5 * x @ A @ x + (v @ x) ** 4 / 4,
        lambda x: A @ x + (v @ x) ** 3 * v,
        lambda x: A + 3 * (v @ x) ** 2 * np.outer(v, v),
    )
    return function, v


@pytest.mark.parametrize("negative", [1.0, 0.1])
def test_a_direction_of_negative_curvature(negative):
    function, _ = saddle(negative)
    point = function.at(np.zeros(12))
    direction = negative_curvature_direction(function, point)
    curvature = direction @ function.hessian_product(point, direction) / (direction @ direction)
    # Twelve products resolve the whole spectrum.
    assert curvature == pytest.approx(-negative, rel=1e-6)
    lower = step_off_saddle(function, point, direction)
    assert lower.value < point.value


def test_minima_and_flat_directions_have_none():
    function, _, minimum = quadratic()
    assert negative_curvature_direction(function, function.at(minimum)) is None
    # Twenty products decide, however many unknowns there are.
    large, (_, _, centre), taken = quadratic(60)[0], quadratic(60), []
    product = large.hessian_product
    large.hessian_product = lambda point, direction: taken.append(point) or product(point, direction)
    assert negative_curvature_direction(large, large.at(centre)) is None and len(taken) == 20
    flat, _ = saddle(0.0)
    assert negative_curvature_direction(flat, flat.at(np.zeros(12))) is None


def test_the_known_diagonal_does_not_hide_a_direction():
    # A diagonal of 1e8 on all but one coordinate: twenty products of H alone see nothing else.
    n = 40
    diagonal = np.full(n, 1e8)
    diagonal[7] = 0.0
    H = np.diag(diagonal + np.where(np.arange(n) == 7, -1.0, 1.0))
    function = Analytic(lambda x: 0.5 * x @ H @ x, lambda x: H @ x, lambda x: H, diagonal)
    direction = negative_curvature_direction(function, function.at(np.zeros(n)))
    assert direction is not None
    assert direction @ H @ direction < 0


def descent(function):
    return lambda x, limit: minimise(function, LBFGS(), x, 1e-10, 500 if limit is None else limit)


def test_a_descent_continues_past_a_saddle():
    function, v = saddle(1.0)
    end, saddles = minimise_past_saddles(function, descent(function), np.zeros(12), None, lambda end: True)
    assert (end.status, saddles) == (Status.ok, 1)
    # The minima are at ±√1 v, of value −1/4.
    np.testing.assert_allclose(np.abs(end.point.x @ v), 1.0, rtol=1e-9)
    assert end.point.value == pytest.approx(-0.25, rel=1e-12)


def test_rough_ends_are_not_tested():
    function, _ = saddle(1.0)
    end, saddles = minimise_past_saddles(function, descent(function), np.zeros(12), None, lambda end: False)
    assert (end.status, saddles) == (Status.ok, None)
    np.testing.assert_array_equal(end.point.x, 0.0)


@pytest.mark.parametrize("limit", [8, 10])
def test_the_descent_to_a_saddle_counts_in_the_limit(limit):
    function, v = saddle(1.0)
    # Without a component in the hidden direction the first descent ends at the saddle, after several steps.
    start = np.ones(12) - v * np.sum(v)
    granted = []

    def descend(x, steps):
        granted.append(steps)
        return minimise(function, Newton(), x, 1e-10, steps)

    minimise_past_saddles(function, descend, start, limit, lambda end: True)
    assert len(granted) == 2 and granted[1] < limit
