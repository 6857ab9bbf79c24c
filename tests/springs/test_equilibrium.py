"""Equilibria: the same by both methods, within error bounds that are tight, however soft the network."""

import sys

import numpy as np
import pytest
from problems import SMALL_NETWORKS, STRAINS, random_stress, strained, voronoi_3d, with_random_stiffness

from critflow import (
    Cable,
    CriticalManifold,
    Hookean,
    Network,
    PowerLaw,
    SolveError,
    Status,
    WormLike,
    equilibrium,
    optimize,
    spring_state,
    voronoi_network,
)
from critflow.refinement import exact_bond_vectors, exact_forces
from workflows.benchmarks import reference


def errors(state):
    """Largest error of a coordinate and of a component of a bond vector."""
    exact = reference.equilibrium(state.network, state.rest_lengths, state.coordinates)
    moved = not state.network.pins
    return (
        reference.largest_error(state.coordinates, exact.coordinates, moved),
        reference.largest_error(state.bond_vectors, exact.bond_vectors),
    )


def exact_correction(state):
    """Displacement from a state to the exact equilibrium, with new factors."""
    error = np.zeros((len(state.network.free), state.network.dimension))
    factor = state.factorize()
    for _ in range(8):
        L = exact_bond_vectors(state.network, state.coordinates, error)
        force = exact_forces(state.network, state.exact_stress(L), L)
        error = error + factor.solve(force.ravel()).reshape(error.shape)
    return error


LAWS = [Hookean(), PowerLaw(2.5), PowerLaw(4), WormLike(0.5)]


@pytest.mark.parametrize("law", LAWS, ids=repr)
def test_newton_and_fire_agree_for_every_law(law):
    network = with_random_stiffness(voronoi_network(20, seed=3), 2)
    critical = CriticalManifold(network).configuration(random_stress(30, 1))
    start = spring_state(network, critical.lengths, critical.coordinates, law).deformed(np.sqrt(1.05) * np.eye(2))
    newton = equilibrium(start)
    fire = equilibrium(start, "fire", tolerance=1e-13)
    assert newton.status is fire.status is Status.ok
    assert newton.value.law == fire.value.law == law
    assert newton.value.max_force < 1e-13
    # A force of 1e-13 over the softest stiffness, about γ times a few percent, leaves 1e-10.
    np.testing.assert_allclose(fire.value.bond_vectors, newton.value.bond_vectors, rtol=0, atol=1e-10)
    assert fire.value.energy == pytest.approx(newton.value.energy, rel=1e-12)


def test_steps_and_failures_are_reported():
    start = strained(voronoi_network(20, seed=3), 0.3)
    for method in ("newton", "fire"):
        assert equilibrium(start, method, max_steps=1, throw=False).status is Status.step_limit
        with pytest.raises(SolveError, match="max_steps"):
            equilibrium(start, method, max_steps=1)


@pytest.mark.parametrize("method", ["newton", "fire"])
def test_steps_stay_within_the_range_of_the_law(method):
    # A long stiff spring stretches a short soft one from rest by seven times its range.
    network = Network([[0, 1], [1, 2]], pins={0: [0.0, 0.0], 2: [22.0, 0.0]}, stiffness=[1.0, 1000.0])
    state = spring_state(network, [1.0, 19.0], [[0.0, 0.0], [1.0, 0.0], [22.0, 0.0]], WormLike(0.3))
    pull = state.factorize().solve(state.forces.ravel()).reshape(1, 2)
    assert state.moved(pull).energy == np.inf
    solution = equilibrium(state, method, tolerance=1e-13)
    assert solution.status is Status.ok
    end = solution.value
    # In series both have one tension, and the soft one is near its contour length.
    tension = end.sigma * end.lengths
    assert tension[0] == pytest.approx(tension[1], rel=1e-9)
    assert 1.29 < end.lengths[0] < 1.3


@pytest.mark.parametrize("method", ["newton", "fire"])
def test_start_beyond_the_range_raises(method):
    state = strained(voronoi_network(20, seed=3), 0.1)
    worms = spring_state(state.network, state.rest_lengths, state.coordinates, WormLike(0.01))
    assert worms.energy == np.inf
    assert equilibrium(worms, method, throw=False).status is Status.stalled
    with pytest.raises(SolveError, match="smaller"):
        equilibrium(worms, method)


@pytest.mark.parametrize("stretch", [2e-16, 1e-15, 1e-14, 1e-13])
def test_soft_modes_beside_floppy_ones_have_no_small_error(stretch):
    # Two taut cables in a line, a little off the straight one: stiffness 2σ across.  Two slack ones beside them.
    network = Network([[0, 1], [1, 2], [0, 3], [2, 3]], pins={0: [0.0, 0.0], 2: [2.0, 0.0]})
    for off in (1e-14, 1e-13, 1e-12, 1e-11):
        x = [[0.0, 0.0], [1.0, off], [2.0, 0.0], [1.0, 1.0]]
        found = equilibrium(spring_state(network, [1 - stretch] * 2 + [3.0] * 2, x, Cable()), throw=False)
        error = abs(found.value.coordinates[1, 1])
        assert error <= found.stats.error_bound if found.ok else np.isinf(found.stats.error_bound)


def test_newton_converges_to_the_exact_equilibrium():
    ratios = []
    for name, make in SMALL_NETWORKS.items():
        for gamma in STRAINS[:: 1 if name == "voronoi" else 4]:
            solution = equilibrium(strained(make(), gamma))
            assert solution.status is Status.ok
            coordinates, bonds = errors(solution.value)
            bound = solution.stats.error_bound
            assert max(coordinates, bonds) <= bound, (name, gamma)
            # Half a rounding of coordinates.
            assert bound <= 2 * np.finfo(float).eps * np.abs(solution.value.coordinates).max(), (name, gamma)
            ratios.append(bound / coordinates)
            # Few steps in spite of a soft network: stiffness ∝ γ.
            assert solution.stats.steps <= 12, (name, gamma)
    assert np.median(ratios) < 3


@pytest.mark.parametrize("tolerance", [1e-2, 1e-4, 1e-6, 1e-10, 1e-13])
@pytest.mark.parametrize("gamma", [0.1, 1e-2, 1e-3])
def test_error_bounds_of_fire(tolerance, gamma):
    solution = equilibrium(strained(SMALL_NETWORKS["voronoi"](), gamma), "fire", tolerance)
    assert solution.status is Status.ok
    error, bound = max(errors(solution.value)), solution.stats.error_bound
    assert error <= bound <= 2 * error
    # The solution is FIRE's, without refinement: its error corresponds to its force.
    assert error > 1e-2 * tolerance


@pytest.mark.parametrize("gamma", [1e-1, 1e-5, 1e-10])
def test_bounds_of_larger_networks(gamma):
    # The reference is Newton's method in double-double arithmetic with new factors, checked above against mpmath.
    for network in (voronoi_network(300, seed=1), voronoi_3d(20)):
        solution = equilibrium(strained(network, gamma))
        error = np.abs(exact_correction(solution.value)).max()
        assert error <= solution.stats.error_bound <= 4 * error


@pytest.mark.parametrize("n_vertices", [40, 300])
def test_rough_tolerances_are_not_ill_conditioned(n_vertices):
    network = voronoi_network(n_vertices, seed=1)
    for tolerance in 10.0 ** -np.arange(2, 15):
        solution = equilibrium(strained(network, 1e-3), tolerance=tolerance)
        assert solution.status is Status.ok, tolerance
        assert solution.stats.method == "newton"
        error = np.abs(exact_correction(solution.value)).max()
        # Newton's method converges to the equilibrium at any tolerance.
        assert error <= solution.stats.error_bound < 4 * np.finfo(float).eps * np.abs(solution.value.coordinates).max()


# After a solution that is too rough, such as the start near the transition, Newton's method continues.
@pytest.mark.parametrize(
    "gamma, tolerance, near, needed", [(0.1, 1e-2, 1e-8, 4), (1e-8, 1e-8, 1e-8, 1), (0.1, 1e-2, 1, 3)]
)
def test_step_limit_is_respected(monkeypatch, gamma, tolerance, near, needed):
    monkeypatch.setattr(sys.modules["critflow.equilibria"], "LOOSEST_TOLERANCE", near)
    start = strained(voronoi_network(40, seed=1), gamma)
    assert equilibrium(start, tolerance=tolerance).stats.steps == needed
    for most in range(needed):
        solution = equilibrium(start, tolerance=tolerance, max_steps=most, throw=False)
        assert solution.status is Status.step_limit
        assert solution.stats.steps == most


def test_condition_is_that_of_the_hessian():
    for gamma in (1e-1, 1e-4, 1e-8):
        solution = equilibrium(strained(SMALL_NETWORKS["stiffness"](), gamma))
        state = solution.value
        H = state.factorize().multiply(np.eye(state.forces.size))
        assert solution.stats.condition == pytest.approx(np.linalg.cond(H), rel=4)
        assert solution.stats.condition > 0.3 * np.linalg.cond(H)


def test_a_tolerance_below_rounding_ends_where_rounding_begins():
    # A step that raises the energy by its rounding is no progress: 200 of them would be made.
    critical = optimize(voronoi_network(40, seed=1), "bulk_modulus").value
    state = spring_state(critical.network, 0.95 * critical.lengths, critical.coordinates)
    end = equilibrium(state, tolerance=1e-25, throw=False)
    assert end.status is Status.stalled and end.stats.steps < 20
    assert end.stats.residual < 1e-14
