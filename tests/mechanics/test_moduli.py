"""Moduli: linear response against energies, the transition against its formula, error bounds, fits."""

from dataclasses import astuple

import numpy as np
import pytest
from problems import (
    HONEYCOMB_BULK_MODULUS,
    NETWORKS,
    SMALL_NETWORKS,
    STRAINS,
    TRIANGULAR_BULK_MODULUS,
    TRIANGULAR_SHEAR_MODULUS,
    bounds_over_errors,
    exact_moduli,
    modulus_by_formula,
    oblique,
    random_stress,
    slack_lattice,
    strained,
    taut_rows,
    triangular_lattice,
    voronoi_3d,
    with_random_stiffness,
)

from critflow import (
    CriticalManifold,
    InputError,
    PowerLaw,
    Status,
    WormLike,
    backbone,
    critical_from_lengths,
    elastic_moduli,
    equilibrium,
    honeycomb_network,
    linear_response,
    optimize,
    spring_state,
    strain_path,
    transition_bounds,
    transition_moduli,
    voronoi_network,
)

CASES = {
    "2D": lambda: voronoi_network(40, seed=1),
    "2D, random stiffness": lambda: with_random_stiffness(voronoi_network(40, seed=2), 3),
    "2D, oblique": lambda: oblique(voronoi_network(40, seed=3)),
    "3D": voronoi_3d,
    "3D, random stiffness": lambda: with_random_stiffness(voronoi_3d(), 4),
}


def critical_of(name, seed=2):
    network = CASES[name]()
    return CriticalManifold(network).configuration(random_stress(network.n_edges, seed))


@pytest.fixture(scope="module")
def slack():
    return slack_lattice()


def test_slack_edges_do_not_change_the_moduli_of_the_taut_part(slack):
    network, _, critical = slack
    part = backbone(critical).configuration
    moduli = transition_moduli(critical)
    assert moduli == transition_moduli(part)
    formula = modulus_by_formula(network, critical.sigma, critical.bond_vectors, np.eye(2) / 2)
    assert moduli.bulk == pytest.approx(formula, rel=1e-13)
    bounds = transition_bounds(critical)
    assert 0 < bounds.bulk < 1e-14
    solution = elastic_moduli(network, critical.coordinates, taut=critical.sigma != 0)
    assert solution.ok
    assert f"{backbone(critical).n_slack} of {network.n_edges} edges are slack" in solution.note
    np.testing.assert_allclose(astuple(solution.value), astuple(moduli), rtol=1e-11)


def test_the_moduli_of_disconnected_taut_parts_add_up():
    # Each of n rows of n springs has stiffness 1/n and the elongation nγ/2: B = 1/4; rows do not resist shear.
    critical = taut_rows(4)
    assert transition_moduli(critical).bulk == pytest.approx(0.25, rel=1e-14)
    assert transition_moduli(critical).shear == pytest.approx(0.0, abs=1e-30)
    solution = elastic_moduli(critical.network, critical.coordinates, taut=critical.sigma != 0)
    assert solution.ok
    assert solution.value.bulk == pytest.approx(0.25, rel=1e-13)


def shear(d):
    A = np.zeros((d, d))
    A[0, 1] = A[1, 0] = 0.5
    return A


def relaxed_energy(state, F):
    solution = equilibrium(state.deformed(F), tolerance=1e-15, throw=False)
    assert solution.value.max_force < 1e-13
    return solution.value.energy


def second_derivative(energy, step):
    """Central, of fourth order."""
    E = {n: energy(n * step) for n in (-2, -1, 0, 1, 2)}
    return (16 * (E[1] + E[-1]) - (E[2] + E[-2]) - 30 * E[0]) / (12 * step**2)


@pytest.mark.parametrize("name", CASES)
def test_linear_response_is_the_second_derivative_of_relaxed_energies(name):
    critical = critical_of(name)
    d = critical.network.dimension
    state = strain_path(critical.network, critical, [0.02]).value.states[0]
    response = linear_response(state)
    assert response.status is Status.ok
    assert response.stats.residual < 1e-10
    V = state.network.volume
    bulk = second_derivative(lambda e: relaxed_energy(state, (1 + e) ** (1 / d) * np.eye(d)), 5e-4) / V
    assert response.value.bulk == pytest.approx(bulk, rel=1e-6)
    modulus = second_derivative(lambda e: relaxed_energy(state, np.eye(d) + e * shear(d)), 5e-4) / V
    assert response.value.shear == pytest.approx(modulus, rel=1e-6)
    # The stress-corrected modulus subtracts half of dE/dV, here by a difference of energies.
    e = 1e-4
    E = {n: relaxed_energy(state, (1 + n * e) ** (1 / d) * np.eye(d)) for n in (-2, -1, 1, 2)}
    pressure = (8 * (E[1] - E[-1]) - (E[2] - E[-2])) / (12 * e * V)
    corrected = response.value.shear - 0.5 * pressure
    assert response.value.shear_stress_corrected == pytest.approx(corrected, rel=1e-7)


@pytest.mark.parametrize("name", CASES)
def test_relaxation_is_the_derivative_of_the_path(name):
    critical = critical_of(name)
    d = critical.network.dimension
    state = strain_path(critical.network, critical, [0.02]).value.states[0]
    relaxation = linear_response(state).relaxation
    e = 1e-4
    L = {}
    for n in (-1, 1):
        L[n] = equilibrium(state.deformed((1 + n * e) ** (1 / d) * np.eye(d))).value.bond_vectors
    expected = state.bond_vectors / d + state.network.free_incidence @ relaxation
    np.testing.assert_allclose((L[1] - L[-1]) / (2 * e), expected, rtol=0, atol=2e-4 * np.abs(expected).max())


@pytest.mark.parametrize("name", CASES)
def test_transition_moduli_by_three_methods(name):
    critical = critical_of(name)
    network, d = critical.network, critical.network.dimension
    found = transition_moduli(critical)
    # By the formula, edge by edge.
    s, L = critical.sigma, critical.bond_vectors
    assert found.bulk == pytest.approx(modulus_by_formula(network, s, L, np.eye(d) / d), rel=1e-13)
    assert found.shear == pytest.approx(modulus_by_formula(network, s, L, shear(d)), rel=1e-10)
    # By linear response at three small strains, extrapolated to none: a parabola through them leaves γ³.
    gamma = np.array([1, 2, 3, 4]) * 2.5e-4
    path = strain_path(critical.network, critical, gamma).value
    assert np.polyfit(gamma, path.bulk_modulus, 3)[-1] == pytest.approx(found.bulk, rel=1e-6)
    scale = max(found.shear, 0.05 * found.bulk)
    for values in (path.shear_modulus, path.shear_modulus_stress_corrected):
        assert np.polyfit(gamma, values, 3)[-1] == pytest.approx(found.shear, abs=1e-6 * scale)
    # By relaxed energies: 2E/Vγ² → B_0, extrapolated alike.
    ratio = 2 * path.energy / (network.volume * gamma**2)
    assert np.polyfit(gamma, ratio, 3)[-1] == pytest.approx(found.bulk, rel=1e-6)


@pytest.mark.parametrize("name", ["2D", "2D, random stiffness", "3D"])
def test_transition_shear_modulus_by_energies_of_a_shear(name):
    # A critical network under shear: E = ½VG_0ε² + O(ε³) for the sign that stretches it.
    network = CASES[name]()
    critical = optimize(network, "shear_modulus").value
    found = transition_moduli(critical)
    d = network.dimension
    side = np.sign(critical.sigma @ np.einsum("ad,ad->a", critical.bond_vectors, critical.bond_vectors @ shear(d)))
    state = spring_state(network, critical.lengths, critical.coordinates)
    strains = np.array([1, 2, 3, 4]) * 2.5e-4
    ratio = [2 * relaxed_energy(state, np.eye(d) + side * e * shear(d)) / (network.volume * e**2) for e in strains]
    assert np.polyfit(strains, ratio, 3)[-1] == pytest.approx(found.shear, rel=1e-5)


LAWS = {"cubic": PowerLaw(3), "power 4.5": PowerLaw(4.5), "worm-like": WormLike(0.4)}


@pytest.mark.parametrize("name", ["2D, random stiffness", "3D"])
@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
def test_linear_response_of_every_law(law, name):
    critical = critical_of(name)
    d = critical.network.dimension
    state = strain_path(critical.network, critical, [0.02], law=law).value.states[0]
    response = linear_response(state)
    V = state.network.volume
    bulk = second_derivative(lambda e: relaxed_energy(state, (1 + e) ** (1 / d) * np.eye(d)), 5e-4) / V
    assert response.value.bulk == pytest.approx(bulk, rel=1e-6)
    modulus = second_derivative(lambda e: relaxed_energy(state, np.eye(d) + e * shear(d)), 5e-4) / V
    assert response.value.shear == pytest.approx(modulus, rel=1e-6)
    direct = elastic_moduli(state.network, state.coordinates, state.rest_lengths, law=law).value
    assert direct.bulk == pytest.approx(response.value.bulk, rel=1e-9)


@pytest.mark.parametrize("columns, rows, k", [(3, 3, 1.0), (4, 5, 2.5)])
def test_triangular_lattice(columns, rows, k):
    network, x = triangular_lattice(columns, rows)
    solution = elastic_moduli(network.with_stiffness(k), x)
    assert solution.status is Status.ok
    assert solution.value.bulk == pytest.approx(k * TRIANGULAR_BULK_MODULUS, rel=1e-12)
    assert solution.value.shear == pytest.approx(k * TRIANGULAR_SHEAR_MODULUS, rel=1e-12)


def test_stressed_triangular_lattice():
    network, x = triangular_lattice(4, 4)
    s = 1.1
    state = spring_state(network, np.ones(48), x).deformed(s * np.eye(2))
    solution = linear_response(state)
    assert solution.status is Status.ok
    # The lattice stays regular: with v = V/V_0 = s², E/V_0 = √3 k(√v − 1)² and B = v E''(v)/V_0 = √3 k/(2√v).
    assert solution.value.bulk == pytest.approx(np.sqrt(3) / (2 * s), rel=1e-12)


def test_large_overconstrained_networks_have_moduli():
    network, x = triangular_lattice(12, 12)
    solution = elastic_moduli(network, x)
    assert solution.status is Status.ok
    assert solution.value.bulk == pytest.approx(TRIANGULAR_BULK_MODULUS, rel=1e-10)


def test_honeycomb_at_rest_is_critical():
    network = honeycomb_network(4, 4)
    solution = elastic_moduli(network, network.positions)
    assert solution.status is Status.ok
    critical = CriticalManifold(network).configuration(np.ones(48))
    assert transition_moduli(critical).bulk == pytest.approx(HONEYCOMB_BULK_MODULUS, rel=1e-13)
    # Its self-stresses include the uniform one; B counts all of them and the symmetric one does all the work.
    assert solution.value.bulk == pytest.approx(HONEYCOMB_BULK_MODULUS, rel=1e-10)


@pytest.mark.parametrize("name", ["voronoi", "voronoi 3D", "oblique"])
def test_moduli_off_the_manifold_are_exactly_zero(name):
    network = NETWORKS[name]()
    rng = np.random.default_rng(2)
    x = network.positions + 0.01 * rng.standard_normal(network.positions.shape)
    solution = elastic_moduli(network, x)
    assert solution.status is Status.floppy
    assert (solution.value.bulk, solution.value.shear, solution.value.shear_stress_corrected) == (0.0, 0.0, 0.0)


@pytest.mark.parametrize("name", ["voronoi", "voronoi, random stiffness", "voronoi 3D"])
def test_springs_at_rest_have_the_transition_moduli(name):
    network = NETWORKS[name]()
    critical = CriticalManifold(network).configuration(random_stress(network.n_edges, 3))
    solution = elastic_moduli(network, critical.coordinates)
    assert solution.status is Status.ok
    expected = transition_moduli(critical)
    assert solution.value.bulk == pytest.approx(expected.bulk, rel=1e-9)
    assert solution.value.shear == pytest.approx(expected.shear, rel=1e-7)


def test_elastic_moduli_past_the_transition_are_linear_response():
    critical = critical_of("2D")
    state = strain_path(critical.network, critical, [0.01]).value.states[0]
    solution = elastic_moduli(state.network, state.coordinates, state.rest_lengths)
    assert solution.status is Status.ok
    assert solution.value.bulk == pytest.approx(linear_response(state).value.bulk, rel=1e-9)


def test_springs_out_of_equilibrium_raise():
    network = voronoi_network(20, seed=1)
    with pytest.raises(InputError, match="equilibrium"):
        elastic_moduli(network, network.positions, np.ones(30))


def test_compressed_springs_are_unstable():
    critical = critical_of("2D")
    state = spring_state(critical.network, critical.lengths, critical.coordinates).deformed(0.95 * np.eye(2))
    solution = linear_response(state)
    assert solution.status is Status.unstable
    assert np.isnan(solution.value.bulk)


def test_springs_at_rest_have_moduli_or_a_status():
    critical = critical_of("2D")
    solution = linear_response(spring_state(critical.network, critical.lengths, critical.coordinates))
    assert isinstance(solution.status, Status)


def test_slack_parts_do_not_contribute():
    network = voronoi_network(100, seed=1)
    lengths = 1 + 0.3 * np.random.default_rng(0).standard_normal(150)
    critical = critical_from_lengths(network, lengths, throw=False)
    assert critical.status is Status.slack_edges
    stressed = critical.value.sigma > 0
    part, vertices = network.part(stressed)
    whole = transition_moduli(critical.value)
    alone = transition_moduli(CriticalManifold(part).configuration(critical.value.sigma[stressed]))
    assert len(vertices) <= 100
    assert whole.bulk == pytest.approx(alone.bulk, rel=1e-10)


@pytest.mark.parametrize("stride", [5, pytest.param(1, marks=pytest.mark.sweep)])
def test_moduli_at_all_distances_from_the_transition(stride):
    found = []
    for name, make in SMALL_NETWORKS.items():
        for gamma in STRAINS[:: stride if name == "voronoi" else 4 * stride]:
            state = equilibrium(strained(make(), gamma)).value
            solution = linear_response(state)
            assert solution.status is Status.ok
            assert solution.stats.condition > 0.1 / gamma
            bounds = astuple(solution.stats.error_bound)
            # No digits are lost near the transition.
            assert max(bounds) < 1e-13
            found += bounds_over_errors(astuple(solution.value), bounds, exact_moduli(state))
    assert np.median(found) < 100


@pytest.mark.parametrize("gamma, tolerance", [(0.1, 1e-6), (0.1, 1e-10), (1e-3, 1e-8), (1e-3, 1e-12)])
def test_moduli_of_an_unfinished_relaxation(gamma, tolerance):
    state = equilibrium(strained(SMALL_NETWORKS["voronoi"](), gamma), "fire", tolerance).value
    solution = linear_response(state)
    found = bounds_over_errors(astuple(solution.value), astuple(solution.stats.error_bound), exact_moduli(state))
    assert solution.status is Status.ok
    assert max(found) < 100


@pytest.mark.parametrize("gamma, off", [(1e-3, 1e-4), (1e-4, 1e-4), (1e-5, 1e-6)])
def test_moduli_far_from_equilibrium_are_ill_conditioned(gamma, off):
    # Extensions are about γ/2, so such displacements change every stress.
    state = strained(SMALL_NETWORKS["voronoi"](), gamma)
    state = state.moved(off * np.random.default_rng(1).standard_normal((len(state.network.free), 2)))
    solution = linear_response(state)
    assert solution.status is Status.ill_conditioned
    assert np.isnan(astuple(solution.value)).all()
