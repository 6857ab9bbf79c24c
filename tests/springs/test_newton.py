"""Newton's method: convergence, damping of indefinite Hessians, saddles and limits."""

import numpy as np
import pytest
from problems import NETWORKS, dense_free, strained

from critflow import CriticalManifold, Status, equilibrium, spring_state, voronoi_network
from critflow.linalg.matrices import block_laplacian


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
