"""Optimisation: proven optima, table of methods × objectives, and optima that are not attained."""

import numpy as np
import pytest
from problems import NETWORKS, at, dense_bond_vectors, modulus_by_formula, random_start, random_stress, voronoi_3d
from refusals import refused

from critflow import (
    CriticalManifold,
    InputError,
    Network,
    SolveError,
    Status,
    elasticity,
    optimize,
    upper_bound,
    voronoi_network,
)
from critflow.optima import largest_modulus, objective_of
from critflow.quantities import dilation, evaluate, pure_shear, transition_modulus
from workflows.shear.compression import least_compressed_length

NETWORK = voronoi_network(100, seed=1)


def projected_gradient(network, objective, sigma) -> float:
    """The largest component of dO/dσ at Σσ² = N_b; scale invariance makes it tangent to that sphere."""
    goal = objective_of(network, objective)
    return float(np.abs(evaluate(CriticalManifold(network).balance(sigma), goal).gradient).max())


METHODS = {
    "bulk_modulus": ("auto", "closed_form", "lbfgs", "newton", "fire"),
    "length_variance": ("auto", "conic", "lbfgs", "newton"),
    "tension_variance": ("auto", "lbfgs", "newton", "fire"),
    "shear_modulus": ("auto", "lbfgs", "newton"),
}
TABLE = [(objective, method) for objective, methods in METHODS.items() for method in methods]


@pytest.mark.parametrize("objective, method", TABLE)
def test_every_method_ends_where_the_gradient_vanishes(objective, method):
    solution = optimize(NETWORK, objective, method)
    assert solution.status is Status.ok
    assert solution.value.residual < 1e-12
    assert np.sum(solution.value.sigma**2) == pytest.approx(150, rel=1e-13)
    assert (solution.value.sigma > 0).all()
    assert solution.stats.residual < 1e-12
    # Evaluated again from the stored stresses, which are rounded.
    assert projected_gradient(NETWORK, objective, solution.value.sigma) < 1.1e-12
    L = dense_bond_vectors(NETWORK, solution.value.sigma)
    value = objective_of(NETWORK, objective).evaluate(at(NETWORK, solution.value.sigma, L))[0]
    assert solution.objective == pytest.approx(value, rel=1e-11, abs=1e-18)


# Largest bulk modulus


@pytest.mark.parametrize("name", ["voronoi, random stiffness", "voronoi 3D", "oblique"])
def test_the_bound_by_its_formula_and_by_its_force_network(name):
    network = NETWORKS[name]()
    d, k = network.dimension, network.stiffness
    L_star = dense_bond_vectors(network, k)
    bound = np.sum(k[:, None] * L_star**2) / (d**2 * abs(np.linalg.det(network.cell)))
    assert upper_bound(network, "B_0") == pytest.approx(bound, rel=1e-13)
    for method in ("closed_form", "lbfgs", "newton"):
        solution = optimize(network, "bulk_modulus", method, start=random_stress(network.n_edges, 1))
        assert solution.status is Status.ok
        # Equality in Cauchy–Schwarz: the forces σL are those of σ = k, whatever the lengths are.
        force = solution.value.sigma[:, None] * solution.value.bond_vectors
        expected = k[:, None] * L_star
        scale = np.sum(force * expected) / np.sum(expected**2)
        # A gradient of 1e-12 leaves the place uncertain by 1e-12 over the smallest curvature.
        np.testing.assert_allclose(force / scale, expected, rtol=0, atol=1e-9)
        assert elasticity(solution.value).value.bulk == pytest.approx(bound, rel=1e-12)
    best = optimize(network, "bulk_modulus")
    assert best.bound == pytest.approx(bound, rel=1e-13) and best.gap == 1 - best.objective / best.bound
    assert abs(best.gap) < 1e-13 and abs(best.objective - best.bound) <= best.objective_error + 1e-14
    assert np.isnan(optimize(network, "tension_variance", throw=False).gap)


# Variances


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_equal_lengths_are_reached_by_the_cone_program(seed):
    network = voronoi_network(100, seed=seed)
    solution = optimize(network, "length_variance", "conic")
    assert solution.status is Status.ok
    # The squared rounding of a length, 1e-32 times 100, is far below the requested 1e-18.
    assert solution.objective < 1e-26
    L = dense_bond_vectors(network, solution.value.sigma)
    np.testing.assert_allclose(np.linalg.norm(L, axis=1), solution.value.lengths.mean(), rtol=1e-12)


def test_least_tension_variance_is_the_same_from_every_start():
    solutions = [optimize(NETWORK, "tension_variance", start=random_start(seed)) for seed in range(5)]
    assert all(solution.status is Status.ok for solution in solutions)
    values = np.array([solution.objective for solution in solutions])
    np.testing.assert_allclose(values, values[0], rtol=0, atol=1e-12)
    assert 0.01 < values[0] < 0.02


# Shear modulus


def test_the_barrier_limits_stresses_from_below():
    for threshold in (0.05, 0.1, 0.2):
        solution = optimize(NETWORK, "shear_modulus", threshold=threshold)
        assert solution.status is Status.ok
        assert solution.value.sigma.min() > 0.7 * threshold
        shear = modulus_by_formula(NETWORK, solution.value.sigma, solution.value.bond_vectors, pure_shear(2))
        penalty = np.mean((solution.value.sigma / threshold) ** -10.0)
        assert solution.objective == pytest.approx(shear - penalty, rel=1e-11)


def test_many_starts_return_the_best():
    solution = optimize(NETWORK, "shear_modulus", starts=4, rng=np.random.default_rng(3))
    assert solution.status is Status.ok
    values = solution.starts
    assert len(values) == 4
    assert solution.objective == np.max(values)
    assert solution.start == np.argmax(values)
    assert values[0] == optimize(NETWORK, "shear_modulus").objective
    least = optimize(NETWORK, "tension_variance", starts=2, rng=np.random.default_rng(3))
    assert least.objective == np.min(least.starts)


@pytest.mark.parametrize(
    ("objective", "method", "options", "unused"),
    [
        ("B_0", "auto", {"start": np.ones(NETWORK.n_edges), "max_steps": 0}, "start, max_steps"),
        ("modulus[dilation]", "auto", {"observe": lambda *_: True}, "observe"),
        ("V_L", "conic", {"starts": 2, "rng": np.random.default_rng(0)}, "starts"),
        ("V_L", "auto", {"start": np.ones(NETWORK.n_edges)}, ""),
        ("B_0", "auto", {"tolerance": 1e-3}, ""),
    ],
)
def test_options_without_effect_are_named(objective, method, options, unused):
    solution = optimize(NETWORK, objective, method, **options)
    assert solution.note.startswith(f"no descent is needed, so that {unused} had no effect" if unused else "")
    assert bool(solution.note) is bool(unused)
    if unused:
        assert solution.objective == optimize(NETWORK, objective, method).objective


test_bad_arguments_are_refused = refused(
    {
        "starts without a generator": (lambda: optimize(NETWORK, "shear_modulus", starts=3), "random generator"),
        "a closed form of G_0": (lambda: optimize(NETWORK, "G_0", "closed_form"), "without a penalty"),
        "infinite threshold": (lambda: optimize(NETWORK, "G_0", threshold=np.inf), "threshold"),
        "threshold of another": (lambda: optimize(NETWORK, "V_L", threshold=-5), "threshold must be positive"),
        "unknown signs": (lambda: optimize(NETWORK, "B_0", signs="negative"), "'positive' or 'any'"),
        "compression": (
            lambda: optimize(NETWORK, transition_modulus(NETWORK, pure_shear(2)), "closed_form"),
            r"compresses \d+ edges: allow it with signs='any'",
        ),
        "no closed form in space": (lambda: largest_modulus(voronoi_3d(), pure_shear(3)), "three dimensions"),
        "compression in space": (lambda: least_compressed_length(voronoi_3d(), dilation(3)), "two dimensions"),
    },
    InputError,
)


def test_a_rough_tolerance_ends_the_iteration_to_equal_lengths():
    network = voronoi_network(1_000, seed=1)
    for tolerance in (1e-4, 1e-6):
        rough = optimize(network, "length_variance", tolerance=tolerance)
        assert rough.stats.method == "iteration" and rough.stats.residual < tolerance
        lengths = rough.value.lengths
        assert rough.objective == pytest.approx(np.var(lengths) / np.mean(lengths) ** 2, rel=1e-6)
        assert rough.objective_error == rough.objective > 1e-12
        assert rough.stats.residual == pytest.approx(projected_gradient(network, "V_L", rough.value.sigma), rel=1e-6)
    assert optimize(network, "length_variance").stats.method == "conic"


def test_a_rough_tolerance_without_equal_lengths_is_a_descent():
    network = voronoi_network(30, seed=4)  # whose least length variance leaves edges slack
    rough = optimize(network, "length_variance", tolerance=1e-5, throw=False)
    assert rough.stats.method == "auto" and rough.objective == pytest.approx(1.59097e-5, rel=1e-3)


def test_without_equal_lengths_the_cone_program_ends_with_a_status():
    # Equal lengths put the vertex on the mirror axis of two pins, above the third, to which its edge is then slack.
    star = Network([[0, 3], [1, 3], [2, 3]], pins={0: [0.0, 0.0], 1: [1.0, 0.0], 2: [0.5, 0.05]})
    found = optimize(star, "length_variance", "conic", throw=False)
    assert not found.ok and found.note
    with pytest.raises(SolveError):
        optimize(star, "length_variance", "conic")
    slack = optimize(voronoi_3d(), "length_variance", "conic", throw=False)
    assert slack.status is Status.slack_edges and len(slack.slack_edges) > 0
