"""Configurations under tensions and pressures, their derivatives."""

import mpmath as mp
import numpy as np
import pytest
from derivatives import assert_derivative
from problems import face_areas
from tissue_patches import loaded

from critflow import (
    CriticalManifold,
    InputError,
    Network,
    Status,
    elasticity,
    lattice,
    strain_path,
)
from critflow_extras.tissue.pressures import PressureManifold, unbalanced_forces


def exact_coordinates(network, sigma, pressures):
    """The configuration in 50 digits: gᵀ(σ ∘ L) + (i/2)|g|ᵀ(q ∘ L) = 0 for complex bond vectors L = g z + b."""
    faces, g = network.faces, network.free_incidence.toarray().astype(int)
    owner = np.repeat(np.arange(faces.n_faces), faces.sizes)
    x = np.full((network.n_vertices, 2), mp.mpf(0))
    with mp.workdps(50):
        q = [mp.mpf(0)] * network.n_edges
        for edge, sign, face in zip(faces.edges, faces.signs, owner, strict=True):
            q[edge] += int(sign) * mp.mpf(pressures[face])
        b = mp.matrix([mp.mpc(*row) for row in network.boundary_vectors.tolist()])
        pulled = mp.matrix(g.T.tolist()) * mp.diag([mp.mpf(s) for s in sigma])
        balance = pulled + mp.mpc(0, 0.5) * mp.matrix(abs(g).T.tolist()) * mp.diag(q)
        z = mp.lu_solve(balance * mp.matrix(g.tolist()), -balance * b)
        x[network.free] = [[w.real, w.imag] for w in z]
    return x


@pytest.mark.parametrize("seed", range(4))
def test_error_estimate_holds_against_fifty_digits(seed):
    network, sigma, pressures = loaded(8, seed)
    value = CriticalManifold(network).configuration(sigma, pressures)
    exact = exact_coordinates(network, value.sigma, value.pressures)
    with mp.workdps(50):
        error = float(abs(value.coordinates - exact).max())
    assert 0 < error <= value.error_bound < 1e-14
    # Refined in extended precision, coordinates are the exact ones, rounded once.
    np.testing.assert_array_equal(value.coordinates, exact.astype(float))


def test_forces_are_gradients_of_stress_and_areas():
    network, sigma, pressures = loaded()
    x = network.positions
    force = unbalanced_forces(network, sigma, pressures, network.bond_vectors(x))

    def energy(x):
        L = network.bond_vectors(x)
        return 0.5 * sigma @ np.sum(L**2, axis=1) - pressures @ face_areas(network.faces, L)

    for vertex, axis in ((1, 0), (1, 1), (7, 0), (13, 1)):
        step = np.zeros_like(x)
        step[vertex, axis] = 1e-3  # The energy is quadratic.
        slope = (energy(x + step) - energy(x - step)) / 2e-3
        assert slope == pytest.approx(-force[vertex - 1, axis], abs=1e-11)


def test_equal_pressures_change_nothing():
    network, sigma, pressures = loaded()
    manifold = CriticalManifold(network)
    plain = manifold.configuration(sigma)
    assert manifold.configuration(sigma, 0 * pressures + 3.0).coordinates == pytest.approx(plain.coordinates, abs=1e-14)
    pressurised = manifold.configuration(sigma, pressures)
    assert np.abs(pressurised.coordinates - plain.coordinates).max() > 0.01
    assert pressurised.residual < 1e-14
    assert face_areas(network.faces, pressurised.bond_vectors).sum() == pytest.approx(network.volume)


def test_pull_back_is_the_gradient_by_stress_and_pressure():
    network, sigma, pressures = loaded()
    rng, manifold, m = np.random.default_rng(2), PressureManifold(network), network.n_edges
    weights = rng.standard_normal((m, 2))
    x = np.concatenate([sigma, pressures])
    gradient = np.concatenate(manifold.balance(sigma, pressures).pull_back(0 * sigma, weights))

    def value(x):
        return np.sum(weights * manifold.balance(x[:m], x[m:]).bond_vectors)

    assert_derivative(value, gradient, x, [rng.standard_normal(len(x))], 2e-3, 1e-7)


def test_inertia_counts_the_negative_eigenvalues():
    network, sigma, pressures = loaded()
    manifold = PressureManifold(network)
    for scale in (1.0, 30.0, 100.0):
        g, q = network.free_incidence.toarray(), scale * manifold.jumps @ pressures
        matrix = g.T @ (sigma[:, None] * g) + 0.5j * abs(g).T @ (q[:, None] * network.free_incidence.toarray())
        matrix -= np.diag(np.diag(matrix).imag) * 1j
        negative = int(np.sum(np.linalg.eigvalsh((matrix + matrix.conj().T) / 2) < 0))
        assert manifold.solve(sigma, scale * pressures).negative_pivots == negative


def test_what_pressures_cannot_serve_is_refused():
    network, sigma, pressures = loaded()
    value = CriticalManifold(network).configuration(sigma, pressures)
    for call in (
        lambda: elasticity(value),
        lambda: strain_path(value, [0.01]),
        lambda: CriticalManifold(network).configuration(sigma, pressures[1:]),
        lambda: CriticalManifold(lattice("cubic", 2, 2, 2)).configuration(np.ones(24), np.ones(3)),
    ):
        with pytest.raises(InputError, match=r"pressure|three edges"):
            call()
    # Positions without faces: the remedy is the call that finds them.
    square = np.array([[0, 0], [1, 0], [1, 1], [0, 1], [0.5, 0.5]])
    edges = [[0, 4], [1, 4], [2, 4], [3, 4], [0, 1], [1, 2], [2, 3], [3, 0]]
    bare = Network(edges, pins={0: square[0], 2: square[2]}, positions=square)
    with pytest.raises(InputError, match="network_from"):
        CriticalManifold(bare).configuration(np.ones(8), np.zeros(4))


def test_singular_balance_has_no_coordinates():
    network, sigma, pressures = loaded(8)
    manifold = PressureManifold(network)
    low, high = 1.0, 100.0
    for _ in range(80):  # Where the inertia changes.
        middle = (low + high) / 2
        low, high = (middle, high) if not manifold.solve(sigma, middle * pressures).negative_pivots else (low, middle)
    found = manifold.solve(sigma, low * pressures)
    assert found.status is Status.ill_conditioned and np.isnan(found.value.coordinates).all()
