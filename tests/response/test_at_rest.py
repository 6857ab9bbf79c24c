"""Springs at rest and at the transition: any contrast of stiffness, any number of self-stresses, pinned networks."""

import numpy as np
import pytest
from problems import random_stress, triangular_lattice, voronoi_3d, with_random_stiffness
from scipy.linalg import null_space

from critflow import (
    CriticalManifold,
    InputError,
    Network,
    Status,
    critical_from_lengths,
    cubic_network,
    delaunay_network,
    diluted,
    elastic_moduli,
    elasticity,
    equilibrium,
    kagome_network,
    linear_response,
    modulus_bound,
    spring_state,
    three_bar_linkage,
    transition_moduli,
    transition_modulus,
    triangular_network,
    voronoi_network,
)
from critflow.networks.deformation import strain_basis
from critflow.response.at_rest import response_at_rest
from workflows.benchmarks import reference


def on_integers(network, size):
    """The affine image of a lattice with integer coordinates, which have no rounding errors."""
    places = np.rint(network.positions @ np.linalg.inv(network.cell) * size)
    return Network(network.edges, network.offsets, cell=size * np.eye(2), positions=places)


LATTICES = {
    "triangular": lambda: on_integers(triangular_network(3, 3), 3),
    "kagome": lambda: on_integers(kagome_network(2, 2), 4),
    "Delaunay": lambda: delaunay_network(9, seed=1, hard_core=0.6),
}


def softened(network, contrast, part, seed=0):
    """Random edges softened; for no part, stiffnesses of all magnitudes."""
    rng = np.random.default_rng(seed)
    k = contrast ** -rng.random(network.n_edges) if part == 0 else np.ones(network.n_edges)
    k[rng.choice(network.n_edges, int(part * network.n_edges), replace=False)] = 1 / contrast
    return network.with_stiffness(k)


@pytest.mark.parametrize("part", [0, 0.2, 0.4])
@pytest.mark.parametrize("contrast", [1e4, 1e16, 1e40])
@pytest.mark.parametrize("name", LATTICES)
def test_any_contrast_of_stiffness(name, contrast, part):
    network = softened(LATTICES[name](), contrast, part, seed=len(name))
    solution = elasticity(network, network.positions)
    assert solution.status is Status.ok
    digits = reference.digits_for_contrast(network.stiffness)
    exact = reference.elasticity_at_rest(network, network.positions, digits=digits)
    errors = np.abs((reference.numbers(solution.value.energy * network.volume) - exact).astype(float))
    assert (errors <= network.volume * solution.value.bounds).all()
    assert solution.value.bounds.max() < 1e-10 * np.abs(solution.value.energy).max()
    assert np.linalg.eigvalsh(solution.value.energy).min() > -1e-15 * solution.value.energy.max()


@pytest.mark.parametrize("contrast", [1e12, 1e16, 1e40, 1e200])
def test_negligible_springs_are_as_good_as_removed(contrast):
    network = triangular_network(10, 10)
    soft = np.random.default_rng(0).choice(300, 60, replace=False)
    k = np.ones(300)
    k[soft] = 1 / contrast
    moduli = elastic_moduli(network.with_stiffness(k), network.positions)
    assert moduli.status is Status.ok
    kept = np.ones(300, bool)
    kept[soft] = False
    part, vertices = network.part(kept)
    removed = elastic_moduli(part, network.positions[vertices]).value
    assert (moduli.value.bulk, moduli.value.shear) == pytest.approx((removed.bulk, removed.shear), rel=1e-9)
    assert (removed.bulk, removed.shear) == pytest.approx((0.295271, 0.108126), abs=1e-6)
    assert moduli.stats.error_bound.bulk < 1e-11


def test_soft_springs_are_the_only_resistance():
    # A square grid of stiff springs with one soft diagonal in each cell: the grid resists extensions, diagonals shear.
    square, soft = 4, 1e-30
    vertices = np.arange(16).reshape(4, 4)
    edges, offsets, k = [], [], []
    for i, j in np.ndindex(4, 4):
        for step, stiffness in (((1, 0), 1.0), ((0, 1), 1.0), ((1, 1), soft)):
            to = np.array([i, j]) + step
            edges.append([vertices[i, j], vertices[tuple(to % square)]])
            offsets.append(to // square)
            k.append(stiffness)
    positions = np.stack(np.meshgrid(np.arange(4.0), np.arange(4.0), indexing="ij"), axis=-1).reshape(16, 2)
    network = Network(edges, offsets, cell=4 * np.eye(2), positions=positions, stiffness=k)
    solution = elasticity(network, positions)
    tensors = solution.value
    # Of a diagonal, k (n·E n)²|L|² = k/2 for a unit shear, per unit area.
    assert tensors.energy[2, 2] == pytest.approx(soft / 2, rel=1e-12)
    assert tensors.bounds[2, 2] < 1e-12 * soft
    assert tensors.energy[0, 0] == pytest.approx(1.0, rel=1e-12)
    assert elastic_moduli(network, positions).value.shear == pytest.approx(soft / 2, rel=1e-12)


def test_large_networks_of_large_contrast_are_answered_or_refused(monkeypatch):
    network = softened(triangular_network(12, 12), 1e20, 0.2)
    assert elasticity(network, network.positions).status is Status.ok
    monkeypatch.setattr("critflow.response.at_rest.LARGEST_RESPONSE", 1000)
    solution = elasticity(network, network.positions)
    assert solution.status is Status.ill_conditioned
    assert np.isnan(solution.value.energy).all()


def test_dense_and_sparse_responses_agree(monkeypatch):
    network, x = triangular_lattice(6, 6)
    network = with_random_stiffness(network, 4)
    dense = response_at_rest(network, x, network.volume)
    monkeypatch.setattr("critflow.response.at_rest.DENSE_EDGES", 0)
    sparse = response_at_rest(network, x, network.volume)
    assert dense.n_self_stresses == sparse.n_self_stresses
    difference = np.abs(dense.value.energy - sparse.value.energy)
    assert (difference <= dense.value.bounds + sparse.value.bounds).all()
    assert sparse.value.bounds.max() < 1e-11


CRITICAL = {
    "2D": lambda: voronoi_network(40, seed=1),
    "2D, random stiffness": lambda: with_random_stiffness(voronoi_network(40, seed=2), 3),
    "3D": voronoi_3d,
}


@pytest.mark.parametrize("name", CRITICAL)
def test_transition_tensor_has_rank_one(name):
    critical = CriticalManifold(CRITICAL[name]()).configuration(random_stress(CRITICAL[name]().n_edges, 5))
    solution = elasticity(critical)
    tensors, d, V = solution.value, critical.network.dimension, critical.network.volume
    assert solution.status is Status.ok and solution.n_self_stresses == 1
    # C = S ⊗ S/(V D) with S = Σ σ L ⊗ L and D = Σ σ²|L|²/k.
    L, sigma = critical.bond_vectors, critical.sigma
    S = np.einsum("aij,ij->a", strain_basis(d)[1], (sigma[:, None] * L).T @ L)
    D = sigma**2 @ (critical.lengths**2 / critical.network.stiffness)
    np.testing.assert_allclose(solution.factors[0], S / np.sqrt(D), rtol=1e-12, atol=1e-14 * np.abs(S).max())
    np.testing.assert_allclose(tensors.energy, np.outer(S, S) / (V * D), rtol=0, atol=1e-13)
    found = transition_moduli(critical)
    assert (tensors.bulk, tensors.shear) == pytest.approx((found.bulk, found.shear), rel=1e-12)
    # The same from the rigidity matrix, where σ is not known.
    at_rest = elasticity(critical.network, critical.coordinates)
    assert at_rest.n_self_stresses == 1
    np.testing.assert_allclose(at_rest.factors, solution.factors, rtol=0, atol=1e-9)
    assert (np.abs(at_rest.value.energy - tensors.energy) <= at_rest.value.bounds + tensors.bounds).all()
    # Every uniaxial stress excites a soft direction, and a stress of both signs would be needed for auxetic response.
    assert tensors.youngs_modulus(np.eye(d)[0]) == 0.0
    means = tensors.voigt_reuss_hill()
    assert (means.bulk_reuss, means.shear_reuss) == (0.0, 0.0)
    assert means.bulk_voigt == pytest.approx(found.bulk, rel=1e-12)


def test_several_self_stresses_add_up():
    network = cubic_network(2, 2, 2)
    solution = elasticity(CriticalManifold(network).configuration(np.ones(network.n_edges)))
    tensors = solution.value
    assert solution.n_self_stresses > 1 and len(solution.factors) == 3
    # Lines along the axes resist extensions separately; nothing resists shear.
    np.testing.assert_allclose(tensors.energy, np.diag([1.0, 1, 1, 0, 0, 0]), rtol=0, atol=1e-14)
    assert tensors.youngs_modulus([0, 0, 1]) == pytest.approx(1.0, rel=1e-13)
    assert tensors.youngs_modulus([1, 1, 0]) == 0.0
    assert tensors.poissons_ratio([0, 0, 1], [1, 0, 0]) == pytest.approx(0.0, abs=1e-14)


def test_slack_edges_resist_nothing():
    lengths = 1 + 0.3 * np.random.default_rng(0).standard_normal(150)
    critical = critical_from_lengths(voronoi_network(100, seed=1), lengths, throw=False).value
    assert (critical.sigma == 0).any()
    tensors, found = elasticity(critical).value, transition_moduli(critical)
    assert (tensors.bulk, tensors.shear) == pytest.approx((found.bulk, found.shear), rel=1e-10)


def test_self_stresses_that_no_strain_loads_give_no_modulus():
    network = diluted(triangular_network(20, 20), 3.4, 1)
    L = network.bond_vectors(network.positions)
    rigidity_matrix = (network.free_incidence.toarray()[:, :, None] * L[:, None]).reshape(network.n_edges, -1)
    stresses = null_space(rigidity_matrix.T)
    # The macroscopic stress Σ σ L⊗L of each of them vanishes.
    assert stresses.shape[1] == 2 and np.abs(np.einsum("an,ai,aj->nij", stresses, L, L)).max() < 1e-11
    for stiffness in (np.ones(network.n_edges), np.logspace(0, 3, network.n_edges)):
        found = response_at_rest(network.with_stiffness(stiffness), network.positions, network.volume)
        assert found.status is Status.floppy and found.n_self_stresses == 2 and "loads" in found.reason
        np.testing.assert_array_equal(found.value.energy, 0.0)
        assert found.value.bounds.max() < 1e-16
    moduli = elastic_moduli(network, network.positions).value
    assert moduli.bulk == moduli.shear == 0


def test_pinned_networks_have_a_stiffness_per_named_volume():
    network = three_bar_linkage()
    critical = CriticalManifold(network).configuration(np.ones(3))
    with pytest.raises(InputError, match="volume"):
        elasticity(critical)
    with pytest.raises(InputError, match="volume"):
        elasticity(critical, volume=-1.0)
    single, double = (elasticity(critical, volume=V).value for V in (1.0, 2.0))
    np.testing.assert_allclose(single.energy, 2 * double.energy, rtol=1e-14)
    # Stretching the pins apart along the bars: three springs in series.
    x = critical.bond_vectors
    along = x[0] / np.linalg.norm(x[0])
    reach = np.linalg.norm(x, axis=1).sum()
    assert single.modulus(np.outer(along, along)) == pytest.approx(reach**2 / 3, rel=1e-12)
    # Under tension, against energies: pins move with the strain.
    state = equilibrium(spring_state(network, 0.9 * critical.lengths, critical.coordinates)).value
    tensors = linear_response(state, volume=1.0).elasticity
    A = np.array([[0.3, 0.5], [-0.2, 0.4]])
    E = {n: equilibrium(state.deformed(np.eye(2) + n * 1e-3 * A), tolerance=1e-15).value.energy for n in range(-2, 3)}
    expected = (16 * (E[1] + E[-1]) - (E[2] + E[-2]) - 30 * E[0]) / 12e-6
    assert tensors.modulus(A) == pytest.approx(expected, rel=1e-6)
    assert elasticity(state, volume=1.0).value.modulus(A) == pytest.approx(tensors.modulus(A), rel=1e-12)


def test_networks_need_coordinates():
    with pytest.raises(InputError, match="coordinates"):
        elasticity(voronoi_network(12, seed=1))


def test_moduli_and_bounds_of_any_deformation():
    network = voronoi_network(24, seed=3)
    critical = CriticalManifold(network).configuration(random_stress(network.n_edges, 5))
    tensors = elasticity(critical).value
    for deformation in ("dilation", "simple_shear", "uniaxial", np.array([[0.3, 1.0], [0.2, -0.4]])):
        modulus = transition_modulus(network, deformation).evaluate(critical.sigma, critical.bond_vectors)[0]
        assert modulus == pytest.approx(tensors.modulus(deformation), rel=1e-12)
        assert modulus <= modulus_bound(network, deformation)
    with pytest.raises(InputError, match="free"):
        transition_modulus(network, "uniaxial_free")
