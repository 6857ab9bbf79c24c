"""Matrices of networks against dense algebra."""

import numpy as np
import pytest
from problems import NETWORKS, grounded, random_stress

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
    assert factor.n_negative == np.count_nonzero(np.linalg.eigvalsh(P) < 0)


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
