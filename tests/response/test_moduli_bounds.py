"""Error bounds of moduli at the transition."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from problems import NETWORKS

from critflow import (
    CriticalManifold,
    Network,
    honeycomb_network,
    transition_bounds,
    transition_moduli,
    voronoi_network,
)

NETWORK = voronoi_network(12, seed=1)


def test_no_bound_with_errors_as_large_as_lengths():
    exactly = CriticalManifold(voronoi_network(20, seed=1)).configuration(np.ones(30))
    for share, known in ((0.1, True), (0.5, False), (3.0, False)):
        bounds = transition_bounds(replace(exactly, bond_errors=share * exactly.lengths))
        assert bounds.bulk > 0 and np.isfinite(bounds.bulk) == known


def test_vanishing_modulus_has_a_second_order_bound():
    critical = CriticalManifold(honeycomb_network(3, 3)).configuration(np.ones(27))
    assert 0 <= transition_moduli(critical).shear <= transition_bounds(critical).shear < 1e-30


@pytest.mark.parametrize("name, floor", [("voronoi", 0.0), ("honeycomb", 1e-20)])
def test_bond_vector_errors_propagate_to_moduli(name, floor):
    # Errors of 10⁻⁶ in bond vectors change the moduli to first order, and the shear modulus of a honeycomb, which
    # is zero, to second.
    network = NETWORKS[name]()
    exactly = CriticalManifold(network).configuration(np.ones(network.n_edges))
    before = transition_moduli(exactly)
    for seed in range(5):
        off = 1e-6 * np.random.default_rng(seed).standard_normal(exactly.bond_vectors.shape)
        errors = (1 + 1e-9) * np.linalg.norm(off, axis=1)
        moved = replace(exactly, bond_vectors=exactly.bond_vectors + off, bond_errors=errors)
        after = transition_moduli(moved)
        # The bound applies to either of the two.
        for bounds in (transition_bounds(moved), transition_bounds(replace(exactly, bond_errors=errors))):
            assert abs(after.bulk - before.bulk) <= bounds.bulk < 1e-5
            assert floor < abs(after.shear - before.shear) <= bounds.shear < 1e-5


def test_configurations_without_bounds_have_nan():
    critical = CriticalManifold(NETWORK).configuration(np.ones(18))
    plain = type(critical)(NETWORK, critical.sigma, critical.coordinates, critical.bond_vectors)
    assert np.isnan(plain.error_bound) and np.isnan(plain.bond_errors).all()
    assert np.isnan(transition_bounds(plain).bulk)


@pytest.mark.parametrize("unit", [1e-12, 1.3e-9, 1.0, 7.0, 1e9])
def test_bounds_hold_in_any_unit_of_length(unit):
    # Of unit length B_0 is the same number; V is the determinant in exact arithmetic.
    network = Network(NETWORK.edges, NETWORK.offsets, unit * NETWORK.cell)
    critical = CriticalManifold(network).configuration(np.ones(18))
    (a, b), (c, d) = [[Fraction(float(entry)) for entry in row] for row in network.cell]
    sigma = [Fraction(float(s)) for s in critical.sigma]
    square = [sum(Fraction(float(x)) ** 2 for x in L) for L in critical.bond_vectors]
    work = sum(s * h for s, h in zip(sigma, square, strict=True))
    cost = sum(s**2 * h for s, h in zip(sigma, square, strict=True))
    exactly = work**2 / (4 * abs(a * d - b * c) * cost)
    error = abs(Fraction(transition_moduli(critical).bulk) - exactly)
    assert error <= transition_bounds(critical).bulk < 1e-14
