"""Elasticity tensors: relaxed energies, the moduli of linear response, closed forms, singular tensors, bounds."""

import numpy as np
import pytest
from problems import random_stress, triangular_lattice, voronoi_3d, with_random_stiffness

from critflow import (
    CriticalManifold,
    Deformation,
    Elasticity,
    InputError,
    Status,
    equilibrium,
    linear_response,
    spring_state,
    strain_path,
    voronoi_network,
)
from critflow.networks.deformation import strain_basis


def stretched(network, gamma=0.05, F=None):
    """A state past the transition, deformed further and relaxed."""
    critical = CriticalManifold(network).configuration(random_stress(network.n_edges, 2))
    state = strain_path(critical, [gamma]).value.states[0]
    return state if F is None else equilibrium(state.deformed(F), tolerance=1e-15).value


def compressed_lattice():
    """A triangular lattice whose springs are compressed and sheared, rigid by its bonds, with displaced vertices."""
    network, x = triangular_lattice(3, 4)
    rng = np.random.default_rng(3)
    state = spring_state(network, 1 + 0.05 * rng.standard_normal(network.n_edges), x)
    return equilibrium(state.deformed(np.array([[0.96, 0.05], [0.0, 0.97]])), tolerance=1e-15).value


STATES = {
    "tension": lambda: stretched(with_random_stiffness(voronoi_network(24, seed=1), 3)),
    "shear": lambda: stretched(voronoi_network(24, seed=2), 0.3, np.array([[1.05, 0.1], [0.0, 0.95]])),
    "compression": compressed_lattice,
    "3D": lambda: stretched(voronoi_3d(), 0.1, np.array([[1.02, 0.03, 0], [0, 1, 0.02], [0.01, 0, 0.99]])),
}


@pytest.fixture(scope="session", params=STATES)
def case(request):
    """A state and its response."""
    state = STATES[request.param]()
    response = linear_response(state)
    assert response.status is Status.ok
    return state, response


def relaxed_energy(state, F):
    return equilibrium(state.deformed(F), tolerance=1e-15, throw=False).value.energy


def second_derivative(energy, step=1e-3):
    """Central, of fourth order."""
    E = {n: energy(n * step) for n in (-2, -1, 0, 1, 2)}
    return (16 * (E[1] + E[-1]) - (E[2] + E[-2]) - 30 * E[0]) / (12 * step**2)


def test_tensor_is_the_second_derivative_of_relaxed_energies(case):
    state, response = case
    tensors, d, V = response.elasticity, state.network.dimension, state.network.volume
    rng = np.random.default_rng(0)
    for _ in range(2):
        A = rng.standard_normal((d, d))
        expected = second_derivative(lambda e, A=A: relaxed_energy(state, np.eye(d) + e * A)) / V
        assert tensors.modulus(A) == pytest.approx(expected, rel=1e-6, abs=1e-7)
    # A curved path, whose acceleration works against the stress.
    path = Deformation.exponential(A)
    expected = second_derivative(lambda e: relaxed_energy(state, path.gradient(e))) / V
    assert tensors.modulus(path) == pytest.approx(expected, rel=1e-6, abs=1e-7)


def test_tensor_gives_the_moduli_of_linear_response(case):
    state, response = case
    tensors, value, d = response.elasticity, response.value, state.network.dimension
    assert tensors.bulk == pytest.approx(value.bulk, rel=1e-12)
    assert tensors.shear == pytest.approx(value.shear, rel=1e-12)
    assert tensors.shear_stress_corrected == pytest.approx(value.shear_stress_corrected, rel=1e-12)
    assert tensors.modulus("dilation") == pytest.approx(value.bulk, rel=1e-12)
    if d == 2:
        # The worked factor: tr(E² S) = ¼ tr S = ½ dE/dV.
        assert tensors.stress_corrected[-1, -1] == pytest.approx(value.shear_stress_corrected, rel=1e-12)
    pressure = np.vdot(state.sigma, state.lengths**2) / (d * state.network.volume)
    assert np.trace(tensors.stress) == pytest.approx(d * pressure, rel=1e-12)
    # The bulk modulus of the stress increments is V d²E/dV².
    assert tensors.stress_strain[:d, :d].sum() / d**2 == pytest.approx(value.bulk, rel=1e-11)


def test_relaxations_are_linear_in_the_strain(case):
    state, response = case
    d = state.network.dimension
    dilation = response.relaxations[:d].sum(axis=0) / d
    np.testing.assert_allclose(dilation, response.relaxation, rtol=0, atol=1e-12 * np.abs(response.relaxations).max())
    # They move the bonds to the equilibrium of the strained network.
    basis, e = strain_basis(d)[1], 1e-4
    for a in (0, len(basis) - 1):
        L = [equilibrium(state.deformed(np.eye(d) + n * e * basis[a])).value.bond_vectors for n in (-1, 1)]
        expected = state.bond_vectors @ basis[a] + state.network.free_incidence @ response.relaxations[a]
        np.testing.assert_allclose((L[1] - L[0]) / (2 * e), expected, rtol=0, atol=1e-5 * np.abs(expected).max())


def test_stress_strain_tensor_is_the_change_of_stress(case):
    state, response = case
    d, e = state.network.dimension, 1e-4
    basis = strain_basis(d)[1]

    def stress(F):
        after = equilibrium(state.deformed(F), tolerance=1e-15).value
        L = after.bond_vectors
        S = (after.sigma[:, None] * L).T @ L / after.network.volume
        return np.einsum("aij,ij->a", basis, S)

    for b in (0, len(basis) - 1):
        S = {n: stress(np.eye(d) + n * e * basis[b]) for n in (-2, -1, 1, 2)}
        expected = (8 * (S[1] - S[-1]) - (S[2] - S[-2])) / (12 * e)
        np.testing.assert_allclose(response.elasticity.stress_strain[:, b], expected, rtol=0, atol=1e-6)


def test_affine_tensor_has_the_symmetry_of_central_forces(case):
    state, response = case
    tensors, L = response.elasticity, state.bond_vectors
    hdot = np.einsum("ei,aij,ej->ea", L, strain_basis(state.network.dimension)[1], L)
    expected = hdot.T @ (state.modified_stiffness[:, None] * hdot) / state.network.volume
    np.testing.assert_allclose(tensors.affine_stress_corrected, expected, rtol=0, atol=1e-13 * expected.max())
    # Cauchy: all indices may be exchanged.
    index = tensors.components.index
    assert expected[index("xx"), index("yy")] == pytest.approx(expected[index("xy"), index("xy")], rel=1e-12)
    # Vertices that follow the strain only reduce the energy.
    assert np.linalg.eigvalsh(tensors.affine_energy - tensors.energy).min() > -1e-12


def isotropic(bulk, shear, d, bounds=1e-15):
    basis = strain_basis(d)[1]
    trace = np.einsum("aii->a", basis)
    tensor = bulk * np.outer(trace, trace)
    tensor += 2 * shear * (np.einsum("aij,bij->ab", basis, basis) - np.outer(trace, trace) / d)
    return Elasticity(tensor, tensor, np.zeros((d, d)), 1.0, np.full(tensor.shape, bounds))


@pytest.mark.parametrize("d", [2, 3])
def test_isotropic_closed_forms(d):
    K, G = 0.7, 0.3
    tensors = isotropic(K, G, d)
    E, nu = (
        (9 * K * G / (3 * K + G), (3 * K - 2 * G) / (6 * K + 2 * G))
        if d == 3
        else (4 * K * G / (K + G), (K - G) / (K + G))
    )
    n, t = np.eye(d)[:2] @ np.linalg.qr(np.random.default_rng(1).standard_normal((d, d)))[0]
    assert tensors.youngs_modulus(n) == pytest.approx(E, rel=1e-13)
    assert tensors.poissons_ratio(n, t) == pytest.approx(nu, rel=1e-12)
    assert (tensors.bulk, tensors.shear) == pytest.approx((K, G), rel=1e-14)
    means = tensors.voigt_reuss_hill()
    assert (means.bulk_voigt, means.bulk_reuss, means.bulk_hill) == pytest.approx((K, K, K), rel=1e-13)
    assert (means.shear_voigt, means.shear_reuss, means.shear_hill) == pytest.approx((G, G, G), rel=1e-13)
    assert tensors.compliance[-1, -1] == pytest.approx(1 / G, rel=1e-13)
    assert tensors.modulus("uniaxial_free") == pytest.approx(E, rel=1e-13)
    assert tensors.modulus("simple_shear") == pytest.approx(G, rel=1e-13)
    assert tensors.modulus("pure_shear") == pytest.approx(4 * G, rel=1e-13)


def test_singular_tensors():
    # No bulk modulus: one soft direction, in which every uniaxial strain ends, with equal strains along all axes.
    soft = isotropic(0.0, 1.0, 2)
    assert soft.youngs_modulus([1, 0]) == 0.0
    assert soft.poissons_ratio([1, 2], [2, -1]) == pytest.approx(-1.0, rel=1e-12)
    means = soft.voigt_reuss_hill()
    assert (means.bulk_reuss, means.shear_reuss) == pytest.approx((0.0, 1.0), abs=1e-15)
    assert soft.compliance[0, 0] == np.inf and soft.compliance[0, 1] == np.inf
    assert soft.compliance[2, 2] == pytest.approx(1.0, rel=1e-13)
    # No shear modulus: a fluid in the plane; soft strains differ, but all keep the area.
    fluid = isotropic(1.0, 0.0, 2)
    assert fluid.youngs_modulus([1, 1]) == 0.0
    assert fluid.poissons_ratio([1, 0], [0, 1]) == pytest.approx(1.0, rel=1e-12)
    assert fluid.voigt_reuss_hill().shear_reuss == 0.0
    assert fluid.compliance[0, 1] == -np.inf
    # Rank one along x: stiff there, and nothing relates y to it.
    t = np.array([2.0, 0.0, 0.0])
    tensors = Elasticity(np.outer(t, t), np.outer(t, t), np.zeros((2, 2)), 1.0, np.full((3, 3), 1e-15))
    assert tensors.youngs_modulus([1, 0]) == pytest.approx(4.0, rel=1e-14)
    assert tensors.youngs_modulus([1, 1e-3]) == 0.0
    assert np.isnan(tensors.poissons_ratio([1, 0], [0, 1]))
    # Where the errors exceed the tensor, nothing is known.
    for bounds in (10.0, np.nan):
        unknown = isotropic(1.0, 1.0, 2, bounds=bounds)
        assert np.isnan(unknown.youngs_modulus([1, 0])) and np.isnan(unknown.poissons_ratio([1, 0], [0, 1]))
        assert np.isnan(unknown.voigt_reuss_hill().bulk_reuss) and np.isnan(unknown.compliance).all()


def test_bad_directions_raise():
    tensors = isotropic(1.0, 1.0, 2)
    for direction in ([0, 0], [1, 0, 0], [np.nan, 1]):
        with pytest.raises(InputError, match="direction"):
            tensors.youngs_modulus(direction)
    with pytest.raises(InputError, match="orthogonal"):
        tensors.poissons_ratio([1, 0], [1, 1])
