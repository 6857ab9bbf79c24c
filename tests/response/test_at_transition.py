"""Moduli at the transition: the formula, limits of straining, tensors of rank one, parts, and their errors."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from problems import (
    NETWORKS,
    UNPINNED,
    critical_of,
    modulus_by_formula,
    random_stress,
    slack_lattice,
    taut_rows,
    with_random_stiffness,
)

from critflow import CriticalManifold, Network, Status, elasticity, lattice, strain_path, voronoi_network
from critflow.deformation import strain_basis
from critflow.quantities import dilation, pure_shear, transition_modulus_error
from critflow.taut_part import backbone


@pytest.mark.parametrize("name", UNPINNED)
def test_transition_moduli_by_two_methods(name):
    critical = critical_of(UNPINNED[name](), 2)
    network, d = critical.network, critical.network.dimension
    found = elasticity(critical).value
    # By the formula, edge by edge.
    s, L = critical.sigma, critical.bond_vectors
    assert found.bulk == pytest.approx(modulus_by_formula(network, s, L, dilation(d)), rel=1e-13)
    assert found.shear == pytest.approx(modulus_by_formula(network, s, L, pure_shear(d)), rel=1e-10)
    # By relaxed energies at four small strains, extrapolated to none: a cubic through 2E/Vγ² leaves γ⁴.
    gamma = np.array([1, 2, 3, 4]) * 2.5e-4
    ratio = 2 * strain_path(critical, gamma, measure="energy").value.energy / (network.volume * gamma**2)
    assert np.polyfit(gamma, ratio, 3)[-1] == pytest.approx(found.bulk, rel=1e-6)


@pytest.mark.parametrize("name", ["2D", "2D, random stiffness", "3D"])
def test_transition_tensor_has_rank_one(name):
    critical = critical_of(UNPINNED[name](), 5)
    solution, d, V = elasticity(critical), critical.network.dimension, critical.network.volume
    found = solution.value
    assert solution.status is Status.ok and solution.n_self_stresses == 1
    # C = S ⊗ S/(V D) with S = Σ σ L ⊗ L and D = Σ σ²|L|²/k.
    L, sigma = critical.bond_vectors, critical.sigma
    S = np.einsum("aij,ij->a", strain_basis(d)[1], (sigma[:, None] * L).T @ L)
    D = sigma**2 @ (critical.lengths**2 / critical.network.stiffness)
    np.testing.assert_allclose(found.tensor, np.outer(S, S) / (V * D), rtol=0, atol=1e-13)


# Parts


def test_slack_edges_do_not_change_the_moduli_of_the_taut_part():
    network, _, critical = slack_lattice()
    part, found = backbone(critical), elasticity(critical).value
    assert found.bulk == elasticity(part.configuration).value.bulk
    formula = modulus_by_formula(network, critical.sigma, critical.bond_vectors, np.eye(2) / 2)
    assert found.bulk == pytest.approx(formula, rel=1e-13)
    assert 0 < found.errors.bulk < 1e-14


def test_the_moduli_of_disconnected_taut_parts_add_up():
    # Each of n rows of n springs has stiffness 1/n and the elongation nγ/2: B = 1/4; rows do not resist shear.
    critical = replace(taut_rows(4), bond_errors=np.full(32, 1e-16))
    found = elasticity(critical).value
    assert (found.bulk, found.shear) == (pytest.approx(0.25, rel=1e-14), pytest.approx(0.0, abs=1e-30))
    assert 0 < found.errors.bulk < 1e-14 and found.errors.tensor.shape == (3, 3)


# Errors


def test_no_error_is_known_where_bond_vectors_may_be_off_by_their_lengths():
    exactly = CriticalManifold(voronoi_network(20, seed=1)).configuration(np.ones(30))
    for share, finite in ((0.1, True), (0.5, False), (3.0, False)):
        error = elasticity(replace(exactly, bond_errors=share * exactly.lengths)).value.errors.bulk
        assert error > 0 and np.isfinite(error) == finite
    plain = type(exactly)(exactly.network, exactly.sigma, exactly.coordinates, exactly.bond_vectors)
    assert np.isnan(plain.error_bound) and np.isnan(elasticity(plain).value.errors.bulk)


def test_errors_do_not_depend_on_the_unit_of_stress():
    # Large errors of bond vectors, so that the terms of second order count.
    exactly = CriticalManifold(with_random_stiffness(voronoi_network(20, seed=1), 2)).configuration(
        random_stress(30, 1)
    )
    exactly = replace(exactly, bond_errors=0.1 * exactly.lengths)
    errors = elasticity(exactly).value.errors.tensor
    assert np.isfinite(errors).all()
    for unit in (0.25, 16.0):
        there = elasticity(replace(exactly, sigma=unit * exactly.sigma)).value.errors.tensor
        np.testing.assert_allclose(there, errors, rtol=1e-12)


def test_vanishing_modulus_has_a_second_order_error():
    found = elasticity(CriticalManifold(lattice("honeycomb", 3, 3)).configuration(np.ones(27))).value
    assert 0 <= found.shear <= found.errors.shear < 1e-30


@pytest.mark.parametrize("name, floor", [("voronoi", 0.0), ("honeycomb", 1e-20)])
def test_bond_vector_errors_propagate_to_moduli(name, floor):
    # Errors of 10⁻⁶ in bond vectors change the moduli to first order, and the shear modulus of a honeycomb, which
    # is zero, to second.
    network = NETWORKS[name]()
    exactly = CriticalManifold(network).configuration(np.ones(network.n_edges))
    before = elasticity(exactly).value
    for seed in range(5):
        off = 1e-6 * np.random.default_rng(seed).standard_normal(exactly.bond_vectors.shape)
        errors = (1 + 1e-9) * np.linalg.norm(off, axis=1)
        after = elasticity(replace(exactly, bond_vectors=exactly.bond_vectors + off, bond_errors=errors)).value
        # The errors apply to either of the two.
        for known in (after.errors, elasticity(replace(exactly, bond_errors=errors)).value.errors):
            assert abs(after.bulk - before.bulk) <= known.bulk < 1e-5
            assert floor < abs(after.shear - before.shear) <= known.shear < 1e-5
            assert (np.abs(after.tensor - before.tensor) <= known.tensor).all()


@pytest.mark.parametrize("unit", [1e-12, 1.3e-9, 1.0, 7.0, 1e9])
def test_errors_hold_in_any_unit_of_length(unit):
    # Of unit length B_0 is the same number; V is the determinant in exact arithmetic.
    plain = voronoi_network(12, seed=1)
    network = Network(plain.edges, plain.offsets, unit * plain.cell)
    critical = CriticalManifold(network).configuration(np.ones(18))
    (a, b), (c, d) = [[Fraction(float(entry)) for entry in row] for row in network.cell]
    sigma = [Fraction(float(s)) for s in critical.sigma]
    square = [sum(Fraction(float(x)) ** 2 for x in L) for L in critical.bond_vectors]
    work = sum(s * h for s, h in zip(sigma, square, strict=True))
    cost = sum(s**2 * h for s, h in zip(sigma, square, strict=True))
    found = elasticity(critical).value
    error = abs(Fraction(found.bulk) - work**2 / (4 * abs(a * d - b * c) * cost))
    assert error <= found.errors.bulk < 1e-14


def test_an_error_across_the_strain_counts_by_its_square():
    # A straight chain along x does no work on ε_yy, and to first order none when its bonds turn by an error e.
    chain, e = Network([[0, 1], [1, 0]], [[0, 0], [1, 0]], np.eye(2)), 1e-2
    critical = replace(CriticalManifold(chain).configuration(np.ones(2)), bond_errors=np.full(2, e))
    sigma, L = critical.sigma, critical.bond_vectors + np.array([0, e])
    moved = np.sum(sigma * L[:, 1] ** 2) ** 2 / np.sum(sigma**2 * np.sum(L**2, axis=1))
    error = transition_modulus_error(np.diag([0.0, 1.0]), critical)
    assert moved < error < 4 * moved


@pytest.mark.parametrize("name", ["voronoi, random stiffness", "oblique", "voronoi 3D"])
def test_errors_of_the_tensor_are_those_of_its_moduli(name):
    # One strain alone has a modulus; two are half the difference of squares of sums.
    critical = critical_of(NETWORKS[name](), 2)
    found, basis = elasticity(critical).value, strain_basis(critical.network.dimension)[1]
    single = [transition_modulus_error(strain, critical) for strain in basis]
    rounding = 8 * np.finfo(float).eps * np.abs(found.tensor)
    np.testing.assert_allclose(np.diag(found.errors.tensor), single + np.diag(rounding), rtol=1e-12, atol=0)
    both = transition_modulus_error(basis[0] + basis[1], critical)
    expected = 0.5 * (both + single[0] + single[1]) + rounding[0, 1]
    assert found.errors.tensor[0, 1] == found.errors.tensor[1, 0] == pytest.approx(expected, rel=1e-12, abs=0)
