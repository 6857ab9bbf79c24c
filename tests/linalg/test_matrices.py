"""Matrices of networks against dense algebra."""

import numpy as np
import pytest
from problems import NETWORKS, grounded, random_stress

from critflow.sparse import laplacian


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
    np.testing.assert_allclose(factor.multiply(np.eye(len(P))), P, rtol=0, atol=1e-13)
    assert factor.n_negative == np.count_nonzero(np.linalg.eigvalsh(P) < 0)
