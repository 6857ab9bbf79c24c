"""What holds for every quantity: derivatives against differences, no dependence on the scale of σ, extreme values."""

import numpy as np
import pytest
from derivatives import assert_derivative
from problems import PERIODIC_KINDS, random_stress

from critflow import CriticalManifold
from critflow.quantities import evaluate, has_exact_hessian, takes_complex_steps

KINDS = {name: make() for name, make in PERIODIC_KINDS.items()}
MANIFOLDS = {name: CriticalManifold(network) for name, network in KINDS.items()}


def stress(network, sign=1.0):
    sigma = random_stress(network.n_edges, 5)
    sigma[::6] *= sign
    return sigma


def assert_gradients_and_hessian_products(manifold, goal, sign):
    sigma, rng = stress(manifold.network, sign), np.random.default_rng(6)
    directions = 0.1 * rng.standard_normal((2, len(sigma)))
    here = evaluate(manifold.balance(sigma), goal)
    scale = float(np.abs(here.gradient).max())
    size = 1e-8 * scale + 1e-12 * abs(here.value)
    assert_derivative(
        lambda s: evaluate(manifold.balance(s), goal).value, here.gradient, sigma, directions, 1e-3, 1e-7, size
    )
    if goal.analytic:
        assert takes_complex_steps(manifold, goal)
        gradient = lambda s: evaluate(manifold.balance(s), goal).gradient  # noqa: E731
        product = here.hessian_product(directions[0])
        np.testing.assert_allclose(1e-100 * here.hessian_product(1e100 * directions[0]), product, rtol=1e-9, atol=size)
        assert_derivative(gradient, here.hessian_product, sigma, directions, 1e-3, 1e-6, 1e-6 * scale)
    else:
        u, v = directions
        assert not has_exact_hessian(manifold, goal)
        Hu, Hv = here.hessian_difference(u), here.hessian_difference(v)
        assert u @ Hv == pytest.approx(v @ Hu, rel=1e-5, abs=1e-6 * np.linalg.norm(Hu) * np.linalg.norm(v))
    # No quantity depends on the scale of σ: H σ = −∇O.
    assert abs(here.gradient @ sigma) < 1e-11 * scale * len(sigma)
    assert evaluate(manifold.balance(7 * sigma), goal).value == pytest.approx(here.value, rel=1e-10, abs=1e-13)


def assert_no_stress_exceeds_the_extreme_values(manifold, goals):
    n_edges = manifold.network.n_edges
    for positive in (True, False):
        limits = [goal.extreme(manifold, positive) for goal in goals]
        for seed in range(20):
            sigma = random_stress(n_edges, seed)
            sigma[:: 2 + seed % 5] *= 1.0 if positive else -0.3
            balance = manifold.balance(sigma)
            for goal, (least, most) in zip(goals, limits, strict=True):
                value = goal.evaluate(balance)[0]
                slack = 1e-9 * (1 + abs(value))
                assert least - slack <= value <= most + slack, goal.name
