"""Frameworks of the literature with known order of rigidity, at their special positions and next to them."""

import numpy as np
import pytest
from frameworks import (
    bipartite_on_conic,
    bipartite_on_quadric,
    bricard,
    cauchy_polygon,
    desargues,
    desargues_parallel,
    dixon,
    double_banana,
    double_watt,
    grounded,
    octahedron,
    pinned_at_one,
    snelson_prism,
    twisted_kagome,
)

from critflow import Status, lattice
from critflow.manifold import critical_configuration
from critflow_extras import stability
from critflow_extras.tensegrity.second_order import second_order_rigidity
from critflow_extras.tensegrity.signed_stress import signed_stress


def kagome(columns):
    network = lattice("kagome", columns, columns)
    return network, network.positions


# Orders of rigidity: to first order, prestress stable, flexible to second order.
FIRST, PRESTRESS, FLEXIBLE = (True, True, True), (False, True, True), (False, False, False)

# Name: builder, self-stresses and flexes, order of rigidity; the last two again in general position nearby.
FRAMEWORKS = {
    # Two rigid bodies with a common hinge: dependent although the edges suffice.
    "double banana": (lambda: grounded(*double_banana()), (1, 1), FLEXIBLE, (1, 1), FLEXIBLE),
    # Triangles in perspective from a point (Desargues), finite, at infinity, and a translation.
    "perspective triangles": (lambda: grounded(*desargues()), (1, 1), PRESTRESS, (0, 0), FIRST),
    "parallel bars": (lambda: grounded(*desargues_parallel((1, 1.4, 0.8))), (1, 1), PRESTRESS, (0, 0), FIRST),
    "parallel and equal bars": (lambda: grounded(*desargues_parallel()), (1, 1), FLEXIBLE, (0, 0), FIRST),
    # Bolker and Roth (1980): bipartite frameworks are dependent on quadrics.  Dixon (1899): one is a mechanism.
    "K(3,3) on a conic": (lambda: grounded(*bipartite_on_conic()), (1, 1), PRESTRESS, (0, 0), FIRST),
    "K(4,6) on a quadric": (lambda: grounded(*bipartite_on_quadric()), (1, 1), PRESTRESS, (0, 0), FIRST),
    "K(3,3) on two lines": (lambda: grounded(*dixon()), (1, 1), FLEXIBLE, (0, 0), FIRST),
    # Cauchy (1813), Bricard (1897).
    "convex octahedron": (lambda: grounded(*octahedron()), (0, 0), FIRST, (0, 0), FIRST),
    "octahedron with a half-turn": (lambda: grounded(*bricard("line")), (1, 1), FLEXIBLE, (0, 0), FIRST),
    "octahedron with a mirror": (lambda: grounded(*bricard("plane")), (1, 1), FLEXIBLE, (0, 0), FIRST),
    # Connelly and Servatius (1994): flexible, with a cusp of the motion, or a smooth one.
    "cusp": (lambda: double_watt(True), (1, 2), FLEXIBLE, (0, 1), FLEXIBLE),
    "smooth copies": (lambda: double_watt(False), (1, 2), FLEXIBLE, (0, 1), FLEXIBLE),
    # Tensegrities: Snelson's prism, Connelly's polygons (1982).
    "prism": (lambda: grounded(*snelson_prism()[:2]), (1, 1), PRESTRESS, (0, 0), FIRST),
    "hexagon": (lambda: grounded(*cauchy_polygon(6)[:2]), (1, 0), FIRST, (1, 0), FIRST),
    # Lines of the kagome lattice, 3n, are stressed alone; twisted, it has no zero mode (Sun et al., 2012).
    "kagome, 1 cell": (lambda: kagome(1), (3, 1), PRESTRESS, (2, 0), FIRST),
    "kagome, 9 cells": (lambda: kagome(3), (9, 7), PRESTRESS, (2, 0), FIRST),
    "twisted kagome": (lambda: twisted_kagome(3, 0.3), (2, 0), FIRST, (2, 0), FIRST),
}


def order(solution):
    value = solution.value
    return value.first_order_rigid, value.prestress_stable, value.second_order_rigid


def counts(solution):
    found = solution.value.counts
    return found.n_self_stresses, found.n_zero_modes - found.n_trivial


@pytest.mark.parametrize("name", FRAMEWORKS)
def test_order_of_rigidity(name):
    make, expected_counts, expected_order, _, _ = FRAMEWORKS[name]
    network, x = make()
    solution = second_order_rigidity(network, x)
    assert counts(solution) == expected_counts
    assert order(solution) == expected_order
    escape = solution.value.escape
    if expected_order is FLEXIBLE:
        # The motion stretches no edge, and no self-stress resists it.
        stretch = network.incidence @ escape
        np.testing.assert_allclose(np.sum(stretch * network.bond_vectors(x), axis=1), 0.0, rtol=0, atol=1e-12)
        forms = solution.value.counts.self_stresses @ np.sum(stretch**2, axis=1)
        if solution.value.counts.self_stresses.size:
            np.testing.assert_allclose(forms, 0.0, rtol=0, atol=1e-9)


@pytest.mark.parametrize("name", FRAMEWORKS)
def test_next_to_the_special_position_no_wrong_order_is_certain(name):
    make, special_counts, special, general_counts, general = FRAMEWORKS[name]
    network, x = make()
    away = np.zeros_like(x)
    away[network.free] = np.random.default_rng(5).standard_normal((len(network.free), network.dimension))
    undecided = 0
    for distance in 10.0 ** np.arange(-14, -2):
        solution = second_order_rigidity(network, x + distance * away)
        if solution.status is Status.undecided:
            undecided += 1
        elif distance > 1e-11 or order(solution) != special:
            assert (counts(solution), order(solution)) == (general_counts, general), distance
        else:
            # Special to rounding.
            assert counts(solution) == special_counts
    assert undecided >= 4 if special_counts != general_counts else undecided == 0
    # A tolerance of the caller decides, where no motion has to be shown.
    if special is PRESTRESS:
        assert order(second_order_rigidity(network, x + 1e-9 * away, tolerance=1e-6)) == special


def stressed(edges, x, signs):
    network = pinned_at_one(edges, x)
    return signed_stress(network, x, signs).value.critical


@pytest.mark.parametrize(
    "make", [snelson_prism, *(lambda n=n: cauchy_polygon(n) for n in (4, 5, 6, 8))], ids="prism 4 5 6 8".split()
)
def test_super_stable_tensegrities(make):
    edges, x, signs = make()
    result = stability(stressed(edges, x, signs))
    assert result.ok and result.super_stable and result.n_negative == 0
    # With cables and struts exchanged no eigenvalue is positive.
    turned = stability(stressed(edges, x, -signs))
    assert turned.super_stable is False and turned.n_negative > 0


@pytest.mark.parametrize("columns", [1, 3])
def test_stressed_kagome_lattices_are_super_stable(columns):
    network, x = kagome(columns)
    result = stability(critical_configuration(network, np.ones(network.n_edges), x))
    assert result.ok and result.super_stable and result.prestress_stable
