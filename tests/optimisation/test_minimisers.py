"""Minimisers: a table of methods × functions of vectors with known minima, and the statuses of the driver."""

from functools import partial

import numpy as np
import pytest
from problems import Analytic, quadratic

from critflow import Status
from critflow.minimisers import METHODS, Pairs, _steihaug, fire, minimise, newton


def rosenbrock():
    """100 (y − x²)² + (1 − x)², least at (1, 1): a curved valley."""

    def gradient(x):
        u = x[1] - x[0] ** 2
        return np.array([-400 * x[0] * u - 2 * (1 - x[0]), 200 * u])

    def hessian(x):
        return np.array([[1200 * x[0] ** 2 - 400 * x[1] + 2, -400 * x[0]], [-400 * x[0], 200]])

    def value(x):
        return 100 * (x[1] - x[0] ** 2) ** 2 + (1 - x[0]) ** 2

    return Analytic(value, gradient, hessian), np.array([-1.2, 1.0]), np.ones(2)


def double_well():
    """Σ (x² − 1)²/4 from near its maximum, where the Hessian is negative: least at ±1."""
    return (
        Analytic(
            lambda x: np.sum((x**2 - 1) ** 2) / 4, lambda x: x**3 - x, lambda x: np.diag(3 * x**2 - 1)
        ),
        np.array([0.1, -0.2, 0.05]),
        np.array([1.0, -1.0, 1.0]),
    )  # fmt: skip


def barrier():
    """Σ x − log x, infinite for x ≤ 0, least at 1, from far away."""

    def value(x):
        return np.sum(x - np.log(x)) if (x > 0).all() else np.inf

    return (Analytic(value, lambda x: 1 - 1 / x, lambda x: np.diag(1 / x**2)), np.array([0.05, 3.0, 0.5]), np.ones(3))


PROBLEMS = {"quadratic": quadratic, "Rosenbrock": rosenbrock, "double well": double_well, "barrier": barrier}
# A stable time step of FIRE is below 2/√(largest curvature).
BY_NAME = {**METHODS, "fire": partial(fire, time_step=0.01, max_move=0.1)}


@pytest.mark.parametrize("problem", PROBLEMS)
@pytest.mark.parametrize("method", METHODS)
def test_minima_with_known_answers(method, problem):
    function, start, minimum = PROBLEMS[problem]()
    end, status, _ = minimise(function, BY_NAME[method], start, tolerance=1e-10, max_steps=100_000)
    assert status is Status.ok
    assert end.residual < 1e-10
    # A gradient of 1e-10 over the smallest curvature: 0.4 in the valley of Rosenbrock's function, 1 elsewhere.
    np.testing.assert_allclose(end.x, minimum, rtol=0, atol=1e-9)


@pytest.mark.parametrize("method", METHODS)
def test_the_driver_owns_limit_and_tolerance(method):
    (parabola, start, minimum), (walled, inside, _) = quadratic(), barrier()
    for function, begin, tolerance, most, status, steps in (
        (parabola, start, 0.0, 3, Status.step_limit, 3),
        (parabola, minimum, 1e-10, 3, Status.ok, 0),
        (parabola, start, 1e-10, 0, Status.step_limit, 0),
        (walled, -inside, 1e-10, 5, Status.singular, 0),
    ):
        end = minimise(function, BY_NAME[method], begin, tolerance=tolerance, max_steps=most)
        assert end[1:] == (status, steps)


@pytest.mark.parametrize("method", METHODS)
def test_the_monitor_sees_every_point_and_may_end_the_descent(method):
    function, start, _ = quadratic()
    seen = []

    def monitor(point):
        seen.append(point)
        return Status.slack_edges if len(seen) == 4 else None

    end = minimise(function, BY_NAME[method], start, tolerance=1e-12, max_steps=50, monitor=monitor)
    assert end[1:] == (Status.slack_edges, 3)
    np.testing.assert_array_equal(seen[0].x, start)
    assert end[0] is seen[-1]


@pytest.mark.parametrize("method", ["lbfgs", "newton"])
def test_a_wrong_gradient_stalls(method):
    # The value increases by one in every direction, in spite of the reported gradient.
    function = Analytic(lambda x: np.any(x != 0), np.ones_like, lambda x: np.eye(len(x)))
    end, status, _ = minimise(function, BY_NAME[method], np.zeros(2), tolerance=1e-10, max_steps=200)
    assert status is Status.stalled
    np.testing.assert_array_equal(end.x, 0.0)


def test_newton_converges_superlinearly():
    function, start, minimum = rosenbrock()
    ends = [minimise(function, newton, start, 1e-300, steps)[0].x for steps in range(10, 40)]
    errors = np.array([np.linalg.norm(x - minimum) for x in ends])
    small = np.flatnonzero((errors[:-2] < 1e-2) & (errors[:-2] > 1e-7))
    assert len(small) >= 2
    # Conjugate gradients may take one product in each step, so two steps are one of Newton's method for two unknowns.
    assert (errors[small + 2] < 10 * errors[small] ** 2).all()


@pytest.mark.parametrize("radius", [0.1, 2.2, 2.35])
@pytest.mark.parametrize("lowest", [1.0, -0.5])
def test_a_step_of_newton_ends_at_the_radius_of_its_trust_region(lowest, radius):
    """Also after several inner steps; the value decreases as predicted."""
    H, x = np.diag([*np.linspace(1, 100, 7), lowest]), np.ones(8)
    function = Analytic(lambda x: 0.5 * x @ H @ x, lambda x: H @ x, lambda x: H)
    step, predicted, inside = _steihaug(function, function.at(x), radius)
    assert np.linalg.norm(step) == pytest.approx(radius, rel=1e-12) and not inside
    assert predicted == pytest.approx(function.at(x).value - function.at(x + step).value, rel=1e-10)


def test_a_step_that_raises_the_value_is_refused_where_the_model_predicts_rounding():
    # A flat start, from which the model leads to a plateau that is higher by one: a gain of 5e-10 was predicted.
    function = Analytic(
        lambda x: 1e6 + (x[0] > 0.5), lambda x: np.array([-1e-9 * (x[0] < 0.5)]), lambda x: np.array([[1e-9]])
    )
    start = function.at(np.zeros(1))
    point, _ = next(newton(function, start))
    assert point.value == start.value


@pytest.mark.parametrize("n_pairs", [0, 1, 4, 5, 6, 13])
def test_the_direction_of_l_bfgs_is_that_of_the_updates_of_bfgs(n_pairs):
    """The dense inverse Hessian, updated by the last pairs in turn, from the known diagonal and one curvature."""
    rng, n, memory = np.random.default_rng(n_pairs), 7, 5
    hessian = np.diag(rng.uniform(1, 3, n)) + np.ones((n, n))
    diagonal, gradient, pairs = rng.uniform(0, 0.5, n), rng.standard_normal(n), Pairs(memory, n)
    changes = [(dx, hessian @ dx) for dx in rng.standard_normal((n_pairs, n))]
    for pair in changes:
        pairs.append(*pair)
    inverse = np.eye(n)
    if changes:
        dx, rest = changes[-1][0], changes[-1][1] - diagonal * changes[-1][0]
        inverse = np.diag(1 / (diagonal + rest @ rest / (rest @ dx)))
    for dx, dgradient in changes[-memory:]:
        projector = np.eye(n) - np.outer(dx, dgradient) / (dx @ dgradient)
        inverse = projector @ inverse @ projector.T + np.outer(dx, dx) / (dx @ dgradient)
    np.testing.assert_allclose(pairs.direction(gradient, diagonal), -inverse @ gradient, rtol=1e-10, atol=1e-12)
    if not changes:
        np.testing.assert_array_equal(pairs.direction(gradient, diagonal), -gradient)


def test_an_uphill_direction_discards_the_pairs(monkeypatch):
    direction = Pairs.direction
    monkeypatch.setattr(Pairs, "direction", lambda *call: direction(*call) * (-1.0 if len(call[0].order) == 3 else 1.0))
    function, start, minimum = rosenbrock()
    end, status, _ = minimise(function, METHODS["lbfgs"], start, tolerance=1e-10, max_steps=1000)
    assert status is Status.ok
    np.testing.assert_allclose(end.x, minimum, rtol=1e-9)
