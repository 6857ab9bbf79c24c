"""The soft band of critical networks: against Hessians of strained networks, differences and closed forms."""

import numpy as np
import pytest
from derivatives import assert_derivative
from problems import dense_incidence, random_stress, slack_lattice, with_random_stiffness
from refusals import refused

from critflow import CriticalManifold, InputError, Network, lattice, optimize, strain_path, voronoi_network
from critflow_extras import AngleSprings, weak_forces
from critflow_extras.weak.soft_spectrum import soft_spectrum

NETWORK = with_random_stiffness(voronoi_network(40, seed=2), 3)
MANIFOLD = CriticalManifold(NETWORK)
CRITICAL = MANIFOLD.configuration(random_stress(NETWORK.n_edges, 1))
N_FLOPPY = NETWORK.n_vertices // 2 - 1


def hessian(state):
    """The dense Hessian of Hookean springs over the free coordinates, from the positions alone."""
    network, L = state.network, state.bond_vectors
    g, length = dense_incidence(network)[:, network.free], np.linalg.norm(L, axis=1)
    n, k = L / length[:, None], network.stiffness
    sigma = k * (1 - state.rest_lengths / length)
    blocks = (k - sigma)[:, None, None] * n[:, :, None] * n[:, None, :] + sigma[:, None, None] * np.eye(L.shape[1])
    full = np.einsum("ai,aj,ade->idje", g, g, blocks)
    return full.reshape(g.shape[1] * L.shape[1], -1)


def test_the_soft_band_of_strained_networks_deviates_in_proportion_to_the_strain():
    found, deviations = soft_spectrum(CRITICAL), []
    for gamma in (1e-4, 1e-5):
        state = strain_path(CRITICAL, [gamma]).value.states[-1]
        weight = CRITICAL.sigma * CRITICAL.lengths
        tau = weight @ (state.lengths - CRITICAL.lengths) / (weight @ (weight / NETWORK.stiffness))
        exact = np.linalg.eigvalsh(hessian(state))
        deviations.append(np.abs(exact[:N_FLOPPY] / (tau * found.soft) - 1).max())
        assert exact[N_FLOPPY:] == pytest.approx(found.stiff, rel=0.2, abs=20 * gamma)
    assert deviations[0] < 1e-2
    assert deviations[0] / deviations[1] == pytest.approx(10, rel=0.1)


def test_the_coupling_lowers_soft_eigenvalues_to_second_order():
    # The Hessian R̃ᵀkR̃ + τP of the same configuration
    found, tau = soft_spectrum(CRITICAL), 1e-5
    g, L = dense_incidence(NETWORK)[:, NETWORK.free], CRITICAL.bond_vectors / CRITICAL.lengths[:, None]
    R = (g[:, :, None] * L[:, None, :]).reshape(NETWORK.n_edges, -1)
    P = np.kron(g.T @ np.diag(CRITICAL.sigma) @ g, np.eye(2))
    exact = np.linalg.eigvalsh(R.T @ (NETWORK.stiffness[:, None] * R) + tau * P)[:N_FLOPPY]
    np.testing.assert_allclose((found.soft - exact / tau) / tau, found.coupling, rtol=0.02)
    assert (found.coupling > 0).all()


def test_the_gradient_of_the_determinant_is_its_derivative():
    found = soft_spectrum(CRITICAL)
    directions = np.random.default_rng(0).standard_normal((3, NETWORK.n_edges))

    def half_log_det(sigma):
        one = MANIFOLD.configuration(sigma)
        # Of the given stress, not of the scaled one
        scale = np.linalg.norm(sigma) / np.linalg.norm(one.sigma)
        return soft_spectrum(one).log_determinant + 0.5 * N_FLOPPY * np.log(scale)

    assert_derivative(half_log_det, found.gradient, CRITICAL.sigma, directions, rtol=1e-6)
    assert found.gradient @ CRITICAL.sigma == pytest.approx(0.5 * N_FLOPPY, rel=1e-10)


def test_iterations_find_the_same_eigenvalues():
    found = soft_spectrum(CRITICAL).soft
    weak = weak_forces(CRITICAL, AngleSprings()).value
    for n in (1, 5, N_FLOPPY):
        np.testing.assert_allclose(weak.soft_eigenvalues(n), found[:n], rtol=1e-8)
    for n in (0, N_FLOPPY + 1):
        with pytest.raises(InputError, match="floppy motions"):
            weak.soft_eigenvalues(n)


def test_a_chain_under_tension_vibrates_as_a_string():
    # n edges in a line between pins: transverse eigenvalues 2 − 2 cos(πm/n) of unit σ, of one floppy motion a vertex.
    n = 6
    places = {0: [0.0, 0.0], n: [float(n), 0.0]}
    network = Network([[i, i + 1] for i in range(n)], pins=places)
    found = soft_spectrum(CriticalManifold(network).configuration(np.ones(n)))
    exact = 2 - 2 * np.cos(np.pi * np.arange(1, n) / n)
    np.testing.assert_allclose(found.soft, exact, rtol=1e-12)
    np.testing.assert_allclose(found.stiff, exact, rtol=1e-12)
    np.testing.assert_allclose(found.coupling, 0, rtol=0, atol=1e-24)
    assert found.log_determinant == pytest.approx(0.5 * np.log(n), rel=1e-12)
    assert found.least_frequency == pytest.approx(2 * np.sin(np.pi / (2 * n)), rel=1e-12)


BAD = {
    "several self-stresses": (
        lambda: soft_spectrum(CriticalManifold(lattice("triangular", 4, 4)).configuration(np.ones(48))),
        "one self-stress",
    ),
    "slack edges": (lambda: soft_spectrum(slack_lattice()[2]), "are slack"),
    "large": (lambda: soft_spectrum(optimize(voronoi_network(4000, 1), "B_0", "closed_form").value), "too large"),
}
test_bad_input_raises_one_sentence = refused(BAD)
