"""Nearest points with targets and linear limits: closed forms, infeasible targets, the step limit."""

import numpy as np
import pytest
import scipy.sparse as sp

from critflow.result import Status
from critflow.solvers.sequential import Limits, nearest_point

N = 6
ORIGIN = np.array([0.9, 0.2, -0.1, 0.3, 0.05, 0.1])
FREE = sp.csr_array(np.eye(N)), np.full(N, -10.0)


def solved(targets, low, high, linear=FREE, max_steps=100, start=ORIGIN):
    limits = Limits(np.atleast_1d(low), np.atleast_1d(high), *linear)
    return nearest_point(targets, limits, lambda x: (x - ORIGIN, sp.eye_array(N, format="csr")), start, max_steps)


def square(x):
    """Half the squared distance from zero: spheres."""
    return np.array([0.5 * x @ x]), x[None].copy()


def test_the_nearest_point_of_a_sphere():
    found = solved(square, 2.0, 2.0)
    assert found.status is Status.ok
    direction = ORIGIN / np.linalg.norm(ORIGIN)
    np.testing.assert_allclose(found.x, 2 * direction, atol=0.01)
    assert found.values[0] == pytest.approx(2, rel=1e-11)
    # The distance 2 - |x_0| has the derivative (2 - |x_0|)/2 by half the square of the radius.
    assert found.multipliers[0] == pytest.approx((2 - np.linalg.norm(ORIGIN)) / 2, rel=0.02)


def test_targets_inside_their_interval_move_nothing():
    found = solved(square, 0.0, 2.0)
    assert found.status is Status.ok and found.steps <= 1
    np.testing.assert_allclose(found.x, ORIGIN, atol=1e-8)
    assert abs(found.multipliers[0]) < 1e-7


def test_linear_limits_hold_and_are_tight():
    linear = sp.csr_array(-np.eye(N)[:1]), np.array([-1.0])
    found = solved(square, 2.0, 2.0, linear)
    assert found.status is Status.ok
    assert found.x[0] == pytest.approx(1, abs=1e-7)
    # The rest has half a squared length of 3/2 and the direction of the start.
    rest = ORIGIN[1:] / np.linalg.norm(ORIGIN[1:])
    nearest = np.linalg.norm(np.concatenate([[1.0], np.sqrt(3) * rest]) - ORIGIN)
    assert nearest * (1 - 1e-9) < np.linalg.norm(found.x - ORIGIN) < 1.01 * nearest


def test_a_target_out_of_reach_ends_with_the_best_compromise():
    linear = sp.csr_array(np.vstack([np.eye(N), -np.eye(N)])), np.full(2 * N, -1.0)
    found = solved(square, 9.0, 9.0, linear)
    assert found.status is Status.infeasible
    assert found.values[0] == pytest.approx(N / 2, rel=1e-3)


def test_few_steps_are_reported():
    def steep(x):
        value, gradient = square(x)
        return np.exp(3 * value), 3 * np.exp(3 * value)[:, None] * gradient

    assert solved(steep, 1e4, 1e4, max_steps=2).status is Status.step_limit
    found = solved(steep, 1e2, 1e2)
    assert found.status is Status.ok and found.values[0] == pytest.approx(100, rel=1e-12)
