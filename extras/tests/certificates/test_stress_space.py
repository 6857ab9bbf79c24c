"""The space of stresses of a configuration: dimension by counting, and the configuration of its members."""

import numpy as np
import pytest
from problems import NETWORKS, at, dense_free, pinned_grid, random_stress, square_octagon, with_random_stiffness

from critflow import CriticalManifold, InputError, Network, Status, lattice, three_bar_linkage
from critflow.manifold import CriticalConfiguration
from critflow.quantities import pure_shear, transition_modulus
from critflow_extras import self_stresses


def braced_grid() -> Network:
    """The pinned grid with both diagonals in every square: overconstrained, without a cell."""
    plain = pinned_grid(5)
    x = plain.positions
    joined = {tuple(sorted(edge)) for edge in plain.edges.tolist()}
    near = [(i, j) for i in range(len(x)) for j in range(i) if 1.1 < np.linalg.norm(x[i] - x[j]) < 1.75]
    more = [pair for pair in near if tuple(sorted(pair)) not in joined and not set(pair) <= set(plain.pins)]
    return Network(np.concatenate([plain.edges, more]), pins=plain.pins, positions=x)


def dense_dimension(network, coordinates):
    """Nullity of the balance matrix gᵀ diag(L), all directions stacked, by a dense singular value decomposition."""
    g, _ = dense_free(network)
    L = network.bond_vectors(coordinates)
    balance = np.concatenate([g.T * L[:, axis] for axis in range(network.dimension)])
    values = np.linalg.svd(balance, compute_uv=False)
    return network.n_edges - int(np.count_nonzero(values > 1e-9 * values[0]))


OVERCONSTRAINED = {
    "triangular": lambda: lattice("triangular", 4, 3),
    "triangular, small": lambda: lattice("triangular", 1, 2),
    "braced grid": braced_grid,
    "cubic": lambda: lattice("cubic", 2, 3, 2),
}


@pytest.mark.parametrize("name", ["voronoi", "voronoi 3D", "square-octagon", "tiny", "pinned star", "pinned grid"])
def test_generic_underconstrained_networks_are_one_to_one(name):
    network = NETWORKS[name]()
    critical = CriticalManifold(network).configuration(random_stress(network.n_edges, 3))
    found = self_stresses(critical)
    expected = dense_dimension(network, critical.coordinates)
    assert found.status is Status.ok
    assert found.value.dimension == expected
    # Pinned, these two are overconstrained: 5 edges at one vertex, 24 at nine vertices of the plane.
    assert expected == {"pinned star": 5 - 2, "pinned grid": 24 - 18}.get(name, 1)
    np.testing.assert_allclose(found.value.basis[0], critical.sigma / np.linalg.norm(critical.sigma), atol=1e-9)


@pytest.mark.parametrize("name", OVERCONSTRAINED)
def test_many_stresses_of_one_configuration(name):
    network = with_random_stiffness(OVERCONSTRAINED[name](), 4)
    manifold = CriticalManifold(network)
    critical = manifold.configuration(random_stress(network.n_edges, 5))
    solution = self_stresses(critical)
    space = solution.value
    assert solution.status is Status.ok and solution.stats.residual < 1e-11
    # Generic: maximal rank, so N_s = N_b − d n_free.
    assert space.dimension == network.n_edges - network.dimension * len(network.free) > 1
    assert space.dimension == dense_dimension(network, critical.coordinates)
    np.testing.assert_allclose(space.basis @ space.basis.T, np.eye(space.dimension), atol=1e-12)
    rng = np.random.default_rng(1)
    for size in (1e-3, 0.03):
        other = critical.sigma + size * rng.standard_normal(space.dimension) @ space.basis
        assert space.distance(other) < 1e-11
        there = manifold.configuration(other)
        np.testing.assert_allclose(there.bond_vectors, critical.bond_vectors, rtol=0, atol=1e-10)
    # A step out of the space changes the configuration in proportion.
    away = rng.standard_normal(network.n_edges)
    away -= (space.basis @ away) @ space.basis
    moved = [
        np.abs(manifold.configuration(critical.sigma + step * away).bond_vectors - critical.bond_vectors).max()
        for step in (1e-4, 2e-4)
    ]
    assert moved[0] > 1e-7
    assert moved[1] / moved[0] == pytest.approx(2, rel=0.02)


@pytest.mark.parametrize(
    "network, dimension",
    [
        (lattice("square", 3, 5), 8),
        (lattice("kagome", 4, 2), 8),
        (lattice("kagome", 12, 9), 24),
        (lattice("square", 20, 20), 40),
    ],
    ids=["square", "kagome", "kagome, 648 edges", "square, 800 edges"],
)
def test_stresses_of_straight_lines(network, dimension):
    # One per line, also where there are many more than the counts require.
    critical = CriticalManifold(network).configuration(np.ones(network.n_edges))
    space = self_stresses(critical)
    assert space.status is Status.ok
    assert space.value.dimension == dimension
    # The space contains another tension on one line of edges parallel to the first cell vector.
    row = np.flatnonzero(np.abs(critical.bond_vectors[:, 1]) < 1e-9)
    height = critical.coordinates[network.edges[row, 0], 1]
    line = row[np.abs(height - height[0]) < 1e-9]
    sigma = np.ones(network.n_edges)
    sigma[line] = 1.7
    assert space.value.distance(sigma) < 1e-7
    sigma[line[0]] = 1.0
    assert space.value.distance(sigma) > 1e-3


@pytest.mark.parametrize("name", OVERCONSTRAINED)
def test_modulus_is_the_maximum_over_the_space(name):
    """μ = max over σ in the space of (σ·ḣ)²/(V σᵀK⁻¹σ): a single stress gives less."""
    network = with_random_stiffness(OVERCONSTRAINED[name](), 4)
    if network.cell is None:
        network = Network(network.edges, network.offsets, 9.0 * np.eye(2), network.stiffness, network.pins)
    critical = CriticalManifold(network).configuration(random_stress(network.n_edges, 5))
    space = self_stresses(critical).value
    L = critical.bond_vectors
    hdot = np.einsum("ad,ad->a", L, L @ pure_shear(network.dimension))
    flexibility = np.sum(L**2, axis=1) / network.stiffness
    best = np.linalg.solve((space.basis * flexibility) @ space.basis.T, space.basis @ hdot)
    modulus = transition_modulus(network, pure_shear(network.dimension))
    most = modulus.evaluate(at(network, best @ space.basis, L))[0]
    rng = np.random.default_rng(2)
    for _ in range(20):
        other = rng.standard_normal(space.dimension) @ space.basis
        assert modulus.evaluate(at(network, other, L))[0] <= most * (1 + 1e-12)
    one = CriticalConfiguration(network, critical.sigma, critical.coordinates, L)
    assert modulus.evaluate(at(network, one.sigma, L))[0] < 0.9 * most


def test_edge_between_pins_has_any_stress():
    network = Network([[0, 1], [1, 2], [2, 3], [0, 3]], pins={0: [0.0, 0.0], 3: [3.0, 0.0]})
    critical = CriticalManifold(network).configuration([1, 2, 3, 4])
    space = self_stresses(critical).value
    assert space.dimension == 2
    assert space.distance([1, 2, 3, -7]) < 1e-12


def test_degenerate_edges_and_stresses_have_a_status():
    network = three_bar_linkage()
    straight = CriticalManifold(network).configuration([1, 2, 3])
    x = straight.coordinates.copy()
    x[1] = x[0]
    collapsed = CriticalConfiguration(network, straight.sigma, x, network.bond_vectors(x))
    assert self_stresses(collapsed).status is Status.singular
    x = network.positions
    bent = CriticalConfiguration(network, straight.sigma, x, network.bond_vectors(x))
    found = self_stresses(bent)
    assert found.status is Status.floppy and found.value.dimension == 0 and np.isnan(found.stats.residual)


def test_bad_input():
    critical = CriticalManifold(square_octagon()).configuration(np.ones(6))
    space = self_stresses(critical).value
    with pytest.raises(InputError, match="stress"):
        space.distance(np.zeros(6))
    with pytest.raises(InputError, match="edge"):
        space.distance(np.ones(5))
