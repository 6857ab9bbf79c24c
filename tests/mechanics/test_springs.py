"""Springs past the transition: energies, forces, Hessian and equilibrium."""

import numpy as np
import pytest
from problems import NETWORKS, dense_free, random_stress, with_random_stiffness

from critflow import (
    CriticalManifold,
    Hookean,
    InputError,
    Network,
    PowerLaw,
    SolveError,
    Status,
    WormLike,
    equilibrium,
    spring_state,
    strain_path,
    three_bar_linkage,
    voronoi_network,
)
from critflow.linalg.matrices import block_laplacian


def strained(network, gamma, seed=1):
    """Springs at rest in a critical configuration, then stretched affinely to volume V(1 + γ)."""
    critical = CriticalManifold(network).configuration(random_stress(network.n_edges, seed))
    state = spring_state(network, critical.lengths, critical.coordinates)
    return state.deformed((1 + gamma) ** (1 / network.dimension) * np.eye(network.dimension))


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


@pytest.mark.parametrize("gamma", [1e-6, 1e-3, 0.3])
@pytest.mark.parametrize("name", ["voronoi", "voronoi 3D", "voronoi, random stiffness", "oblique"])
def test_newton_relaxes_to_rounding(name, gamma):
    network = NETWORKS[name]()
    solution = equilibrium(strained(network, gamma), tolerance=1e-14)
    assert solution.status is Status.ok
    state = solution.value
    assert state.max_force < 1e-13
    g, _ = dense_free(network)
    force = g.T @ (state.sigma[:, None] * state.bond_vectors)
    assert np.abs(force).max() < 1e-13
    # Few steps in spite of a soft network: stiffness ∝ γ.
    assert solution.stats.steps <= 12
    assert (state.sigma > 0).all()


def test_newton_and_fire_reach_the_same_equilibrium():
    start = strained(with_random_stiffness(voronoi_network(20, seed=3), 2), 0.05)
    newton = equilibrium(start)
    fire = equilibrium(start, "fire", tolerance=1e-13)
    assert newton.status is fire.status is Status.ok
    assert newton.value.max_force < 1e-13
    # A force of 1e-13 over the softest stiffness, about γ times a few percent, leaves 1e-10.
    np.testing.assert_allclose(fire.value.bond_vectors, newton.value.bond_vectors, rtol=0, atol=1e-10)
    assert fire.value.energy == pytest.approx(newton.value.energy, rel=1e-12)


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize("size", [1.1, 0.8], ids=["stretched", "compressed"])
def test_indefinite_start_reaches_a_minimum(size, seed):
    network = voronoi_network(40, seed=seed)
    critical = CriticalManifold(network).configuration(np.ones(60))
    rng = np.random.default_rng(seed)
    x = critical.coordinates + 0.6 * rng.standard_normal((40, 2))
    state = spring_state(network, critical.lengths / size, x)
    pattern = block_laplacian(network)
    assert state.factorize(pattern).n_negative > 0
    solution = equilibrium(state)
    assert solution.status is Status.ok
    assert solution.value.max_force < 1e-13
    n = 2 * len(network.free)
    H = solution.value.factorize(pattern, 1.0).multiply(np.eye(n)) - np.eye(n)
    # Floppy where it is compressed, so zero modes are allowed; negative ones are not.
    assert np.linalg.eigvalsh(H).min() > -1e-8
    if size < 1:
        assert solution.value.energy < 1e-20


def test_equilibrium_is_scale_invariant():
    start = strained(voronoi_network(20, seed=3), 0.02)
    soft = equilibrium(start).value
    stiff_network = start.network.with_stiffness(1e6)
    stiff = equilibrium(spring_state(stiff_network, start.rest_lengths, start.coordinates)).value
    np.testing.assert_allclose(stiff.bond_vectors, soft.bond_vectors, rtol=0, atol=1e-12)
    assert stiff.energy == pytest.approx(1e6 * soft.energy, rel=1e-11)


def test_steps_and_failures_are_reported():
    start = strained(voronoi_network(20, seed=3), 0.3)
    for method in ("newton", "fire"):
        solution = equilibrium(start, method, max_steps=1, throw=False)
        assert solution.status is Status.step_limit
        with pytest.raises(SolveError, match="max_steps"):
            equilibrium(start, method, max_steps=1)
    with pytest.raises(InputError, match="newton"):
        equilibrium(start, "bfgs")


def test_relaxation_does_not_change_its_input():
    start = strained(voronoi_network(20, seed=3), 0.1)
    before = start.coordinates.copy(), start.bond_vectors.copy()
    equilibrium(start)
    np.testing.assert_array_equal(start.coordinates, before[0])
    np.testing.assert_array_equal(start.bond_vectors, before[1])


@pytest.mark.parametrize("name", ["voronoi", "voronoi 3D", "oblique"])
def test_coordinates_and_bond_vectors_stay_consistent(name):
    critical = CriticalManifold(NETWORKS[name]()).configuration(random_stress(NETWORKS[name]().n_edges, 4))
    path = strain_path(critical.network, critical, [0.01, 0.02, 0.05]).value
    for state in path.states:
        np.testing.assert_allclose(
            state.network.bond_vectors(state.coordinates), state.bond_vectors, rtol=0, atol=1e-13
        )


def test_straight_compressed_linkage_is_a_saddle():
    network = three_bar_linkage()
    straight = CriticalManifold(network).configuration(np.ones(3))
    solution = equilibrium(spring_state(network, np.full(3, 1.1), straight.coordinates), throw=False)
    assert solution.status is Status.unstable


# Other laws

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
    np.testing.assert_allclose(fire.value.bond_vectors, newton.value.bond_vectors, rtol=0, atol=1e-10)


@pytest.mark.parametrize("method", ["newton", "fire"])
def test_steps_stay_within_the_range_of_the_law(method):
    # A long stiff spring stretches a short soft one from rest by seven times its range.
    network = Network([[0, 1], [1, 2]], pins={0: [0.0, 0.0], 2: [22.0, 0.0]}, stiffness=[1.0, 1000.0])
    state = spring_state(network, [1.0, 19.0], [[0.0, 0.0], [1.0, 0.0], [22.0, 0.0]], WormLike(0.3))
    pull = state.factorize(state.pattern()).solve(state.forces.ravel()).reshape(1, 2)
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
