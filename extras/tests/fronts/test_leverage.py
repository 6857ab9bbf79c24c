"""Cutting edges: exact values against new factorisations, the closed form at the largest bulk modulus, bad input."""

import numpy as np
import pytest
from problems import random_stress, with_random_stiffness
from units import in_units

from critflow import (
    CriticalConfiguration,
    CriticalManifold,
    InputError,
    Network,
    Status,
    lattice,
    optimize,
    voronoi_network,
)
from critflow_extras import edge_leverage, foam_network, properties
from workflows.benchmarks import reference
from workflows.benchmarks.high_precision import dot, numbers, precise, solve

NETWORKS = {
    "plane": lambda: with_random_stiffness(voronoi_network(n_vertices=30, seed=1), seed=2),
    "sheared": lambda: voronoi_network(n_vertices=30, seed=3).deformed([[1.0, 0.6], [0.0, 1.1]]),
    "space": lambda: foam_network(n_vertices=60, seed=1),
}


@precise
def exact_bypass(network, sigma):
    """1 − σ_α g_αᵀ P⁻¹ g_α of each edge, (N_b,)."""
    sigma, g = numbers(sigma), reference.incidence(network)
    return 1 - sigma * dot(g, solve(reference.laplacian(network, sigma), g.T).T)


@pytest.fixture(scope="module", params=NETWORKS)
def network(request):
    return NETWORKS[request.param]()


NAMES = ("B_0", "G_0", "V_L", "S_xy", "C_B", "C_xxyy")


@pytest.mark.parametrize("name", NAMES)
def test_values_are_those_of_the_cut_networks(network, name):
    if name == "C_B" and network.dimension == 3:
        pytest.skip("a bordered solve an edge: the planar networks show the same")
    sigma = random_stress(network.n_edges, seed=4)
    critical = CriticalManifold(network).configuration(sigma)
    found = edge_leverage(critical, name).value
    assert found.before == pytest.approx(properties(critical, name).values[name], rel=1e-12)
    for edge in (0, 7, network.n_edges - 1):
        there = CriticalManifold(network.without_edges(edge)).configuration(np.delete(sigma, edge))
        assert found.after[edge] == pytest.approx(properties(there, name).values[name], rel=1e-9)
    assert ((found.bypass > 0) & (found.bypass < 1)).all()


def test_the_best_cut_of_the_stiffest_network_has_a_closed_form():
    network = NETWORKS["plane"]()
    best = optimize(network, "B_0").value
    found = edge_leverage(best).value
    # ΔB_0 = −k|L|²/(d² V (1 − k r)), and the cut network is again the stiffest.
    scale = best.sigma / network.stiffness
    np.testing.assert_allclose(scale, scale[0], rtol=1e-12)
    expected = -network.stiffness * best.lengths**2 / (4 * network.volume * found.bypass)
    np.testing.assert_allclose(found.change, expected, rtol=1e-9, atol=0)
    edge = int(found.change.argmax())
    assert found.after[edge] == pytest.approx(optimize(network.without_edges(edge), "B_0").objective, rel=1e-10)


@pytest.mark.parametrize("decades", [8, 10, 12])
@pytest.mark.parametrize("seed", [0, 3])
def test_stresses_over_many_decades(decades, seed):
    network = with_random_stiffness(voronoi_network(n_vertices=20, seed=seed), seed)
    critical = CriticalManifold(network).solve(10.0 ** (-decades * np.random.default_rng(seed).random(30))).value
    sigma, digits = critical.sigma, 60
    solution = edge_leverage(critical)
    assert solution.status is Status.ok
    found, ratios = solution.value, []
    errors = np.abs((found.bypass - exact_bypass(network, sigma, digits=digits)).astype(float))
    assert (errors <= found.bypass_errors).all() and (found.bypass_errors < 1e-8 * found.bypass).all()
    for edge in range(0, 30, 3):
        there = network.without_edges(edge)
        cut = reference.configuration(there, np.delete(sigma, edge), digits=digits)
        error = abs(float(found.after[edge] - reference.transition_moduli(there, cut, digits=digits)[0]))
        ratios.append(found.errors[edge] / max(error, 1e-17))
    assert min(ratios) >= 1 and np.median(ratios) < 1000
    assert (found.errors < 1e-4 * found.after).all()


def errors_in_multiples(network, critical, edges, digits=60):
    """Claimed over true errors of B_0 after the cuts of edges."""
    found, ratios = edge_leverage(critical).value, []
    for edge in edges:
        cut = reference.configuration(network.without_edges(edge), np.delete(critical.sigma, edge), digits=digits)
        exact = reference.transition_moduli(network.without_edges(edge), cut, digits=digits)[0]
        ratios.append(found.errors[edge] / max(abs(float(found.after[edge] - exact)), 1e-18))
    return np.array(ratios)


@pytest.mark.parametrize(("seed", "edge"), [(0, 2), (9, 8), (28, 3), (46, 2), (48, 10)])
def test_soft_edges_between_stiff_ones_have_the_rounding_of_their_forces(seed, edge):
    network = lattice("honeycomb", 2, 2)
    critical = CriticalManifold(network).configuration(10.0 ** (-11 * np.random.default_rng(seed).random(12)))
    assert errors_in_multiples(network, critical, [edge]) >= 1


def test_an_edge_to_its_own_image_moves_nothing():
    network = Network([[0, 1], [1, 0], [0, 1], [0, 0]], [[0, 0], [1, 0], [0, 1], [1, 1]], np.eye(2))
    critical = CriticalManifold(network).configuration([1.0, 2.0, 3.0, 0.5])
    found = edge_leverage(critical).value
    assert found.bypass[3] == 1 and found.bypass_errors[3] < 1e-13
    assert errors_in_multiples(network, critical, range(4)).min() >= 1


@pytest.mark.parametrize("length", [2.0**-30, 1.0, 2.0**30])
def test_a_cut_after_which_edges_hold_a_source_has_no_value(length):
    # Without edge 2 a straight chain of two edges joins vertices 0 and 11.
    network = in_units(voronoi_network(n_vertices=14, seed=1), 1.0, length)
    solution = edge_leverage(CriticalManifold(network).configuration(random_stress(21, 1)), "local[0-11,5-0]")
    assert solution.status is Status.ok
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(solution.value.after)), [2])


def test_cuts_that_rounding_hides_are_named():
    network = voronoi_network(n_vertices=20, seed=0)
    sigma = 10.0 ** (-14 * np.random.default_rng(0).random(30))
    solution = edge_leverage(
        CriticalConfiguration(network, sigma, network.positions, network.bond_vectors(network.positions))
    )
    assert solution.status is Status.ill_conditioned and np.isnan(solution.value.after).all()


def test_bad_input_is_one_sentence():
    critical = CriticalManifold(NETWORKS["plane"]()).configuration(np.ones(45))
    with pytest.raises(InputError, match="colour"):
        edge_leverage(critical, "colour")
    with pytest.raises(InputError, match="edge 45"):
        NETWORKS["plane"]().without_edges(45)
