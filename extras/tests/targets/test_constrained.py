"""Constrained minima: closed forms, dependent limits, infeasible targets, the step limit."""

from dataclasses import dataclass

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from critflow.result import Status
from critflow_extras.targets.constrained import Point, _Metric, _Search, minimise_constrained

N = 6
ORIGIN = np.array([0.9, 0.2, -0.1, 0.3, 0.05, 0.1])


class Sphere:
    """The point nearest to the origin of the search with ½|z|² and linear functions A z inside limits."""

    def __init__(self, low, high, A=None, below=(), steep=0.0):
        self.A, self.steep = np.zeros((0, N)) if A is None else A, steep
        self.low = np.append(low, np.full(len(self.A), -np.inf))
        self.high = np.append(high, below)

    def at(self, z):
        value = 0.5 * z @ z
        if self.steep:
            value = np.exp(self.steep * value)
        rows = np.vstack([z * (self.steep * value or 1.0), self.A])
        change = z - ORIGIN
        return Point(z, 0.5 * change @ change, change, np.append(value, self.A @ z), lambda indices: rows[indices])


def solved(problem, max_steps=200, first=None):
    return minimise_constrained(problem, ORIGIN, 1e-6, 0.5, max_steps, first)


@pytest.mark.parametrize("first", [None, lambda z: lambda rows: rows / (1.0 + np.arange(N))], ids=["unit", "metric"])
def test_the_nearest_point_of_a_sphere(first):
    found = solved(Sphere(2.0, 2.0), first=first)
    assert found.status is Status.ok
    length = np.linalg.norm(ORIGIN)
    np.testing.assert_allclose(found.point.z, 2 * ORIGIN / length, rtol=0, atol=1e-6)
    # The distance 2 - |x_0| has the derivative (2 - |x_0|)/2 by half the square of the radius.
    assert -found.multipliers[0] == pytest.approx((2 - length) / 2, rel=1e-5)


def test_targets_inside_their_interval_move_nothing():
    found = solved(Sphere(0.0, 2.0))
    assert found.status is Status.ok and found.steps == 0 and not found.multipliers.any()


class Coarse:
    """The point nearest to zero with z_0 = 0.9, whose digits at small z_1 are fewer than those of a constraint."""

    low = high = np.array([0.9])

    def at(self, z):
        c = np.round(z[:1], 9) + 5e-10 * (z[1] < 0.1)
        return Point(z, 0.5 * z @ z, z, c, lambda indices: np.eye(N)[:1][indices])


def test_a_start_to_which_a_search_returns_is_no_minimum():
    found = solved(Coarse())
    assert found.status is Status.stalled and found.reached and found.residual > 0.1
    np.testing.assert_array_equal(found.point.z, ORIGIN)


def test_dependent_limits_hold_and_are_tight():
    # Three limits with two gradients, one of them twice.
    A = np.vstack([np.eye(N)[:1], np.eye(N)[:1], np.eye(N)[1:2]])
    found = solved(Sphere(2.0, 2.0, A, [1.0, 1.0, 3.0]))
    assert found.status is Status.ok and found.point.z[0] == pytest.approx(1, abs=1e-5)
    rest = ORIGIN[1:] / np.linalg.norm(ORIGIN[1:])
    np.testing.assert_allclose(found.point.z[1:], np.sqrt(3) * rest, rtol=0, atol=1e-4)


def test_a_target_out_of_reach_ends_with_the_best_compromise():
    found = solved(Sphere(9.0, 9.0, np.vstack([np.eye(N), -np.eye(N)]), np.ones(2 * N)))
    assert found.status is Status.not_reached
    # The least sum of squares of the violations is at equal components.
    side = minimize_scalar(lambda s: (9 - N / 2 * s**2) ** 2 + N * (s - 1) ** 2, bracket=(1, 2), tol=1e-10).x
    assert found.point.constraints[0] == pytest.approx(N / 2 * side**2, rel=1e-3)


def test_few_steps_are_reported():
    assert solved(Sphere(1e4, 1e4, steep=3.0), max_steps=2).status is Status.step_limit
    found = solved(Sphere(1e2, 1e2, steep=3.0))
    assert found.status is Status.ok and found.point.constraints[0] == pytest.approx(100, rel=1e-12)


class Line:
    """A function of one unknown with a constraint c = 0, by a table: z to value and violation; gradients at z = 0."""

    low = high = np.zeros(1)

    def __init__(self, table, gradient):
        self.table, self.gradient = table, gradient

    def at(self, z):
        value, violation = self.table[round(float(z[0]), 3)]
        return Point(z, value, np.array([self.gradient]), np.array([violation]), lambda indices: np.ones((1, 1)))


@dataclass
class Step:
    d: np.ndarray
    multipliers: np.ndarray


def first_accepted(table, gradient, multiplier, monkeypatch):
    """The first of the points 1 and 0.3 that a step from 0 accepts."""
    problem = Line(table, gradient)
    search = _Search(problem, longest=1.0)
    monkeypatch.setattr(search, "restored", lambda point, *_: point)
    step = Step(np.array([1.0]), np.array([multiplier]))
    return float(search.along(problem.at(np.zeros(1)), step, _Metric(None, 1, 1.0)).z[0])


STEPS = {
    # The value grows by half of what a decrease must be at least: too long.
    "a small increase": ({0: (0.0, 0.0), 1: (5e-5, 0.0), 0.3: (-0.2, 0.0)}, -1.0, 0.0, 0.3),
    # The rate is 0.2 − 1.2, so that a decrease of 1.2e-4 is enough; a rate of 1.4 would demand more.
    "the violation in the rate": ({0: (0.0, 1.0), 1: (1.2 - 1.2e-4, 0.0), 0.3: (-1.0, 0.0)}, 0.2, 1.0, 1.0),
    # A gain of the violation by 1 at a cost of 2 is none with a penalty of 1.2.
    "the size of the penalty": ({0: (0.0, 1.0), 1: (2.0, 0.0), 0.3: (-1.0, 0.0)}, 0.2, 1.0, 0.3),
}


@pytest.mark.parametrize("name", STEPS)
def test_a_step_is_accepted_by_value_and_penalty(name, monkeypatch):
    table, gradient, multiplier, accepted = STEPS[name]
    assert first_accepted(table, gradient, multiplier, monkeypatch) == pytest.approx(accepted)
