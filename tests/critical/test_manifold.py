"""The map σ → configuration: formula, symmetries, derivatives and singular stresses."""

import pickle

import numpy as np
import pytest
from derivatives import assert_derivative
from problems import (
    NETWORKS,
    dense_bond_vectors,
    dense_free,
    dense_response,
    random_stress,
    square_octagon,
    square_octagon_bond_vectors,
)

from critflow import (
    CriticalManifold,
    InputError,
    Network,
    SolveError,
    Status,
    isogonal_modes,
    optimize,
    quantity,
    three_bar_linkage,
    upper_bound,
    voronoi_network,
)
from critflow.manifold import critical_configuration
from critflow.quantities import derivatives_along, evaluate

# Lengths are of order one and P is well conditioned (below 1e3), so both evaluations agree to about 1e-13.
ATOL = 2e-13


def signed_stress(n_edges: int, seed: int) -> np.ndarray:
    sigma = random_stress(n_edges, seed)
    sigma[::4] *= -0.3
    return sigma


@pytest.mark.parametrize("name", NETWORKS)
def test_map_is_the_pseudo_inverse_formula(name):
    network = NETWORKS[name]()
    for seed in range(3):
        sigma = random_stress(network.n_edges, seed)
        solution = CriticalManifold(network).solve(sigma)
        assert solution.status is Status.ok
        assert solution.negative_pivots == 0
        critical, L = solution.value, solution.value.bond_vectors
        np.testing.assert_allclose(L, dense_bond_vectors(network, sigma), rtol=0, atol=ATOL)
        np.testing.assert_allclose(network.bond_vectors(critical.coordinates), L, rtol=0, atol=ATOL)
        np.testing.assert_allclose(critical.tensions, critical.sigma * np.linalg.norm(L, axis=1), rtol=1e-14)
        force = dense_free(network)[0].T @ (critical.sigma[:, None] * L)
        assert max(critical.residual, np.abs(force).max() / np.mean(critical.tensions)) < 1e-12


def test_residual_detects_imbalance():
    network = voronoi_network(40, seed=1)
    balanced = CriticalManifold(network).configuration(np.ones(60))
    sigma = balanced.sigma.copy()
    sigma[3] += 1e-6
    moved = type(balanced)(network, sigma, balanced.coordinates, balanced.bond_vectors)
    tail, head = network.edges[3]
    g, _ = dense_free(network)
    expected = np.abs(g.T @ (sigma[:, None] * moved.bond_vectors)).max() / np.mean(sigma * moved.lengths)
    assert 1e-7 < expected
    # The residual contains every vertex but the grounded one.
    assert 0 not in (tail, head)
    assert moved.residual == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("shape", [None, [[1.2, 0.7], [-0.3, 0.8]]], ids=["square", "oblique"])
@pytest.mark.parametrize("s, t_x, t_y", [(1.0, 1.0, 1.0), (0.4, 2.0, 0.9), (3.0, 0.2, 1.7)])
def test_square_octagon_closed_form(s, t_x, t_y, shape):
    L = CriticalManifold(square_octagon(shape=shape)).configuration([s] * 4 + [t_x, t_y]).bond_vectors
    np.testing.assert_allclose(L, square_octagon_bond_vectors(s, t_x, t_y, shape=shape), rtol=0, atol=1e-14)


# Mixed signs


@pytest.mark.parametrize(
    "sigma, negative",
    # P = [[σ1 + σ2, −σ2], [−σ2, σ2 + σ3]]: two negative eigenvalues where its trace is negative and det > 0.
    [
        ([1, 1, 1], 0),
        ([3, 3, -1], 0),
        ([1, 1, -0.6], 1),
        ([1, 1, -0.4], 0),
        ([1, -3, 1], 1),
        ([-1, -1, 3], 1),
        ([-1, -1, 0.4], 2),
        ([-1, -1, -1], 2),
        # The first pivot vanishes, the determinant does not.
        ([-1, 1, 1], 1),
        ([1, -1, 3], 1),
    ],
)
def test_inertia_on_the_linkage(sigma, negative):
    sigma = np.array(sigma, dtype=float)
    P = np.array([[sigma[0] + sigma[1], -sigma[1]], [-sigma[1], sigma[1] + sigma[2]]])
    assert np.count_nonzero(np.linalg.eigvalsh(P) < 0) == negative
    solution = CriticalManifold(three_bar_linkage()).solve(sigma)
    assert solution.status is Status.ok
    assert solution.negative_pivots == negative


@pytest.mark.parametrize("sigma", [[1.0, 1.0, -0.5], [2.0, 2.0, -1.0], [-1.0, 0.5, -1.0]])
def test_singular_stress_gives_no_configuration(sigma):
    manifold = CriticalManifold(three_bar_linkage())
    solution = manifold.solve(sigma)
    assert solution.status is Status.singular
    assert np.isnan(solution.value.bond_vectors).all()
    assert np.isnan(solution.value.coordinates).all()
    with pytest.raises(SolveError, match="singular") as caught:
        manifold.configuration(sigma)
    assert caught.value.solution.status is Status.singular


def test_response_with_a_vanishing_pivot():
    manifold = CriticalManifold(three_bar_linkage())
    for sigma in ([-1.0, 1.0, 1.0], [1.0, -1.0, 3.0]):
        configuration = manifold.configuration(sigma)
        response = manifold.response(configuration) @ np.eye(3)
        np.testing.assert_allclose(response, dense_response(manifold.network, configuration.sigma), rtol=0, atol=1e-10)


@pytest.mark.parametrize("name", ["voronoi", "voronoi 3D", "oblique", "pinned grid"])
def test_configuration_of_mixed_signs(name):
    network = NETWORKS[name]()
    sigma = signed_stress(network.n_edges, 6)
    solution = CriticalManifold(network).solve(sigma)
    assert solution.status is Status.ok
    g, _ = dense_free(network)
    eigenvalues = np.linalg.eigvalsh(g.T @ (sigma[:, None] * g))
    scale = np.abs(eigenvalues).max()
    assert solution.negative_pivots == np.count_nonzero(eigenvalues < -1e-12 * scale)
    atol = 1e-14 * scale / np.min(np.abs(eigenvalues[np.abs(eigenvalues) > 1e-12 * scale])) * 100
    np.testing.assert_allclose(solution.value.bond_vectors, dense_bond_vectors(network, sigma), rtol=0, atol=atol)


# Derivatives


@pytest.mark.parametrize("name", ["voronoi", "voronoi 3D", "oblique", "sheared", "pinned grid", "square-octagon"])
def test_response_is_the_derivative_of_half_squared_lengths(name):
    network = NETWORKS[name]()
    manifold = CriticalManifold(network)
    configuration = manifold.configuration(random_stress(network.n_edges, 7))
    sigma = configuration.sigma
    B = manifold.response(configuration) @ np.eye(network.n_edges)
    np.testing.assert_allclose(B, dense_response(network, sigma), rtol=0, atol=1e-11)
    np.testing.assert_allclose(B, B.T, rtol=0, atol=1e-12)
    np.testing.assert_allclose(sigma @ B, 0, atol=1e-12)
    # Concavity of min_x Σσh: B is negative semidefinite for σ > 0.
    assert np.linalg.eigvalsh(B).max() < 1e-12
    edges = np.eye(network.n_edges)[[0, network.n_edges // 2, -1]]
    half_squares = lambda s: 0.5 * np.sum(dense_bond_vectors(network, s) ** 2, axis=1)  # noqa: E731
    assert_derivative(half_squares, lambda u: B @ u, sigma, edges, 1e-3, 1e-8)


@pytest.mark.parametrize("name", ["voronoi", "voronoi 3D", "pinned grid"])
def test_pull_back_equals_the_dense_formula(name):
    network = NETWORKS[name]()
    manifold = CriticalManifold(network)
    sigma = random_stress(network.n_edges, 9)
    balance = manifold.balance(sigma)
    L, rng = balance.bond_vectors, np.random.default_rng(10)
    dO_dsigma, dO_dL = rng.standard_normal(network.n_edges), rng.standard_normal(L.shape)
    gradient, gy = balance.pull_back(dO_dsigma, dO_dL)
    g, _ = dense_free(network)
    G = g @ np.linalg.pinv(g.T @ (sigma[:, None] * g), rcond=1e-12, hermitian=True) @ g.T
    # ∂L_β/∂σ_α = −G_{βα} L_α, contracted with ∂O/∂L_β.
    expected = dO_dsigma - np.array([L[a] @ (G[:, a] @ dO_dL) for a in range(network.n_edges)])
    np.testing.assert_allclose(gradient, expected, rtol=0, atol=1e-11)
    np.testing.assert_allclose(gy, G @ dO_dL, rtol=0, atol=1e-11)
    # The tangent is its transpose.
    dsigma = rng.standard_normal(network.n_edges)
    dL = balance.tangent(dsigma)
    assert np.sum(dO_dL * dL) == pytest.approx((gradient - dO_dsigma) @ dsigma, rel=1e-11)


# Edges that collapse


def test_edge_between_twins_has_no_length():
    # Two vertices with the same neighbours coincide at equal stresses, so that the edge between them collapses.
    edges = [[0, 3], [1, 3], [2, 3], [0, 4], [1, 4], [2, 4], [3, 4]]
    network = Network(edges, pins={0: [0.0, 0.0], 1: [4.0, 0.0], 2: [0.0, 3.0]}).with_volume(6.0)
    best = optimize(network, "bulk_modulus")
    assert best.status is Status.ok
    assert best.objective == pytest.approx(upper_bound(network, "B_0"), rel=1e-14)
    np.testing.assert_array_equal(best.collapsed_edges, [6])
    assert "6" in best.note
    with pytest.raises(InputError, match="edge 6"):
        isogonal_modes(best)
    # A length that vanishes is known; its derivative is not.
    assert best.value.lengths[6] == 0
    for name in ("V_L", "V_tau"):
        measured = quantity(network, name)
        assert np.isnan(evaluate(best.value.manifold.balance(best.value.sigma), measured).gradient).any()
        second = derivatives_along(measured, best.value, np.ones(7), best.value.bond_vectors)
        assert np.isnan(second[1]).any()


def test_a_configuration_keeps_its_manifold_and_a_copy_makes_one():
    manifold = CriticalManifold(voronoi_network(20, seed=1))
    critical = manifold.configuration(np.ones(manifold.network.n_edges))
    assert critical.manifold is manifold
    copied = pickle.dumps(critical)
    assert len(copied) < 2 * len(pickle.dumps(manifold.network))
    assert pickle.loads(copied).manifold.network.n_edges == manifold.network.n_edges


@pytest.mark.parametrize("scale", [1e-3, 1.0, 40.0])
def test_a_stress_and_coordinates_that_balance_are_stored_with_unit_mean_square(scale):
    found = CriticalManifold(voronoi_network(20, seed=1)).configuration(np.linspace(1.0, 2.0, 30))
    joined = critical_configuration(found.network, scale * found.sigma, found.coordinates)
    np.testing.assert_allclose(joined.sigma, found.sigma, rtol=1e-14)


def test_the_response_is_that_of_a_configuration_of_the_same_network():
    best = optimize(voronoi_network(20, seed=1), "B_0")
    CriticalManifold(best.value.network).response(best)
    with pytest.raises(InputError, match="another network"):
        CriticalManifold(voronoi_network(20, seed=2)).response(best)
