"""Factorisations against dense algebra and scipy's own sparse solvers."""

import numpy as np
import pytest
from problems import NETWORKS, grounded, random_stress

from critflow import CriticalManifold, three_bar_linkage
from critflow.linalg.matrices import block_laplacian, edge_blocks, laplacian


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


def test_singular_prestress_of_the_linkage():
    # P = [[σ1 + σ2, −σ2], [−σ2, σ2 + σ3]] has determinant σ1σ2σ3 Σ1/σ: zero at (1, 1, −1/2).
    network = three_bar_linkage()
    factor = laplacian(network).factorize(np.array([1.0, 1.0, -0.5]))
    assert factor.singular
    manifold = CriticalManifold(network)
    for sigma in ([1.0, 1.0, -0.5], [2.0, 2.0, -1.0]):
        assert not manifold.solve(sigma).ok
