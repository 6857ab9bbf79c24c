"""Regular lattices: geometry, counts of stresses and modes, and moduli against closed forms."""

from math import gcd

import numpy as np
import pytest

from critflow import elasticity, lattice, optimize, rigidity, upper_bound

SQRT3 = np.sqrt(3.0)

# Sizes, edges a vertex, vertices and volume a unit cell, B and G of springs of length and stiffness 1 at rest.
# B and G: isotropic lattices by Cauchy's Lamé constants (triangular: λ = μ = √3/4; kagome: half of it), the others by
# their self-stresses: straight lines resist B with k/2 (square) and k/3 (cubic) and no shear.
PLANE, SOLID = [(1, 2), (2, 1), (2, 2), (3, 2), (4, 6)], [(1, 1, 2), (2, 2, 2), (2, 3, 4)]
LATTICES = {
    "honeycomb": ([(1, 1), *PLANE], 3, 2, 1.5 * SQRT3, SQRT3 / 6, 0.0),
    "square": (PLANE, 4, 1, 1.0, 1 / 2, 0.0),
    "triangular": (PLANE, 6, 1, SQRT3 / 2, SQRT3 / 2, SQRT3 / 4),
    "kagome": ([(1, 1), *PLANE], 4, 3, 2 * SQRT3, SQRT3 / 4, SQRT3 / 8),
    "diamond": ([(1, 1, 1), *SOLID], 4, 2, 16 / (3 * SQRT3), SQRT3 / 12, 0.0),
    "cubic": (SOLID, 6, 1, 1.0, 1 / 3, 0.0),
}
CASES = [(name, size) for name, row in LATTICES.items() for size in row[0]]
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
    found = rigidity(network, network.positions).value
    expected = SELF_STRESSES[name](*size)
    assert found.n_self_stresses == expected
    # Maxwell–Calladine.
    assert found.n_zero_modes == network.dimension * network.n_vertices - network.n_edges + expected
    assert found.smallest_nonzero > 1e-2


@pytest.mark.parametrize("name, size", CASES)
@pytest.mark.parametrize("edge_length", [1.0, 0.4])
def test_moduli(name, size, edge_length):
    *_, bulk, shear = LATTICES[name]
    network = lattice(name, *size, edge_length=edge_length)
    unit = edge_length ** (2 - network.dimension)
    found = elasticity(network, network.positions).value
    assert found.bulk == pytest.approx(bulk * unit, rel=1e-12)
    assert found.shear == pytest.approx(shear * unit, rel=1e-12, abs=1e-14)
    # Bravais lattices of any kind with one edge length are at the largest B_0 of their topology.
    assert upper_bound(network, "B_0") == pytest.approx(bulk * unit, rel=1e-12)
    assert optimize(network, "bulk_modulus").objective == pytest.approx(bulk * unit, rel=1e-12)
