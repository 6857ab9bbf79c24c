"""Errors of closed forms against sixty digits, from both sides, at stiffnesses other than one."""

import pytest
from problems import with_random_stiffness

from critflow import optimize, voronoi_network
from critflow.numerics import EPS
from workflows.benchmarks import reference
from workflows.benchmarks.high_precision import MP, dot, numbers

NETWORKS = [with_random_stiffness(voronoi_network(12, seed), seed + 1) for seed in range(4)]


@pytest.mark.parametrize("name", ["modulus[uniaxial]", "G_0"])
def test_the_error_of_a_closed_form_covers_value_and_bound(name):
    for network in NETWORKS:
        optimum = optimize(network, name, "closed_form", signs="any")
        exact = reference.configuration(network, optimum.value.sigma)
        stress = (exact.sigma[:, None] * exact.bond_vectors).T @ exact.bond_vectors
        energy = (exact.sigma**2 * dot(exact.bond_vectors, exact.bond_vectors) / numbers(network.stiffness)).sum()
        work = stress[0, 0] if "uniaxial" in name else stress[0, 1]
        value = work**2 / (reference.volume(network) * energy)
        rounding = EPS * network.n_edges * optimum.bound
        assert abs(MP.mpf(optimum.objective) - value) <= optimum.objective_error
        # The largest value lies between that of this stress and the bound.
        assert abs(optimum.bound - optimum.objective) + 0.9 * rounding <= optimum.objective_error
        assert optimum.objective_error < 10 * EPS * optimum.stats.condition


@pytest.mark.parametrize("network", NETWORKS)
def test_the_error_of_the_largest_bulk_modulus_covers_its_value(network):
    optimum = optimize(network, "B_0")
    exact = reference.configuration(network, network.stiffness)
    energy = (numbers(network.stiffness) * dot(exact.bond_vectors, exact.bond_vectors)).sum()
    value = energy / (network.dimension**2 * reference.volume(network))
    assert abs(MP.mpf(optimum.objective) - value) <= optimum.objective_error < 1e-11
