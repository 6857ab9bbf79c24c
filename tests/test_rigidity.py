"""Counts of self-stresses and zero modes, dense and sparse, against known networks."""

import numpy as np
import pytest
from problems import NETWORKS, dense_free, random_stress, triangular_lattice, voronoi_3d

from critflow import (
    CriticalManifold,
    Network,
    Status,
    certify,
    critical_from_lengths,
    honeycomb_network,
    rigidity,
    three_bar_linkage,
    voronoi_network,
)
from critflow.rigidity import rigidity_matrix


def dense_counts(network, x):
    """N_s and N_0 by singular values of the dense rigidity matrix, no vertex grounded."""
    g, b = dense_free(network)
    free = [i for i in range(network.n_vertices) if i not in network.pins]
    L = g @ x[free] + b
    unit = L / np.linalg.norm(L, axis=1)[:, None]
    R = np.einsum("ai,ad->aid", g, unit).reshape(len(g), -1)
    rank = np.linalg.matrix_rank(R, tol=1e-8)
    return len(g) - rank, R.shape[1] - rank


def generic(network):
    """Positions without any self-stress: those of a Voronoi tessellation have one, so they are moved."""
    return network.positions + 0.05 * np.random.default_rng(1).standard_normal(network.positions.shape)


@pytest.mark.parametrize("make", [lambda: voronoi_network(40, seed=1), voronoi_3d], ids=["2D", "3D"])
def test_a_voronoi_tessellation_is_in_balance(make):
    # Maxwell: the Delaunay tessellation is its reciprocal figure, so the tessellation itself carries a self-stress.
    network = make()
    solution = rigidity(network, network.positions)
    assert solution.status is Status.ok
    assert solution.value.n_self_stresses == 1
    assert (solution.value.self_stresses > 0).all()
    assert solution.value.rigid


@pytest.mark.parametrize("name", NETWORKS)
def test_critical_configurations(name):
    network = NETWORKS[name]()
    critical = CriticalManifold(network).configuration(random_stress(network.n_edges, 1))
    solution = rigidity(network, critical.coordinates)
    assert solution.status is Status.ok
    counts = solution.value
    assert (counts.n_self_stresses, counts.n_zero_modes) == dense_counts(network, critical.coordinates)
    # Maxwell–Calladine: N_0 − N_s = d N − N_b.
    n_coordinates = network.dimension * (network.n_vertices - len(network.pins))
    assert counts.n_zero_modes - counts.n_self_stresses == n_coordinates - network.n_edges
    assert counts.n_trivial == (0 if network.pins else network.dimension)
    assert counts.largest_zero < 1e-12 < 1e-4 < counts.smallest_nonzero
    S = counts.self_stresses
    np.testing.assert_allclose(S @ S.T, np.eye(len(S)), atol=1e-12)
    # The stress that made it lies in the span, and each balances.
    sigma = critical.sigma / np.linalg.norm(critical.sigma)
    assert np.linalg.norm(S @ sigma) == pytest.approx(1, rel=1e-10)
    for stress in S:
        force = network.divergence @ (stress[:, None] * critical.bond_vectors)
        assert np.abs(force).max() < 1e-12


@pytest.mark.parametrize("seed", [1, 2])
def test_one_self_stress_that_stabilises(seed):
    network = voronoi_network(40, seed=seed)
    counts = rigidity(network, CriticalManifold(network).configuration(np.ones(60)).coordinates).value
    assert (counts.n_self_stresses, counts.n_zero_modes) == (1, 21)
    assert counts.prestress_stable
    assert counts.rigid
    assert (counts.self_stresses > 0).all()


def test_sparse_and_dense_counts_agree():
    # 450 edges take the sparse branch; the dense reference is independent.
    network = voronoi_network(300, seed=1)
    critical = CriticalManifold(network).configuration(random_stress(450, 2))
    solution = rigidity(network, critical.coordinates)
    assert solution.status is Status.ok
    counts = solution.value
    assert (counts.n_self_stresses, counts.n_zero_modes) == dense_counts(network, critical.coordinates) == (1, 151)
    assert counts.prestress_stable
    np.testing.assert_allclose(
        counts.self_stresses[0], critical.sigma / np.linalg.norm(critical.sigma), rtol=0, atol=1e-8
    )
    elsewhere = generic(network)
    floppy = rigidity(network, elsewhere)
    assert floppy.status is Status.floppy
    assert dense_counts(network, elsewhere) == (0, 150)
    assert (floppy.value.n_self_stresses, floppy.value.n_zero_modes) == (0, 150)


@pytest.mark.parametrize("make", [lambda: voronoi_network(40, seed=1), voronoi_3d], ids=["2D", "3D"])
def test_a_generic_embedding_is_floppy(make):
    network = make()
    solution = rigidity(network, generic(network))
    assert solution.status is Status.floppy
    counts = solution.value
    assert counts.n_self_stresses == 0
    assert counts.n_zero_modes == network.dimension * network.n_vertices - network.n_edges
    assert counts.self_stresses.shape == (0, network.n_edges)
    assert counts.prestress_stable is None
    assert not counts.rigid


def test_triangular_lattice_is_overconstrained():
    network, x = triangular_lattice(4, 4)
    counts = rigidity(network, x).value
    # 48 edges, 32 coordinates, only the translations are free: N_s = 48 − 32 + 2.
    assert (counts.n_self_stresses, counts.n_zero_modes) == (18, 2) == dense_counts(network, x)
    assert counts.rigid
    assert counts.prestress_stable is None


def test_honeycomb_at_rest_is_critical():
    network = honeycomb_network(4, 3)
    counts = rigidity(network, network.positions).value
    assert (counts.n_self_stresses, counts.n_zero_modes) == dense_counts(network, network.positions)
    assert counts.n_self_stresses >= 1
    uniform = np.full(36, 1 / 6)
    assert np.linalg.norm(counts.self_stresses @ uniform) == pytest.approx(1, rel=1e-12)


def test_linkage():
    network = three_bar_linkage()
    straight = CriticalManifold(network).configuration([1.0, 2.0, 3.0])
    counts = rigidity(network, straight.coordinates)
    assert counts.status is Status.ok
    # On a line: one self-stress, and two sideways motions that it stabilises.
    assert (counts.value.n_self_stresses, counts.value.n_zero_modes) == (1, 2)
    assert counts.value.prestress_stable
    bent = rigidity(network, network.positions)
    assert bent.status is Status.floppy
    assert bent.value.n_zero_modes == 1
    # A branch point region: one bar pushes, balanced but unstable.
    pushed = CriticalManifold(network).configuration([1.0, 1.0, -0.6])
    assert not rigidity(network, pushed.coordinates).value.prestress_stable


def test_counts_do_not_depend_on_where_the_network_lies():
    network = voronoi_network(40, seed=1)
    x = CriticalManifold(network).configuration(np.ones(60)).coordinates
    counts = rigidity(network, x + np.array([0.3, -0.7]))
    assert counts.status is Status.ok
    assert counts.value.n_self_stresses == 1


def test_the_matrix_is_the_derivative_of_lengths():
    network = voronoi_3d()
    x = CriticalManifold(network).configuration(np.ones(network.n_edges)).coordinates
    R = rigidity_matrix(network, x).toarray()
    direction = np.random.default_rng(1).standard_normal(x.shape)
    direction[0] = 0
    h = 1e-5
    lengths = [np.linalg.norm(network.bond_vectors(x + s * h * direction), axis=1) for s in (-1, 1)]
    np.testing.assert_allclose(
        R @ direction[network.free].ravel(), (lengths[1] - lengths[0]) / (2 * h), rtol=0, atol=1e-8
    )


def test_an_edge_without_length_is_a_status():
    network = Network([[0, 1], [1, 0], [0, 1]], [[0, 0], [1, 0], [0, 1]], np.eye(2))
    solution = rigidity(network, np.array([[0.0, 0.0], [0.0, 0.0]]))
    assert solution.status is Status.singular
    assert "edge 0 has no length" in solution.stats.details["note"]


def test_certificate():
    network = voronoi_network(100, seed=1)
    certificate = certify(critical_from_lengths(network, np.ones(150)).value)
    assert certificate.residual < 1e-12
    assert 0 < certificate.least_tension < 1
    assert (certificate.n_self_stresses, certificate.n_zero_modes) == (1, 51)
    assert certificate.gap[0] < 1e-12 < 1e-4 < certificate.gap[1]
    assert certificate.rigid


def test_a_forged_certificate_fails():
    network = voronoi_network(100, seed=1)
    critical = critical_from_lengths(network, np.ones(150)).value
    x = critical.coordinates.copy()
    x[5] += 0.01
    moved = type(critical)(network, critical.sigma, x, network.bond_vectors(x))
    certificate = certify(moved)
    assert certificate.residual > 1e-4
    assert certificate.n_self_stresses == 0
    assert not certificate.rigid
