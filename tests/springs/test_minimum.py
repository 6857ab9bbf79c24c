"""Minima and saddles: the sign of the smallest eigenvalue of the Hessian, to its rounding."""

import numpy as np
import pytest
from problems import Factorisations, triangular_lattice

from critflow import (
    Cable,
    CriticalManifold,
    Network,
    Status,
    equilibrium,
    lattice,
    optimize,
    spring_state,
    voronoi_network,
)
from critflow.equilibria import compressed_edges, minimum_factor

METHODS = ["newton", "fire"]


def collinear(compression, n=2):
    """n springs in a row between pins at a distance of 1, compressed by a part of their length."""
    network = Network([[i, i + 1] for i in range(n)], pins={0: [0, 0], n: [1, 0]})
    x = np.stack([np.linspace(0, 1, n + 1), np.zeros(n + 1)], axis=1)
    return spring_state(network, np.full(n, (1 + compression) / n), x)


# Compressions of a straight chain, and the outcome.
CHAINS = {
    **dict.fromkeys((0.1, 1e-4, 4e-9, 1e-10, 1e-12, 1e-13), Status.unstable),
    # Rounding hides the minimum at |y| = √(ℓ² − ¼) = 7e-8, where the energy is lower by 1e-28.
    1e-14: Status.undecided,
    **dict.fromkeys((0.0, -1e-13, -1e-9, -0.1), Status.ok),
}


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("compression", CHAINS)
def test_a_straight_chain_is_a_saddle_where_it_is_compressed(compression, method):
    solution = equilibrium(collinear(compression), method, throw=False)
    assert solution.status is CHAINS[compression]
    assert solution.stats.error_bound < 1e-14 if solution.ok else not np.isfinite(solution.stats.error_bound)
    assert solution.status is not Status.undecided or "saddle" in solution.note


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("others", [(0.0,), (0.0, 0.0, 0.0)])
def test_one_mode_that_rounding_hides_decides_next_to_floppy_ones(others, method):
    """A straight chain compressed by 1e-14 next to chains at rest, which are floppy and undo nothing."""
    compressions = np.array([1e-14, *others])
    n = len(compressions)
    edges = np.array([[0, 1], [1, 2]]) + 3 * np.arange(n)[:, None, None]
    x = np.stack(np.broadcast_arrays([0, 0.5, 1], np.arange(n)[:, None]), axis=2).reshape(-1, 2)
    network = Network(edges.reshape(-1, 2), pins={i: x[i] for i in range(3 * n) if i % 3 != 1})
    state = spring_state(network, np.repeat((1 + compressions) / 2, 2), x)
    assert equilibrium(state, method, throw=False).status is Status.undecided


@pytest.mark.parametrize("method", METHODS)
def test_compressed_lattices(method):
    network = lattice("honeycomb", 3, 3)
    critical = CriticalManifold(network).configuration(np.ones(network.n_edges))
    straight = spring_state(network, 1.05 * critical.lengths, critical.coordinates)
    assert equilibrium(straight, method, throw=False).status is Status.unstable
    # Beyond the saddle it buckles to a state without energy: floppy, and no saddle.
    x = critical.coordinates + 1e-3 * np.random.default_rng(0).standard_normal(critical.coordinates.shape)
    buckled = equilibrium(spring_state(network, 1.05 * critical.lengths, x), method)
    assert buckled.ok and buckled.value.energy < 1e-20
    # A triangular lattice resists a compression of 2 %.
    network, x = triangular_lattice(3, 3)
    lengths = np.linalg.norm(network.bond_vectors(x), axis=1)
    assert equilibrium(spring_state(network, 1.02 * lengths, x), method).ok


@pytest.mark.parametrize("method", METHODS)
def test_floppy_parts_next_to_compressed_edges_are_no_saddle(method):
    # A stressed triangle of pins and one vertex, compressed along x and stretched along y; a loose chain of two edges.
    pins = {0: [-1, 0], 2: [1, 0], 3: [0, 1], 4: [0, -1], 6: [3, 0]}
    network = Network([[0, 1], [1, 2], [1, 3], [1, 4], [2, 5], [5, 6]], pins=pins)
    x = np.array([[-1, 0], [0, 0], [1, 0], [0, 1], [0, -1], [2, 0.5], [3, 0.0]])
    lengths = np.array([1.01, 1.01, 0.9, 0.9, np.hypot(1, 0.5), np.hypot(1, 0.5)])
    # The chain is exactly at rest, and rigid to first order in the plane: two edges fix two coordinates.
    assert equilibrium(spring_state(network, lengths, x), method).ok
    more = Network([*network.edges[:4], [2, 5], [5, 7], [7, 6]], pins=pins)
    x = np.array([*x[:5], [1.7, 0.6], [3, 0.0], [2.4, 0.5]])
    lengths = np.concatenate([lengths[:4], np.linalg.norm(more.bond_vectors(x), axis=1)[4:]])
    solution = equilibrium(spring_state(more, lengths, x), method)
    assert solution.ok and (solution.value.sigma[:2] < -0.005).all()


def test_a_minimum_is_one_beyond_rounding():
    # The unstressed chain has a mode without stiffness, which is no minimum.
    for stretch, minimum in ((0.1, True), (0.0, False)):
        assert (minimum_factor(collinear(-stretch)) is not None) is minimum


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize("size", [1.1, 0.8], ids=["stretched", "compressed"])
def test_indefinite_start_reaches_a_minimum(monkeypatch, size, seed):
    network = voronoi_network(40, seed=seed)
    critical = CriticalManifold(network).configuration(np.ones(60))
    x = critical.coordinates + 0.6 * np.random.default_rng(seed).standard_normal((40, 2))
    state = spring_state(network, critical.lengths / size, x)
    assert state.factorize().n_negative > 0
    factorised = Factorisations(monkeypatch)
    factors = factorised(network, lambda: equilibrium(state))["Hessian"]
    solution = factorised.answer
    assert solution.status is Status.ok
    assert solution.value.max_force < 1e-13
    # One a step: a matrix that was indefinite is not tried again while the force is nearly as large.
    assert factors <= solution.stats.steps + (5 if size > 1 else 10)
    n = 2 * len(network.free)
    H = solution.value.factorize(1.0).multiply(np.eye(n)) - np.eye(n)
    # Floppy where it is compressed, so zero modes are allowed; negative ones are not.
    assert np.linalg.eigvalsh(H).min() > -1e-8
    if size < 1:
        assert solution.value.energy < 1e-20


@pytest.mark.parametrize("seed", [1, 3, 4])
def test_a_floppy_part_of_slack_cables_costs_a_shift_and_no_convex_matrix(monkeypatch, seed):
    """The shift stays, so that a step has one factorisation."""
    critical = optimize(voronoi_network(30, seed=seed), "B_0").value
    rest = 0.98 * critical.lengths * np.exp(0.5 * np.random.default_rng(seed).standard_normal(45))
    state, factorised = spring_state(critical.network, rest, critical.coordinates, Cable()), Factorisations(monkeypatch)
    factors, solution = factorised(critical.network, lambda: equilibrium(state))["Hessian"], factorised.answer
    assert solution.ok and (solution.value.sigma == 0).any() and factors <= solution.stats.steps


@pytest.mark.parametrize("compression", [0.1, 1e-6, -0.1])
def test_compressed_edges_are_those_that_push_with_their_stress(compression):
    state = collinear(compression)
    np.testing.assert_array_equal(compressed_edges(state), np.maximum(-state.sigma, 0.0))
