"""Systems of stresses and displacements: against the equations themselves."""

import numpy as np
import pytest
from eliminating import ELIMINATING
from problems import NETWORKS, dense_bond_vectors, grounded, random_stress

from critflow import CriticalManifold, voronoi_network
from critflow.saddles import Saddle


def assert_solved(network, sigma, L, u, multipliers, forces, elongations, atol=1e-10):
    """P u + Rᵀ λ = f and R u = e, by dense incidence; elongations along σ cannot be met and are left out."""
    g, _ = grounded(network)
    met = elongations - (elongations @ sigma) / (sigma @ sigma) * sigma
    np.testing.assert_allclose(np.einsum("ad,ad->a", L, g @ u), met, rtol=0, atol=atol)
    balance = g.T @ (sigma[:, None] * (g @ u) + multipliers[:, None] * L)
    np.testing.assert_allclose(balance, forces, rtol=0, atol=atol)


@pytest.mark.parametrize("name", ["voronoi", "voronoi 3D", "square-octagon"])
@pytest.mark.parametrize("backend", ELIMINATING)
def test_saddle_solves_both_equations(backend, name):
    network = NETWORKS[name]()
    d, m = network.dimension, network.n_edges
    sigma = random_stress(m, 4)
    sigma *= np.sqrt(m / np.sum(sigma**2))
    L = dense_bond_vectors(network, sigma)
    rng = np.random.default_rng(5)
    forces, elongations = rng.standard_normal((len(network.free), d)), rng.standard_normal(m)
    saddle = Saddle(network, backend)
    assert saddle.stable(sigma, L) and not saddle.stable(-sigma, L)
    u, multipliers, error = saddle.factorize(sigma, L).solve(forces, elongations)
    # Two residuals, each against its own right side; refinement stops at rounding times the condition.
    assert error < 1e-12
    assert_solved(network, sigma, L, u, multipliers, forces, elongations)


@pytest.mark.parametrize("seed", [1, 2, 5])
def test_a_stress_is_stable_by_a_margin(seed):
    """With one edge under compression, against the least curvature of P on the null space of R."""
    network = voronoi_network(20, seed=seed)
    sigma = random_stress(network.n_edges, seed)
    sigma[3] *= -0.05
    L, g = dense_bond_vectors(network, sigma), network.free_incidence.toarray()
    R = (g[:, :, None] * L[:, None]).reshape(len(L), -1)
    P = np.kron(g.T @ (sigma[:, None] * g), np.eye(2))
    zero = np.linalg.svd(R)[2][len(L) - 1 :].T
    least = np.linalg.eigvalsh(zero.T @ P @ zero)[0] / np.mean(np.abs(sigma))
    assert least > 1e-3
    assert Saddle(network).stable(sigma, L, 0.9 * least) and not Saddle(network).stable(sigma, L, 1.1 * least)


@pytest.mark.parametrize(
    "corner, sums", [(None, None), (np.array([[0.3]]), None), (np.array([[-0.2]]), np.array([1.7]))]
)
def test_a_compliance_stays_in_the_equations(corner, sums):
    network = voronoi_network(20, seed=1)
    sigma = random_stress(30, 4)
    L = dense_bond_vectors(network, sigma)
    rng = np.random.default_rng(5)
    forces, elongations, compliance = (
        rng.standard_normal((19, 2)),
        rng.standard_normal(30),
        10.0 ** rng.uniform(-6, 1, 30),
    )
    factor = Saddle(network).factorize(sigma, L, compliance=compliance)
    border = rng.standard_normal((1, 30))
    u, multipliers, y, _ = factor.solve_bordered(forces, elongations, border, corner, sums)
    expected = 0.0 if sums is None else sums
    assert border @ multipliers + (0.0 if corner is None else corner @ y) == pytest.approx(expected, abs=1e-10)
    g, _ = grounded(network)
    stretch = np.einsum("ad,ad->a", L, g @ u) + y @ border
    np.testing.assert_allclose(stretch - compliance * multipliers, elongations, rtol=0, atol=1e-10)
    balance = g.T @ (sigma[:, None] * (g @ u) + multipliers[:, None] * L)
    np.testing.assert_allclose(balance, forces, rtol=0, atol=1e-10)


@pytest.mark.parametrize("n_vertices", [40, 1000])
@pytest.mark.parametrize("spread", [0.0, 0.9])
def test_the_residual_is_rounding_for_positive_stresses(n_vertices, spread):
    network = voronoi_network(n_vertices, seed=3)
    rng = np.random.default_rng(5)
    sigma = rng.uniform(1 - spread, 1 + spread, network.n_edges)
    L = CriticalManifold(network).configuration(sigma).bond_vectors
    forces = rng.standard_normal((n_vertices - 1, 2))
    given = rng.standard_normal(network.n_edges)
    u, multipliers, error = Saddle(network).factorize(sigma, L).solve(forces, given)
    assert error < 1e-11
    assert_solved(network, sigma, L, u, multipliers, forces, given, atol=1e-9)
