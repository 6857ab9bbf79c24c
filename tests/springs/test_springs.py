"""Springs past the transition: energies, forces and Hessian."""

import numpy as np
import pytest
from problems import NETWORKS, dense_free, random_stress, strained, with_random_stiffness

from critflow import (
    CriticalManifold,
    Hookean,
    PowerLaw,
    WormLike,
    spring_state,
    voronoi_network,
)
from critflow.linalg.matrices import block_laplacian


def dense_energy(network, rest, free):
    g, b = dense_free(network)
    if not network.pins:
        g = g[:, 1:]
    length = np.linalg.norm(g @ free + b, axis=1)
    return 0.5 * np.sum(network.stiffness * (length - rest) ** 2)


@pytest.mark.parametrize("name", NETWORKS)
def test_forces_and_hessian_are_derivatives_of_the_energy(name):
    network = with_random_stiffness(NETWORKS[name](), 5)
    critical = CriticalManifold(network).configuration(random_stress(network.n_edges, 2))
    rng = np.random.default_rng(3)
    rest = critical.lengths * rng.uniform(0.8, 1.2, network.n_edges)
    state = spring_state(network, rest, critical.coordinates)
    free = critical.coordinates[network.free]
    assert state.energy == pytest.approx(dense_energy(network, rest, free), rel=1e-13)
    direction = rng.standard_normal(free.shape)
    step = 1e-3
    sides = {n: dense_energy(network, rest, free + n * step * direction) for n in (-2, -1, 0, 1, 2)}
    first = (8 * (sides[1] - sides[-1]) - (sides[2] - sides[-2])) / (12 * step)
    second = (16 * (sides[1] + sides[-1]) - (sides[2] + sides[-2]) - 30 * sides[0]) / (12 * step**2)
    # Fourth-order differences: truncation 1e-12 times high derivatives, rounding 1e-16/step².
    assert -np.sum(state.forces * direction) == pytest.approx(first, rel=1e-7, abs=1e-8)
    factor = state.factorize(block_laplacian(network))
    curvature = direction.ravel() @ factor.multiply(direction.ravel())
    assert curvature == pytest.approx(second, rel=1e-6)


def test_stress_and_modified_stiffness_by_their_formulas():
    state = strained(with_random_stiffness(voronoi_network(20, seed=1), 1), 0.05)
    k, l, rest = state.network.stiffness, state.lengths, state.rest_lengths
    np.testing.assert_allclose(state.sigma, k * (l - rest) / l, rtol=1e-13)
    # K = ∂²E/∂h² with |L| = √(2h): k ℓ/|L|³.
    np.testing.assert_allclose(state.modified_stiffness, k * rest / l**3, rtol=1e-12)


LAWS = [Hookean(), PowerLaw(2.5), PowerLaw(4), WormLike(0.5)]


@pytest.mark.parametrize("name", ["voronoi, random stiffness", "voronoi 3D", "pinned grid"])
@pytest.mark.parametrize("law", LAWS, ids=repr)
def test_forces_and_hessian_of_every_law(law, name):
    network = with_random_stiffness(NETWORKS[name](), 5)
    critical = CriticalManifold(network).configuration(random_stress(network.n_edges, 2))
    rng = np.random.default_rng(3)
    rest = critical.lengths * rng.uniform(0.85, 1.2, network.n_edges)
    state = spring_state(network, rest, critical.coordinates, law)
    g, b = dense_free(network)
    g = g if network.pins else g[:, 1:]
    free, direction = critical.coordinates[network.free], rng.standard_normal(state.forces.shape)

    def energy(t):
        extension = np.linalg.norm(g @ (free + t * direction) + b, axis=1) - rest
        return np.sum(law.energy(extension, rest, network.stiffness))

    step = 5e-4
    E = {n: energy(n * step) for n in (-2, -1, 0, 1, 2)}
    assert state.energy == pytest.approx(E[0], rel=1e-13)
    first = (8 * (E[1] - E[-1]) - (E[2] - E[-2])) / (12 * step)
    second = (16 * (E[1] + E[-1]) - (E[2] + E[-2]) - 30 * E[0]) / (12 * step**2)
    # Truncation 1e-13 times high derivatives, rounding 1e-16/step².
    assert -np.sum(state.forces * direction) == pytest.approx(first, rel=1e-7, abs=1e-8)
    curvature = direction.ravel() @ state.factorize(state.pattern()).multiply(direction.ravel())
    assert curvature == pytest.approx(second, rel=1e-6)
    # Edge by edge: σ = E'/|L| and K = (E'' − σ)/|L|².
    tension = law.tension(state.extension, rest, network.stiffness)
    np.testing.assert_allclose(state.sigma * state.lengths, tension, rtol=1e-13)
    along = law.stiffness(state.extension, rest, network.stiffness)
    np.testing.assert_allclose(state.modified_stiffness, (along - state.sigma) / state.lengths**2, rtol=1e-13)


@pytest.mark.parametrize("law", LAWS, ids=repr)
def test_convex_part_is_the_hessian_without_compression(law):
    network = with_random_stiffness(voronoi_network(40, seed=2), 5)
    critical = CriticalManifold(network).configuration(random_stress(60, 2))
    pattern, unit = block_laplacian(network), np.eye(78)
    stretched = spring_state(network, critical.lengths / 1.1, critical.coordinates, law)
    whole = stretched.factorize(pattern).multiply(unit)
    np.testing.assert_allclose(stretched.factorize_convex(pattern, 0.0).multiply(unit), whole, rtol=0, atol=1e-13)
    compressed = spring_state(network, critical.lengths / 0.9, critical.coordinates, law)
    assert compressed.factorize(pattern).n_negative > 0
    convex = compressed.factorize_convex(pattern, 1.0).multiply(unit) - unit
    assert np.linalg.eigvalsh(convex).min() > -1e-12
    # Along an edge it keeps all of E''.
    g, _ = dense_free(network)
    n = compressed.bond_vectors / compressed.lengths[:, None]
    R = np.einsum("ai,am->aim", g[:, 1:], n).reshape(60, -1)
    np.testing.assert_allclose(convex, R.T @ (compressed.edge_stiffness[:, None] * R), rtol=0, atol=1e-12)
