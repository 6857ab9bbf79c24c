"""Configurations under tensions and pressures, their derivatives, and what positions determine."""

import mpmath as mp
import numpy as np
import pytest
from derivatives import assert_derivative
from problems import face_areas

from critflow import (
    CriticalManifold,
    InputError,
    Status,
    elasticity,
    lattice,
    nearest_critical,
    strain_path,
    voronoi_network,
)
from critflow.extras.tissue.pressures import PressureManifold, unbalanced_forces


def loaded(n_vertices=20, seed=1, size=0.1):
    """A network with random stresses and pressures."""
    network, rng = voronoi_network(n_vertices, seed), np.random.default_rng(seed)
    return (
        network,
        np.exp(0.3 * rng.standard_normal(network.n_edges)),
        size * rng.standard_normal(network.faces.n_faces),
    )


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


def test_planted_tensions_and_pressures_are_recovered():
    deviations = []
    for seed in range(50):
        network, sigma, pressures = loaded(20, seed, 0.05)
        planted = CriticalManifold(network).configuration(sigma, pressures)
        noise = 1e-9 * np.random.default_rng(seed).standard_normal(planted.coordinates.shape)
        found = nearest_critical(network, planted.coordinates + noise, 1e-9, pressures=True)
        assert found.distance < 1e-10
        deviations.append((found.value.sigma - planted.sigma) / found.stress_error)
        deviations.append((found.value.pressures - planted.pressures) / found.pressure_error)
    deviation = np.concatenate(deviations)
    # Standard errors: a mean square of one, with few independent numbers a network, and no far outlier.
    assert np.mean(deviation**2) == pytest.approx(1, abs=0.15)
    assert np.abs(deviation).max() < 5


def test_what_pressures_cannot_serve_is_refused():
    network, sigma, pressures = loaded()
    value = CriticalManifold(network).configuration(sigma, pressures)
    for call in (
        lambda: elasticity(value),
        lambda: strain_path(value, [0.01]),
        lambda: CriticalManifold(network).configuration(sigma, pressures[1:]),
        lambda: CriticalManifold(lattice("cubic", 2, 2, 2)).configuration(np.ones(24), np.ones(3)),
        lambda: nearest_critical(lattice("square", 3, 3), lattice("square", 3, 3).positions, pressures=True),
        lambda: nearest_critical(network, network.positions, start=sigma, pressures=True),
    ):
        with pytest.raises(InputError, match=r"pressure|three edges"):
            call()


def test_singular_balance_has_no_coordinates():
    network, sigma, pressures = loaded(8)
    manifold = PressureManifold(network)
    low, high = 1.0, 100.0
    for _ in range(80):  # Where the inertia changes.
        middle = (low + high) / 2
        low, high = (middle, high) if not manifold.solve(sigma, middle * pressures).negative_pivots else (low, middle)
    found = manifold.solve(sigma, low * pressures)
    assert found.status is Status.ill_conditioned and np.isnan(found.value.coordinates).all()


def test_standard_errors_are_those_of_differences():
    network, sigma, pressures = loaded(8)
    x = CriticalManifold(network).configuration(sigma, pressures).coordinates
    found, columns = nearest_critical(network, x, 1.0, pressures=True), []
    for entry in np.ndindex(x.shape):
        step = np.zeros_like(x)
        step[entry] = 1e-5
        ends = [nearest_critical(network, x + sign * step, pressures=True).value for sign in (1, -1)]
        # The scale of the standard errors: Σσ is kept.
        ends = [np.concatenate([end.sigma, end.pressures]) * found.value.sigma.sum() / end.sigma.sum() for end in ends]
        columns.append((ends[0] - ends[1]) / 2e-5)
    spread = np.linalg.norm(columns, axis=0)
    assert np.concatenate([found.stress_error, found.pressure_error]) == pytest.approx(spread, rel=1e-5)
