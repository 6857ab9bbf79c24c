"""Regular lattices: geometry, counts of stresses and modes, and moduli against closed forms."""

from math import gcd

import numpy as np
import pytest
from lattices import CASES, LATTICES

from critflow import lattice, optimize, upper_bound
from critflow.self_stress import Spectrum

SELF_STRESSES = {
    "honeycomb": lambda *n: 1,
    "square": lambda m, n: m + n,
    "triangular": lambda m, n: m * n + 2,
    # Lines parallel to the two sides of the cell, and diagonal ones, which close after winding around both.
    "kagome": lambda m, n: m + n + gcd(m, n),
    "diamond": lambda *n: 1,
    "cubic": lambda m, n, o: m * n + n * o + o * m,
}


@pytest.mark.parametrize("name, size", CASES)
def test_geometry(name, size):
    _, degree, vertices, volume, *_ = LATTICES[name]
    network = lattice(name, *size, edge_length=0.4)
    n_cells = int(np.prod(size))
    assert network.n_vertices == vertices * n_cells
    assert network.n_edges == degree * vertices * n_cells // 2
    np.testing.assert_array_equal(np.bincount(network.edges.ravel()), np.full(network.n_vertices, degree))
    lengths = np.linalg.norm(network.bond_vectors(network.positions), axis=1)
    np.testing.assert_allclose(lengths, 0.4, rtol=1e-13)
    assert network.volume == pytest.approx(volume * n_cells * 0.4 ** len(size), rel=1e-13)


@pytest.mark.parametrize("name, size", CASES)
def test_counts(name, size):
    network = lattice(name, *size)
    found = Spectrum(network, network.positions)
    expected = SELF_STRESSES[name](*size)
    assert found.n_self_stresses == expected
    # Maxwell–Calladine.
    assert found.n_motions == network.dimension * (network.n_vertices - 1) - network.n_edges + expected
    _, smallest_nonzero = found.null_space(expected, of_stresses=True)[1]
    assert smallest_nonzero > 1e-2


@pytest.mark.parametrize("name, size", CASES)
@pytest.mark.parametrize("edge_length", [1.0, 0.4])
def test_the_largest_bulk_modulus_is_that_of_the_lattice(name, size, edge_length):
    *_, bulk, _ = LATTICES[name]
    network = lattice(name, *size, edge_length=edge_length)
    unit = edge_length ** (2 - network.dimension)
    # Bravais lattices of any kind with one edge length are at the largest B_0 of their topology.
    assert upper_bound(network, "B_0") == pytest.approx(bulk * unit, rel=1e-12)
    assert optimize(network, "bulk_modulus").objective == pytest.approx(bulk * unit, rel=1e-12)
