"""The theorems of docs/theory/relations.md, attacked: random networks, multigraphs, pins, stiffnesses, signs, space."""

import numpy as np
import pytest
from problems import (
    SMALL_NETWORKS,
    dense_bond_vectors,
    dense_free,
    dense_response,
    hung_ring,
    oblique,
    pinned_grid,
    square_octagon,
    triangular_lattice,
    voronoi_3d,
)

from critflow import (
    CriticalManifold,
    InputError,
    Network,
    PowerLaw,
    elasticity,
    isogonal_modes,
    lattice,
    quantity,
    stiffening,
    voronoi_network,
)
from critflow.growth import shear_growth
from critflow.isogonal import length_shares
from workflows.relations.study import (
    curvature_growth,
    in_isotropic_cell,
    missing_stiffness_growth,
    ratio_to_bulk,
)

J = np.array([[0.0, -1.0], [1.0, 0.0]])
SHEARS = 0.5 * np.array([[[0, 1], [1, 0]], [[1, 0], [0, -1]]])


def diluted(network: Network, seed: int) -> Network:
    """The network with stiffnesses over e²."""
    return network.with_stiffness(np.exp(2 * np.random.default_rng(seed).random(network.n_edges)))


# In a cell of few faces several edges join the same two vertices.
PLANE = {
    "voronoi": lambda seed: voronoi_network(16, seed),
    "multigraph": lambda seed: voronoi_network(8, seed),
    "multigraph, stiffnesses": lambda seed: diluted(voronoi_network(8, seed), seed),
    "stiffnesses": lambda seed: diluted(voronoi_network(12, seed), seed),
    "oblique": lambda seed: oblique(voronoi_network(12, seed)),
    "honeycomb": lambda seed: lattice("honeycomb", 2, 2),
    "square-octagon": lambda seed: square_octagon(),
    "pins": lambda seed: diluted(hung_ring(5 + seed), seed),
}


def random_critical(network, seed, spread=1.0, squeezed=0, factor=0.1):
    """A configuration of log-normal stresses, of which a number are negative, and smaller by a factor."""
    rng = np.random.default_rng(seed)
    sigma = np.exp(spread * rng.standard_normal(network.n_edges))
    sigma[rng.choice(network.n_edges, squeezed, replace=False)] *= -factor
    return CriticalManifold(network).configuration(sigma)


def mean_by_rotations(critical):
    """The mean of C_G over all pure shears by `stiffening` of the xy shears of rotated cells."""
    network, sigma = critical.network, critical.sigma

    def C_G(axes):
        return stiffening(CriticalManifold(network.deformed(axes)).configuration(sigma)).value.C_G

    turn = np.array([[1.0, 1.0], [-1.0, 1.0]]) / np.sqrt(2)
    if network.dimension == 2:
        return 0.5 * (C_G(np.eye(2)) + C_G(turn))
    total = 0.0
    for order in ([0, 1, 2], [1, 2, 0], [2, 0, 1]):
        axes = np.eye(3)[order]
        turned = np.array(axes)
        turned[:2] = turn @ axes[:2]
        # Three diagonal shears at 120° have 3/2 times the sum of two at right angles.
        total += C_G(axes) + 2 / 3 * C_G(turned)
    return total / 5


@pytest.mark.parametrize("name", [*SMALL_NETWORKS, "space"])
def test_the_mean_growth_is_that_of_rotated_cells(name):
    network = voronoi_3d() if name == "space" else SMALL_NETWORKS[name]()
    critical = random_critical(network, 1)
    assert shear_growth(critical).mean == pytest.approx(mean_by_rotations(critical), rel=1e-9)


def soft_fields(network, sigma, L):
    """Displacements u_A (n, 2) of least Σσ|gu|² with (AL + gu)·L = 0, for both shears; dense."""
    g, _ = dense_free(network)
    P = g.T @ (sigma[:, None] * g)
    R = np.concatenate([L[:, :1] * g, L[:, 1:] * g], axis=1)
    system = np.block([[np.kron(np.eye(2), P), R.T], [R, np.zeros((len(L), len(L)))]])
    fields = []
    for A in SHEARS:
        right = np.concatenate([np.zeros(R.shape[1]), -np.sum(L * (L @ A), axis=1)])
        solved = np.linalg.lstsq(system, right, rcond=1e-11)[0][: R.shape[1]]
        assert np.abs(R @ solved - right[R.shape[1] :]).max() < 1e-8
        fields.append(solved.reshape(2, -1).T)
    return fields


@pytest.mark.parametrize("squeezed", [0, 1])
@pytest.mark.parametrize("name", PLANE)
def test_the_mean_growth_exceeds_the_bulk_modulus_by_a_square(name, squeezed):
    """⟨C_G⟩ = B_0 + (B_0/T) Σσ|g(u + Ju')|²: a square where P is positive definite, whatever the signs of σ."""
    tried = 0
    for seed in range(4):
        critical = in_isotropic_cell(random_critical(PLANE[name](seed), seed, squeezed=squeezed))
        if critical is None:
            continue
        network, sigma, L = critical.network, critical.sigma, critical.bond_vectors
        g, _ = dense_free(network)
        P = g.T @ (sigma[:, None] * g)
        if np.linalg.eigvalsh(P)[0] < -1e-9:
            continue
        u, turned = soft_fields(network, sigma, L)
        bulk, T = elasticity(critical).value.bulk, sigma @ critical.lengths**2
        excess = np.sum(sigma[:, None] * (g @ (u + turned @ J.T)) ** 2)
        mean = shear_growth(critical).mean
        assert mean == pytest.approx(bulk * (1 + excess / T), rel=1e-6)
        assert T > 0 and excess > -1e-9 * T and mean > bulk * (1 - 1e-9)
        tried += 1
    assert tried


def test_the_honeycomb_attains_the_bound_and_others_do_not():
    even = in_isotropic_cell(random_critical(lattice("honeycomb", 3, 3), 1, spread=0.0))
    assert ratio_to_bulk(even) == pytest.approx(1.0, abs=1e-12)
    assert ratio_to_bulk(in_isotropic_cell(random_critical(voronoi_network(20, 1), 1, spread=0.0))) > 1 + 1e-4


def test_without_a_definite_prestress_the_growth_has_no_bound():
    """A network with one compressed edge whose P is indefinite, though σ stabilises its zero modes."""
    critical = random_critical(voronoi_network(8, 77), 77, squeezed=1, factor=0.3)
    g, _ = dense_free(critical.network)
    assert np.linalg.eigvalsh(g.T @ (critical.sigma[:, None] * g))[0] < -0.01
    assert stiffening(critical).ok
    assert ratio_to_bulk(in_isotropic_cell(critical)) < -3


def test_a_network_that_dilation_loosens_has_no_such_bound():
    """P is positive definite, but T < 0: the square-octagon whose links are compressed, G_0 = 0 by symmetry."""
    network = square_octagon(2.0, 2.0)
    critical = CriticalManifold(network).configuration([1, 1, 1, 1, -0.2, -0.2])
    g = network.free_incidence.toarray()
    assert np.linalg.eigvalsh(g.T @ (critical.sigma[:, None] * g))[0] > 0.1
    assert critical.sigma @ critical.lengths**2 < 0 and stiffening(critical).loosening
    assert ratio_to_bulk(critical) == pytest.approx(-0.8, rel=1e-9)


def test_at_zero_shear_modulus_all_spring_laws_grow_alike():
    critical = in_isotropic_cell(random_critical(voronoi_network(20, 3), 3))
    assert stiffening(critical, law=PowerLaw(4)).value.C_G == pytest.approx(stiffening(critical).value.C_G, rel=1e-9)


ANY = PLANE | {
    "space": lambda seed: diluted(voronoi_3d(8, seed), seed),
}


@pytest.mark.parametrize("name", ANY)
def test_the_bound_of_any_shear_modulus(name):
    for seed in range(2):
        network = ANY[name](seed)
        d = network.dimension
        stretched = network.deformed(np.diag(np.linspace(1, 1.5, d)))
        for one in (network, stretched):
            growth = shear_growth(random_critical(one, seed))
            assert growth.mean >= growth.bound
        isotropic = in_isotropic_cell(random_critical(network, seed))
        growth, bulk = shear_growth(isotropic), elasticity(isotropic).value.bulk
        assert growth.bound == pytest.approx((d + 2) / (2 * d) * bulk, rel=1e-9)


@pytest.mark.parametrize("name", ["voronoi", "space"])
def test_the_terms_of_the_bound(name):
    """In anisotropic networks, by the elasticity tensor and sums over edges; in the plane no term of G_0 is left."""
    network = ANY[name](3)
    d = network.dimension
    critical = random_critical(network.deformed(np.diag(np.linspace(1, 1.5, d))), 3)
    L, sigma, k, found = critical.bond_vectors, critical.sigma, critical.network.stiffness, stiffening(critical).value
    strains = [[[1, 0], [0, -1]]] if d == 2 else np.array([np.diag([1, -1, 0]), np.diag([1, 1, -2]) / np.sqrt(3)])
    deviators = [0.5 * np.diagonal(A) for A in strains]
    C, m = elasticity(critical).value.tensor, d * (d - 1) // 2
    G_0 = np.mean([*np.diagonal(C)[-m:], *(A @ C[:d, :d] @ A for A in deviators)])

    def share(weight):
        tensor = np.einsum("e,ei,ej->ij", weight, L, L)
        return tensor / np.trace(tensor) - np.eye(d) / d

    s, t, n = share(sigma), share(sigma**2 / k), m + d - 1
    B_0, affine = found.bulk_0, 1 + d / n * np.vdot(s, s) - 2 * d / n * np.vdot(s, t)
    bound = B_0 * (d + 2) / (2 * d) * affine**2 + (2 / d - 1) * G_0 - G_0 / (3 * B_0) * (found.C_B - (3 / d - 2) * B_0)
    assert min(G_0 / B_0, np.vdot(s, s), np.vdot(s, t)) > 1e-3
    assert shear_growth(critical).bound == pytest.approx(bound, rel=1e-9)


def test_the_bound_needs_tension():
    assert np.isnan(shear_growth(random_critical(voronoi_network(12, 1), 4, squeezed=1)).bound)


# Pairs


PAIRED = PLANE | {"triangular": lambda seed: triangular_lattice()[0], "grid on pins": lambda seed: pinned_grid()}


@pytest.mark.parametrize("squeezed", [0, 1, 3])
@pytest.mark.parametrize("name", PAIRED)
def test_shares_come_in_pairs(name, squeezed):
    """For any signs of σ, where P is regular; dense, by the definition."""
    network = PAIRED[name](1)
    critical = random_critical(network, 2, squeezed=squeezed)
    sigma, L = critical.sigma, dense_bond_vectors(network, critical.sigma)
    matrix = -dense_response(network, sigma) * sigma / np.sum(L**2, axis=1)[:, None]
    values = np.linalg.eigvals(matrix)
    n, n_edges = len(network.free), network.n_edges
    ones = int(np.sum(np.abs(values - 1) < 1e-6))
    zeros = int(np.sum(np.abs(values) < 1e-6))
    # Of the 2n eigenvalues of K as many vanish as are 1; β has N_b of them.
    assert zeros - ones == n_edges - 2 * n
    assert ones == isogonal_modes(critical).n_independent
    # Odd moments, by which no eigenvalue needs a partner found.
    for p in (1, 3, 5):
        assert np.sum((values - 0.5) ** p) == pytest.approx((ones - zeros) / 2**p, abs=1e-7)


def test_shares_are_those_of_the_matrix_of_the_library_and_not_paired_in_space():
    for network, paired in ((voronoi_network(20, 1), True), (voronoi_3d(), False)):
        critical = random_critical(network, 1)
        sigma, size = critical.sigma, np.sqrt(critical.sigma) * critical.lengths
        matrix = -dense_response(network, sigma) * sigma / critical.lengths[:, None] ** 2
        beta = length_shares(critical)
        np.testing.assert_allclose(beta / size[:, None] * size, matrix, rtol=0, atol=1e-10)
        values = np.linalg.eigvalsh(beta)
        between = values[(values > 1e-9) & (values < 1 - 1e-9)]
        assert np.sum(beta.diagonal()) == pytest.approx(len(network.free), rel=1e-12)  # Foster
        assert (np.abs(between + between[::-1] - 1).max() < 1e-9) == paired


@pytest.mark.parametrize(
    "make, word",
    [
        (lambda: random_critical(voronoi_network(12, 1), 1, squeezed=1), "not under tension"),
        (lambda: random_critical(voronoi_network(3200, 1), 1), "too large"),
    ],
    ids=["compressed", "large"],
)
def test_shares_that_are_refused(make, word):
    with pytest.raises(InputError, match=word):
        length_shares(make())


# Growth as curvature, and its price


@pytest.mark.parametrize("name", [name for name in ANY if name != "honeycomb"])
def test_growth_is_curvature_and_missing_stiffness_is_paid_in_it(name):
    for seed in range(2):
        critical = random_critical(ANY[name](seed), seed)
        C_B = stiffening(critical).value.C_B
        assert curvature_growth(critical)[1] == pytest.approx(C_B, rel=1e-8)
        assert C_B >= missing_stiffness_growth(critical.manifold, critical)
        isotropic = in_isotropic_cell(critical)
        d, sigma, L = critical.network.dimension, isotropic.sigma, isotropic.bond_vectors
        h = L[:, 0] * L[:, 1]
        curved = h @ np.linalg.lstsq(-dense_response(isotropic.network, sigma), h, rcond=1e-11)[0]
        bulk, T = elasticity(isotropic).value.bulk, sigma @ isotropic.lengths**2
        assert stiffening(isotropic).value.C_G_stress_corrected == pytest.approx(d * bulk / T * curved, rel=1e-7)


@pytest.mark.parametrize("name", [name for name in PLANE if name != "pins"])
def test_the_largest_moduli_differ_by_the_anisotropy_at_equal_stress(name):
    for seed in range(2):
        network = PLANE[name](seed).deformed([[1.1, 0.1 * seed], [0.0, 1.0]])
        L, k = dense_bond_vectors(network, network.stiffness), network.stiffness
        M = (k[:, None] * L).T @ L
        bulk, shear = (
            quantity(network, one).extreme(CriticalManifold(network), positive=False)[1] for one in ("B_0", "G_0")
        )
        assert bulk - shear == pytest.approx((M[0, 0] - M[1, 1]) ** 2 / (4 * network.volume * np.trace(M)), abs=1e-12)
