"""Responses against relaxed energies: checks of any springs, on edges or of an extra."""

from dataclasses import astuple

import numpy as np
import pytest
from derivatives import assert_derivative, second_derivative

from critflow import Deformation, Status, elasticity, equilibrium, stiffening, strain_path
from critflow.deformation import strain_basis
from critflow.linear_response import combined


def random_strain(dimension):
    return np.random.default_rng(0).standard_normal((dimension, dimension))


# Paths F(ε) by the dimension, and the second derivative of the energy along them.
STRAIN_PATHS = {
    "bulk": (lambda d: lambda e: (1 + e) ** (1 / d) * np.eye(d), lambda found, d: found.bulk),
    "shear": (lambda d: lambda e: np.eye(d) + e * strain_basis(d)[1][-1], lambda found, d: found.shear),
    "any strain": (
        lambda d: lambda e: np.eye(d) + e * random_strain(d),
        lambda found, d: found.modulus(random_strain(d)),
    ),
    # A curved path, whose acceleration works against the stress.
    "curved": (
        lambda d: Deformation.exponential(random_strain(d)).gradient,
        lambda found, d: found.modulus(Deformation.exponential(random_strain(d))),
    ),
}


def relaxed_energy(state, F):
    end = equilibrium(state.deformed(F), tolerance=1e-15, throw=False).value
    assert end.max_force < 1e-12
    return end.energy


def assert_moduli_of_energies(state, response, strain):
    """Along a path of `STRAIN_PATHS`."""
    path, modulus = STRAIN_PATHS[strain]
    d = state.network.dimension
    expected = second_derivative(lambda e: relaxed_energy(state, path(d)(e)), 5e-4) / state.network.volume
    assert modulus(response.value, d) == pytest.approx(expected, rel=2e-6, abs=2e-7)


def assert_stress(state, response):
    """The stress is the derivative of the energy."""
    d, found = state.network.dimension, response.value
    basis = strain_basis(d)[1]

    def energy(e):
        return relaxed_energy(state, np.eye(d) + np.einsum("a,aij->ij", e, basis)) / state.network.volume

    S = np.einsum("aij,ij->a", basis, found.stress)
    ends = np.eye(len(basis))[[0, -1]]
    assert_derivative(energy, S, np.zeros(len(basis)), ends, step=1e-4, rtol=1e-6, atol=1e-9)
    # Half of the growth of the energy with volume.
    corrected = found.shear - 0.5 * np.trace(found.stress) / d
    assert found.shear_stress_corrected == pytest.approx(corrected, rel=1e-14)


def assert_relaxations(state, response):
    """Relaxations move the bonds to the strained equilibrium."""
    d = state.network.dimension
    basis = strain_basis(d)[1]

    def bond_vectors(e):
        return equilibrium(state.deformed(np.eye(d) + np.einsum("a,aij->ij", e, basis))).value.bond_vectors

    def rates(e):
        u = combined(response.responses, response.strains, e)
        return state.bond_vectors @ np.einsum("a,aij->ij", e, basis) + state.network.free_incidence @ u

    ends = np.eye(len(basis))[[0, -1]]
    assert_derivative(bond_vectors, rates, np.zeros(len(basis)), ends, step=1e-4, rtol=1e-5)


def assert_affine(state, response):
    """Vertices that follow the strain only reduce the energy of affine motion, whose tensor (m, m) is returned."""
    found, L = response.value, state.bond_vectors
    basis = strain_basis(state.network.dimension)[1]
    hdot = np.einsum("ei,aij,ej->ae", L, basis, L)
    expected = state.resistance(hdot) @ hdot.T / state.network.volume
    # The affine tensor by the Green–Lagrange strain, C_ab − tr(E_a E_b S).
    terms = np.einsum("aij,bjk,ki->ab", basis, basis, found.stress)
    terms = 0.5 * (terms + terms.T)
    np.testing.assert_allclose(found.affine - terms, expected, rtol=0, atol=1e-13 * expected.max())
    assert np.linalg.eigvalsh(found.affine - found.tensor).min() > -1e-12
    return expected


def assert_limit_of_paths(critical, deformation, **law):
    """Exact coefficients are limits of strain paths, and their moduli those at the transition.

    law  of springs that have one
    """
    solution, moduli = stiffening(critical, deformation=deformation, **law), elasticity(critical).value
    assert solution.status is Status.ok
    exact = solution.value
    assert 0 < min(astuple(solution.stats.error_bound)) and max(astuple(solution.stats.error_bound)) < 1e-12
    # The transition does not depend on the law.
    assert (exact.bulk_0, exact.shear_0) == pytest.approx((moduli.bulk, moduli.shear), rel=1e-11)
    assert exact.modulus_0 == pytest.approx(moduli.modulus(deformation), rel=1e-11)
    h = (-1e-4 if solution.loosening else 1e-4) * np.array([1, 2, 4, 8])
    path = strain_path(critical, h, deformation=deformation, **law).value
    for values, start, C in (
        (path.bulk_modulus, exact.bulk_0, exact.C_B),
        (path.shear_modulus, exact.shear_0, exact.C_G),
        (path.shear_modulus_stress_corrected, exact.shear_0, exact.C_G_stress_corrected),
        (path.modulus, exact.modulus_0, exact.C),
    ):
        # Difference quotients have errors in h, h², h³; three eliminations leave h⁴.
        table = (values - start) / h
        for order in (1, 2, 3):
            table = (2**order * table[:-1] - table[1:]) / (2**order - 1)
        assert table[0] == pytest.approx(C, abs=1e-7 * max(abs(C), 1.0))
