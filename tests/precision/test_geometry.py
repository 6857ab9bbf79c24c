"""Bond vectors and force sums in extended precision against rational numbers."""

from fractions import Fraction

import numpy as np
import pytest
from problems import NETWORKS, random_stress
from rationals import DIGITS, exact, fractions

from critflow.double_double import extended, lengths, multiply, two_sum
from critflow.refinement import ExtendedGeometry, exact_bond_vectors, exact_forces


@pytest.mark.parametrize("name", ["voronoi", "voronoi 3D", "own images", "pinned grid", "sheared"])
def test_bond_vectors_and_residuals(name):
    network = NETWORKS[name]()
    rng = np.random.default_rng(3)
    geometry, b = ExtendedGeometry(network), network.boundary_vectors
    shape, sigma = (len(network.free), network.dimension), random_stress(network.n_edges, 5)
    if name == "own images":
        # A large stress of an edge from a vertex to an image of itself, which pulls at nothing.
        sigma[6] = 1e12
    high = 5 * rng.standard_normal(shape)
    x = two_sum(high, 1e-17 * rng.standard_normal(shape))
    g = fractions(network.free_incidence.toarray())
    L = geometry.bond_vectors(x, b)
    expected = g @ exact(x) + fractions(b)
    size = Fraction(float(2 * np.abs(high).max() + np.abs(b).max()))
    assert np.abs(exact(L) - expected).max() <= DIGITS * size
    force = geometry.divergence(multiply(extended(sigma[:, None]), L))
    weight = fractions(abs(network.divergence) @ sigma)[:, None]
    assert (np.abs(exact(force) - g.T @ (fractions(sigma)[:, None] * expected)) <= DIGITS * size * weight).all()
    found = exact(lengths(L)) ** 2
    assert (np.abs(found - (expected**2).sum(axis=1)) <= DIGITS * (found + size * size)).all()


@pytest.mark.parametrize("name", ["voronoi", "voronoi 3D", "own images", "pinned grid"])
def test_displacements_below_the_rounding_of_coordinates(name):
    network = NETWORKS[name]()
    rng = np.random.default_rng(4)
    x = 5 * rng.standard_normal((network.n_vertices, network.dimension))
    D = 1e-17 * rng.standard_normal((len(network.free), network.dimension))
    L = exact_bond_vectors(network, x, D)
    at = fractions(x)
    if network.pins:
        at[list(network.pins)] = 0
    moved = at.copy()
    moved[network.free] += fractions(D)
    tail, head = network.edges.T
    expected = moved[head] - moved[tail] + fractions(network.boundary_vectors)
    assert np.abs(exact(L) - expected).max() <= DIGITS * 100
    sigma = random_stress(network.n_edges, 5)
    g = fractions(network.free_incidence.toarray())
    force = -g.T @ (fractions(sigma)[:, None] * expected)
    # The rounding of the result, and of the sums of low parts, 2⁻²⁵ of the largest term.
    found, terms = fractions(exact_forces(network, sigma, L)), np.abs(fractions(sigma)[:, None] * expected).max()
    assert (np.abs(found - force) <= Fraction(2) ** -53 * np.abs(force) + Fraction(2) ** -77 * terms).all()
