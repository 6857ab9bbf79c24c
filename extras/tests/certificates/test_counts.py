"""Counts of self-stresses and zero modes, dense and sparse, against known networks."""

from dataclasses import replace

import numpy as np
import pytest
from derivatives import assert_derivative
from problems import NETWORKS, Factorisations, dense_rigidity, random_stress, triangular_lattice, voronoi_3d
from refusals import refused

from critflow import (
    CriticalManifold,
    InputError,
    Network,
    Status,
    critical_from_lengths,
    lattice,
    three_bar_linkage,
    voronoi_network,
)
from critflow.manifold import critical_configuration
from critflow.sparse import rigidity_matrix
from critflow_extras import certify, rigidity
from critflow_extras.certificates.spaces import zero_modes


def dense_counts(network, x):
    """N_s and N_0 by singular values of the dense rigidity matrix."""
    R, _ = dense_rigidity(network, x)
    rank = np.linalg.matrix_rank(R, tol=1e-8)
    return len(R) - rank, R.shape[1] - rank


def generic(network):
    """Displaced positions without self-stress; those of a Voronoi tessellation have one."""
    return network.positions + 0.05 * np.random.default_rng(1).standard_normal(network.positions.shape)


def test_rigidity_matrix_is_the_derivative_of_lengths():
    network = voronoi_3d()
    x = CriticalManifold(network).configuration(np.ones(network.n_edges)).coordinates
    R = rigidity_matrix(network, x).toarray()
    direction = np.random.default_rng(1).standard_normal(x.shape)
    direction[0] = 0
    lengths = lambda y: np.linalg.norm(network.bond_vectors(y), axis=1)  # noqa: E731
    assert_derivative(lengths, lambda u: R @ u[network.free].ravel(), x, [direction])


def test_edge_without_length_has_a_status():
    network = Network([[0, 1], [1, 0], [0, 1]], [[0, 0], [1, 0], [0, 1]], np.eye(2))
    for solution in (rigidity(network, np.zeros((2, 2))), zero_modes(network, np.zeros((2, 2)))):
        assert solution.status is Status.singular
        assert "edge 0" in solution.note


def test_certificate():
    network = voronoi_network(100, seed=1)
    critical = critical_from_lengths(network, np.ones(150)).value
    certificate = certify(critical)
    assert certificate.residual < 1e-12
    assert 0 < certificate.least_tension < 1
    assert (certificate.n_self_stresses, certificate.n_zero_modes) == (1, 51)
    assert certificate.gap[0] < 1e-12 < 1e-4 < certificate.gap[1]
    assert certificate.rigid
    # A forged one fails.
    x = critical.coordinates.copy()
    x[5] += 0.01
    certificate = certify(type(critical)(network, critical.sigma, x, network.bond_vectors(x)))
    assert certificate.residual > 1e-4
    assert certificate.n_self_stresses == 0
    assert not certificate.rigid


def critical(network, seed):
    return network, CriticalManifold(network).configuration(random_stress(network.n_edges, seed)).coordinates


def critical_voronoi(n_vertices):
    return critical(voronoi_network(n_vertices, seed=1), 2)


def pinned_in_space():
    network = Network([[0, 3], [3, 4], [4, 1], [4, 2], [3, 2]], pins={0: [0, 0, 0], 1: [3, 0, 1], 2: [0, 2, 0]})
    return network, np.array([[0, 0, 0], [3, 0, 1], [0, 2, 0], [1, 1, 1], [2, 1, 0]], float)


# Below 400 edges the counts come from all singular values, above from the inertia of a sparse matrix.
CONFIGURATIONS = {
    **{name: lambda make=make: critical(make(), 1) for name, make in NETWORKS.items()},
    "voronoi, 60 edges": lambda: critical_voronoi(40),
    "voronoi, 450 edges": lambda: critical_voronoi(300),
    "voronoi off the manifold, 450 edges": lambda: (
        voronoi_network(300, seed=1),
        generic(voronoi_network(300, seed=1)),
    ),
    "voronoi in space, 432 edges": lambda: (voronoi_3d(32), voronoi_3d(32).positions),
    "honeycomb, 432 edges": lambda: (lattice("honeycomb", 12, 12), lattice("honeycomb", 12, 12).positions),
    "square, 450 edges": lambda: (lattice("square", 15, 15), lattice("square", 15, 15).positions),
    "triangular, 432 edges": lambda: triangular_lattice(12, 12),
    "triangular, 48 edges": lambda: triangular_lattice(4, 4),
    "linkage": lambda: (three_bar_linkage(), three_bar_linkage().positions),
    "pinned in space": pinned_in_space,
}


@pytest.mark.parametrize("name", CONFIGURATIONS)
def test_null_vectors_dense_and_sparse(name):
    network, x = CONFIGURATIONS[name]()
    R, free = dense_rigidity(network, x)
    solution, found = rigidity(network, x), zero_modes(network, x)
    counts, (n_stresses, n_modes) = solution.value, dense_counts(network, x)
    assert found.status is Status.ok and solution.status is (Status.ok if n_stresses else Status.floppy)
    assert counts.prestress_stable is (True if n_stresses == 1 else None)
    assert (counts.n_self_stresses, counts.n_zero_modes) == (n_stresses, n_modes)
    assert len(counts.self_stresses) == n_stresses
    modes = found.value
    translations = np.repeat(np.eye(network.dimension)[: counts.n_trivial, None], network.n_vertices, axis=1)
    everything = np.concatenate([translations / np.sqrt(network.n_vertices), modes.modes])
    assert len(everything) == n_modes
    flat = everything.reshape(n_modes, network.n_vertices * network.dimension)
    np.testing.assert_allclose(flat @ flat.T, np.eye(n_modes), rtol=0, atol=1e-12)
    assert np.abs(everything[:, list(network.pins)]).max(initial=0.0) == 0.0
    assert np.abs(R @ everything[:, free].reshape(n_modes, R.shape[1]).T).max(initial=0.0) < 1e-11
    # Translations are separate; the other modes have zero mean.
    if not network.pins:
        assert np.abs(modes.modes.mean(axis=1)).max(initial=0.0) < 1e-13
    S = counts.self_stresses
    np.testing.assert_allclose(S @ S.T, np.eye(n_stresses), rtol=0, atol=1e-12)
    length = np.linalg.norm(network.bond_vectors(x), axis=1)
    assert np.abs(R.T @ (S * length).T).max(initial=0.0) < 1e-11
    # The gap is that of the grounded matrix.
    values = np.linalg.svd(rigidity_matrix(network, x).toarray(), compute_uv=False)
    smallest = values[values > 1e-6].min()
    for gap in (counts, modes):
        assert gap.largest_zero < 1e-11
        assert gap.smallest_nonzero == pytest.approx(smallest, rel=1e-6)


@pytest.mark.parametrize("name", ["voronoi, 450 edges", "triangular, 432 edges", "voronoi, 60 edges"])
def test_counts_without_vectors(name):
    network, x = CONFIGURATIONS[name]()
    full, counts = rigidity(network, x).value, rigidity(network, x, vectors=False).value
    assert (counts.n_self_stresses, counts.n_zero_modes) == (full.n_self_stresses, full.n_zero_modes)
    assert counts.self_stresses.shape == (0, network.n_edges)
    assert 0.99e-5 < counts.smallest_nonzero <= full.smallest_nonzero * (1 + 1e-12)
    assert counts.first_order_rigid == full.first_order_rigid


@pytest.mark.parametrize("n_vertices", [40, 300])
def test_singular_value_near_the_tolerance_has_a_status(n_vertices):
    network, x = critical_voronoi(n_vertices)
    # The least singular value grows in proportion to the distance from the manifold.
    away = 1e-3 * np.random.default_rng(3).standard_normal(x.shape)
    ratio = rigidity(network, x + away).value.smallest_nonzero
    for aim, expected in (
        (1e-9, Status.singular), (5e-7, Status.singular), (2e-6, Status.singular), (1e-4, Status.floppy),
    ):  # fmt: skip
        moved = x + aim / ratio * away
        solution = rigidity(network, moved)
        assert solution.status is expected
        near = (solution.value.largest_zero, solution.value.smallest_nonzero)
        assert min(abs(s / aim - 1) for s in near) < 0.1
        assert (zero_modes(network, moved).status is Status.singular) == (expected is Status.singular)
        if expected is Status.singular:
            assert solution.value.prestress_stable is None
            assert ("rounding" if aim < 1e-7 else "gap") in solution.note
            assert rigidity(network, moved, tolerance=1e-4).status is Status.ok
    # A tolerance given by the user decides.
    near = x + 1e-9 / ratio * away
    assert rigidity(network, near, 1e-6).status is zero_modes(network, near, 1e-6).status is Status.ok
    # Counts without vectors examine singular values above the tolerance only.
    assert rigidity(network, x + 2e-6 / ratio * away, vectors=False).status is Status.singular


@pytest.mark.parametrize("distance", [1e-9, -1e-9, 1e-11, -1e-11])
def test_nearly_parallel_edges_have_a_status(distance):
    # Near a singular P all edges are parallel up to this distance, and eight singular values are of this order.
    network = voronoi_network(16, seed=0)
    sigma, g = np.ones(network.n_edges), network.free_incidence.toarray()
    resistance = g[5] @ np.linalg.solve(g.T @ g, g[5])
    sigma[5] = (1 - 1 / resistance) * (1 - distance)
    critical = CriticalManifold(network).configuration(sigma)
    counts = rigidity(network, critical.coordinates)
    assert counts.status is Status.singular
    assert "rounding" in counts.note
    assert not certify(critical).rigid


def test_compressive_stress_may_stabilise():
    # A string from a pin to a vertex on two steep struts: balance by 2·0.1·5 = 1, and 1 + 1 − 5 − 5 < 0.
    pins = {0: [0.0, 0.0], 3: [1.9, 1.0], 4: [1.9, -1.0]}
    network = Network([[0, 1], [1, 2], [2, 3], [2, 4]], pins=pins)
    x = np.array([pins[0], [1, 0], [2, 0], pins[3], pins[4]], float)
    counts = rigidity(network, x).value
    assert (counts.n_self_stresses, counts.n_zero_modes) == (1, 1)
    assert counts.prestress_stable
    np.testing.assert_allclose(counts.self_stresses[0], np.array([1, 1, -5, -5]) / np.sqrt(52), rtol=0, atol=1e-12)


def test_vectors_beyond_memory_raise():
    wide = lattice("honeycomb", 60, 60)
    with pytest.raises(InputError, match="3599"):
        zero_modes(wide, wide.positions)
    assert rigidity(wide, wide.positions).value.n_zero_modes == 3601
    network, x = triangular_lattice(60, 60)
    with pytest.raises(InputError, match="3602"):
        rigidity(network, x)
    assert rigidity(network, x, vectors=False).value.n_self_stresses == 3602


LINKAGE = three_bar_linkage()
BAD = {
    **{
        f"{call.__name__} {n}": (lambda call=call, bad=bad: call(LINKAGE, bad), "coordinates")
        for call in (rigidity, zero_modes)
        for n, bad in enumerate((LINKAGE.positions[:3], np.full((4, 2), np.nan)))
    },
    "tolerance of zero": (lambda: rigidity(LINKAGE, LINKAGE.positions, tolerance=0.0), "positive"),
    "tolerance below rounding": (lambda: rigidity(*critical_voronoi(300), tolerance=1e-9), "tolerance"),
    **{
        f"mask {n}": (lambda taut=taut: rigidity(PARALLEL, PARALLEL_COORDINATES, taut=taut), "mask")
        for n, taut in enumerate((np.ones(5, bool), np.ones(6), np.zeros(6, bool)))
    },
}
test_bad_input_raises_one_sentence = refused(BAD)


def test_certificate_with_several_self_stresses():
    # The square lattice has one self-stress per line; with uniform tension on all lines it is rigid.
    critical = CriticalManifold(lattice("square", 4, 4)).configuration(np.ones(32))
    certificate = certify(critical)
    assert certificate.n_self_stresses == 8
    assert certificate.rigid
    assert not certify(replace(critical, sigma=-critical.sigma)).rigid


def test_the_smallest_singular_value_of_a_long_chain_is_found():
    # s of a chain of n edges between pins are 2 sin(πm/2n), and cluster at zero, where plain iteration stalls.
    n = 6_000
    line = np.arange(n)
    chain = Network(np.stack([line, line + 1], axis=1), pins={0: [0.0, 0.0], n: [float(n), 0.0]})
    certificate = certify(CriticalManifold(chain).configuration(np.ones(n)))
    assert certificate.n_self_stresses == 1
    assert certificate.n_zero_modes == n - 1
    assert certificate.rigid
    assert certificate.gap[1] == pytest.approx(2 * np.sin(np.pi / (2 * n)), rel=1e-6)


def test_stresses_far_below_the_mean_still_stabilise():
    network = voronoi_network(n_vertices=40, seed=2)
    sigma = 1 + np.random.default_rng(0).random(network.n_edges)
    sigma[[7, 20]] = 1e-9, 1e-12
    assert certify(CriticalManifold(network).configuration(sigma)).rigid


# Edges 0 to 3 are two taut chains between the pins 0 and 1; the rest is slack, and vertex 4 floppy.
PARALLEL = Network([[0, 2], [2, 1], [0, 3], [3, 1], [2, 4], [4, 3]], pins={0: [0, 0], 1: [2, 0]})
PARALLEL_COORDINATES = np.array([[0, 0], [2, 0], [0.5, 0], [1.5, 0], [1, 0.2]])
PARALLEL_TAUT = np.array([True] * 4 + [False] * 2)


def test_counts_are_those_of_the_taut_part():
    solution = rigidity(PARALLEL, PARALLEL_COORDINATES, taut=PARALLEL_TAUT)
    counts = solution.value
    assert solution.ok
    assert "2 of 6 edges are slack and 1 of 5 vertices unstressed" in solution.note
    assert (counts.n_self_stresses, counts.n_zero_modes) == (2, 2)
    assert (counts.n_slack, counts.n_unstressed_vertices) == (2, 1)
    assert counts.self_stresses.shape == (2, 6)
    assert not counts.self_stresses[:, 4:].any()


def test_a_taut_part_without_self_stress_is_floppy():
    bent = PARALLEL_COORDINATES.copy()
    bent[2:4, 1] = 0.3, -0.1
    solution = rigidity(PARALLEL, bent, taut=PARALLEL_TAUT)
    assert solution.status is Status.floppy
    assert "no self-stress" in solution.note


def test_the_certificate_describes_the_taut_part():
    critical = critical_configuration(PARALLEL, np.array([3.0, 1, 1, 3, 0, 0]), PARALLEL_COORDINATES)
    certificate = certify(critical)
    assert certificate.rigid
    assert certificate.stressed_fraction == pytest.approx(2 / 3)
    assert (certificate.n_slack, certificate.n_unstressed_vertices) == (2, 1)
    assert certificate.least_tension == pytest.approx(1.0)


def test_components_of_the_taut_part_are_counted_together():
    network = lattice("square", 3, 3)
    horizontal = np.abs(network.bond_vectors(network.positions)[:, 0]) > 0.5
    counts = rigidity(network, network.positions, taut=horizontal).value
    # Each row has one self-stress and, of 3 vertices, 2 transverse motions and 2 translations.
    assert (counts.n_self_stresses, counts.n_zero_modes, counts.n_trivial) == (3, 12, 6)
    assert counts.prestress_stable
    assert counts.rigid


@pytest.mark.parametrize("decimals", [5, 6, 8, 10])
def test_the_rounding_of_a_file_is_reported_with_the_way_back(decimals):
    network = voronoi_network(100, seed=4)
    rounded = np.round(network.positions, decimals)
    found = rigidity(network, rounded)
    assert not found.ok
    assert f"{decimals} decimals" in found.reason
    assert "nearest_critical" in found.reason
    # The same network out of balance by more than its digits is floppy for another reason.
    displaced = np.round(network.positions + 0.1 * np.random.default_rng(0).standard_normal((100, 2)), decimals)
    assert "decimals" not in rigidity(network, displaced).reason


@pytest.mark.parametrize("n_vertices", [60, 500])
def test_a_certificate_of_tensions_factorises_no_system(n_vertices, monkeypatch):
    """Tension alone shows that the zero modes are stabilised; large networks are counted by inertias of RᵀR."""
    network = voronoi_network(n_vertices, seed=1)
    critical = CriticalManifold(network).configuration(np.ones(network.n_edges))
    counts = Factorisations(monkeypatch)(network, lambda: certify(critical))
    assert set(counts) <= {"Hessian"} and counts["Hessian"] <= 4
    assert certify(critical).rigid
