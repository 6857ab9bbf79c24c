"""Factorisations against dense algebra and scipy's own sparse solvers."""

import numpy as np
import pytest
import scipy.sparse as sp
from problems import NETWORKS, dense_bond_vectors, dense_free, random_stress
from scipy.sparse.linalg import spsolve

from critflow import CritflowError, CriticalManifold, three_bar_linkage, voronoi_network
from critflow.linalg.matrices import FixedPattern, Saddle, StaleFactorError, block_laplacian, edge_blocks, laplacian


def grounded(network):
    """Dense free incidence and b as the library takes them: without pins, vertex 0 is the ground."""
    g, b = dense_free(network)
    return (g if network.pins else g[:, 1:]), b


def dense_of(factor, size):
    return factor.multiply(np.eye(size))


@pytest.mark.parametrize("signed", [False, True], ids=["positive", "signed"])
@pytest.mark.parametrize("name", NETWORKS)
def test_laplacian_against_dense(name, signed):
    network = NETWORKS[name]()
    sigma = random_stress(network.n_edges, 1)
    if signed:
        sigma[::5] *= -0.7
    g, _ = grounded(network)
    P = g.T @ (sigma[:, None] * g)
    factor = laplacian(network).factorize(sigma)
    np.testing.assert_allclose(dense_of(factor, len(P)), P, rtol=0, atol=1e-13)
    right = np.random.default_rng(2).standard_normal((len(P), 3))
    # Both solvers are backward stable: they differ by the condition number times rounding.
    atol = 100 * np.linalg.cond(P) * np.finfo(float).eps
    np.testing.assert_allclose(factor.solve(right), np.linalg.solve(P, right), rtol=0, atol=atol)
    np.testing.assert_allclose(
        factor.solve(right), spsolve(sp.csc_array(P), right).reshape(right.shape), rtol=0, atol=atol
    )
    np.testing.assert_array_equal(factor.solve(right[:, 0]), factor.solve(right)[:, 0])
    eigenvalues = np.linalg.eigvalsh(P)
    assert factor.n_negative == np.count_nonzero(eigenvalues < 0)
    assert not factor.singular
    if not signed:
        assert factor.n_negative == 0


@pytest.mark.parametrize("shift", [0.0, 0.3])
@pytest.mark.parametrize("name", NETWORKS)
def test_block_laplacian_against_dense(name, shift):
    network = NETWORKS[name]()
    d, m = network.dimension, network.n_edges
    rng = np.random.default_rng(3)
    along, isotropic, v = rng.standard_normal(m), rng.standard_normal(m), rng.standard_normal((m, d))
    g, _ = grounded(network)
    n = g.shape[1]
    H = np.zeros((n * d, n * d))
    for a in range(m):
        C = along[a] * np.outer(v[a], v[a]) + isotropic[a] * np.eye(d)
        H += np.kron(np.outer(g[a], g[a]), C)
    H += shift * np.eye(n * d)
    factor = block_laplacian(network).factorize(edge_blocks(along, v, isotropic), shift)
    np.testing.assert_allclose(dense_of(factor, n * d), H, rtol=0, atol=1e-12)
    assert factor.n_negative == np.count_nonzero(np.linalg.eigvalsh(H) < 0)


@pytest.mark.parametrize("name", ["voronoi", "voronoi 3D", "square-octagon"])
def test_saddle_solves_both_equations(name):
    network = NETWORKS[name]()
    d, m = network.dimension, network.n_edges
    sigma = random_stress(m, 4)
    sigma *= np.sqrt(m / np.sum(sigma**2))
    L = dense_bond_vectors(network, sigma)
    g, _ = grounded(network)
    rng = np.random.default_rng(5)
    forces, elongations = rng.standard_normal((g.shape[1], d)), rng.standard_normal(m)
    elongations -= (elongations @ sigma) / (sigma @ sigma) * sigma
    saddle = Saddle(network).factorize(sigma, L)
    assert saddle.stable
    u, multipliers, error = saddle.solve(forces, elongations)
    # Two residuals, each against its own right side; refinement stops at rounding times the condition.
    assert error < 1e-12
    np.testing.assert_allclose(np.einsum("ad,ad->a", L, g @ u), elongations, rtol=0, atol=1e-10)
    balance = g.T @ (sigma[:, None] * (g @ u) + multipliers[:, None] * L)
    np.testing.assert_allclose(balance, forces, rtol=0, atol=1e-10)


def test_saddle_leaves_out_what_no_displacement_can_give():
    network = voronoi_network(20, seed=1)
    sigma = random_stress(30, 4)
    L = dense_bond_vectors(network, sigma)
    rng = np.random.default_rng(5)
    forces, elongations = rng.standard_normal((19, 2)), rng.standard_normal(30)
    saddle = Saddle(network).factorize(sigma, L)
    u, _, error = saddle.solve(forces, elongations)
    assert error < 1e-12
    consistent = elongations - (elongations @ sigma) / (sigma @ sigma) * sigma
    np.testing.assert_allclose(u, saddle.solve(forces, consistent)[0], rtol=0, atol=1e-10)


def test_saddle_tells_a_stress_that_does_not_stabilise():
    network = voronoi_network(20, seed=1)
    sigma = np.ones(30)
    L = dense_bond_vectors(network, sigma)
    assert Saddle(network).stable(sigma, L)
    assert not Saddle(network).stable(-sigma, L)


def test_a_stale_factor_raises():
    pattern = laplacian(voronoi_network(20, seed=1))
    old = pattern.factorize(np.ones(30))
    new = pattern.factorize(np.full(30, 2.0))
    right = np.ones(pattern.size)
    for use in (old.solve, old.multiply):
        with pytest.raises(StaleFactorError, match="factorise it again"):
            use(right)
    with pytest.raises(CritflowError):
        _ = old.pivots
    np.testing.assert_allclose(new.multiply(new.solve(right)), right, rtol=1e-12)


def test_factors_of_two_patterns_do_not_mix():
    network = voronoi_network(20, seed=1)
    first, second = laplacian(network), laplacian(network)
    one, two = first.factorize(np.ones(30)), second.factorize(np.full(30, 2.0))
    right = np.ones(first.size)
    np.testing.assert_allclose(one.solve(right), 2 * two.solve(right), rtol=1e-13)


@pytest.mark.parametrize(
    "matrix, singular",
    [
        (np.array([[1.0, 1.0], [1.0, 1.0]]), True),
        (np.array([[0.0, 1.0], [1.0, 0.0]]), True),
        (np.array([[1.0, 1.0], [1.0, 1.0 + 1e-16]]), True),
        (np.array([[1.0, 0.5], [0.5, 1.0]]), False),
        (np.array([[1.0, 2.0], [2.0, 1.0]]), False),
        (np.diag([1.0, 1e-10]), False),
        (np.array([[1.0, np.nan], [np.nan, 1.0]]), True),
    ],
)
def test_singular_matrices_are_flagged(matrix, singular):
    rows, cols = np.triu_indices(2)
    factor = FixedPattern(2, 3, [(rows, cols, np.arange(3), 1.0)]).factorize(matrix[rows, cols])
    assert factor.singular == singular


def test_singular_prestress_of_the_linkage():
    # P = [[σ1 + σ2, −σ2], [−σ2, σ2 + σ3]] has determinant σ1σ2σ3 Σ1/σ: zero at (1, 1, −1/2).
    network = three_bar_linkage()
    factor = laplacian(network).factorize(np.array([1.0, 1.0, -0.5]))
    assert factor.singular
    manifold = CriticalManifold(network)
    for sigma in ([1.0, 1.0, -0.5], [2.0, 2.0, -1.0]):
        assert not manifold.solve(sigma).ok
