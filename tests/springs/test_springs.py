"""Springs past the transition: energies, forces and Hessian."""

import copy
import pickle
from dataclasses import replace

import numpy as np
import pytest
from derivatives import assert_derivative
from problems import NETWORKS, dense_free, grounded, random_stress, with_random_stiffness

from critflow import Cable, CriticalManifold, Hookean, Network, PowerLaw, WormLike, spring_state, voronoi_network


class Undeclared(Hookean):
    """A law that does not say that it is convex."""

    convex = False


LAWS = [Hookean(), PowerLaw(2.5), PowerLaw(4), WormLike(0.5)]
STATES = [(name, Hookean()) for name in NETWORKS] + [
    (name, law) for name in ("voronoi, random stiffness", "voronoi 3D", "pinned grid") for law in LAWS[1:]
]


@pytest.mark.parametrize("name, law", STATES, ids=repr)
def test_forces_and_hessian_are_derivatives_of_the_energy(name, law):
    network = with_random_stiffness(NETWORKS[name](), 5)
    critical, rng = CriticalManifold(network).configuration(random_stress(network.n_edges, 2)), np.random.default_rng(3)
    rest = critical.lengths * rng.uniform(0.85, 1.2, network.n_edges)
    state = spring_state(network, rest, critical.coordinates, law)
    (g, b), free, k = grounded(network), critical.coordinates[network.free], network.stiffness

    def energy(u):
        return np.sum(law.energy(np.linalg.norm(g @ (free + u) + b, axis=1) - rest, rest, k))

    zero, u = np.zeros_like(free), rng.standard_normal(free.shape)
    assert state.energy == pytest.approx(energy(zero), rel=1e-13)
    assert_derivative(energy, -state.forces, zero, [u], rtol=1e-7, atol=1e-8)
    factor = state.factorize()
    assert_derivative(
        lambda v: -state.moved(v).forces, lambda v: factor.multiply(v.ravel()).reshape(v.shape), zero, [u], rtol=1e-7
    )
    # Edge by edge: σ = E'/|L| and K = (E'' − σ)/|L|².
    tension, along = (f(state.extension, rest, k) for f in (law.tension, law.stiffness))
    np.testing.assert_allclose(state.sigma * state.lengths, tension, rtol=1e-13)
    np.testing.assert_allclose(state.modified_stiffness, (along - state.sigma) / state.lengths**2, rtol=1e-13)


@pytest.mark.parametrize("law", LAWS, ids=repr)
def test_convex_part_is_the_hessian_without_compression(law):
    network = with_random_stiffness(voronoi_network(40, seed=2), 5)
    critical = CriticalManifold(network).configuration(random_stress(60, 2))
    unit = np.eye(78)
    stretched = spring_state(network, critical.lengths / 1.1, critical.coordinates, law)
    whole = stretched.factorize().multiply(unit)
    np.testing.assert_allclose(stretched.factorize_convex(0.0).multiply(unit), whole, rtol=0, atol=1e-13)
    compressed = spring_state(network, critical.lengths / 0.9, critical.coordinates, law)
    assert compressed.factorize().n_negative > 0
    convex = compressed.factorize_convex(1.0).multiply(unit) - unit
    assert np.linalg.eigvalsh(convex).min() > -1e-12
    # Along an edge it keeps all of E''.
    g, _ = dense_free(network)
    n = compressed.bond_vectors / compressed.lengths[:, None]
    R = np.einsum("ai,am->aim", g[:, 1:], n).reshape(60, -1)
    np.testing.assert_allclose(convex, R.T @ (compressed.edge_stiffness[:, None] * R), rtol=0, atol=1e-12)


@pytest.mark.parametrize("law, rest, unique", [
    (Hookean(), [0.9, 0.9], True), (Hookean(), [1.0, 1.0], True), (Hookean(), [0.9, 1.1], False),
    (Cable(), [0.9, 1.1], True), (Undeclared(), [0.9, 0.9], False),
], ids=repr)  # fmt: skip
def test_unique_is_an_equilibrium_of_a_convex_law_without_compression(law, rest, unique):
    network = Network([[0, 1], [1, 2]], pins={0: [0.0, 0.0], 2: [2.0, 0.0]})
    assert spring_state(network, rest, [[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]], law).unique is unique


def test_copies_of_a_network_share_the_pattern_of_the_hessian():
    network = voronoi_network(20, seed=1)
    state = spring_state(network, np.ones(network.n_edges), network.positions)
    moved = state.deformed(1.1 * np.eye(2)).deformed(1.1 * np.eye(2))
    assert moved.pattern is state.pattern is moved.pattern
    assert spring_state(network.with_stiffness(2.0), state.rest_lengths, network.positions).pattern is state.pattern
    other = replace(state, backend="superlu")
    assert other.pattern.backend == other.deformed(np.eye(2)).pattern.backend == "superlu"
    # Another network, or one of another process, has its own.
    assert network.without_edges([0]).matrices == {}
    for copied in (pickle.loads(pickle.dumps(moved)), copy.deepcopy(moved)):
        assert copied.network.matrices == {}
        assert copied.pattern is not moved.pattern
