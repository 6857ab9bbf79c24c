"""Errors of designs against sixty digits, from both sides, at stiffnesses other than one."""

from dataclasses import fields

import numpy as np
import pytest
from problems import bounds_over_errors, with_random_stiffness

from critflow import CriticalManifold, stiffening, upper_bound, voronoi_network
from critflow_extras import design
from workflows.benchmarks import reference
from workflows.benchmarks.high_precision import dot, numbers, roots

NETWORKS = [with_random_stiffness(voronoi_network(12, seed), seed + 1) for seed in range(4)]


def exact_values(network, sigma):
    """B_0, C_B, V_L and V_tau of the configuration that a stress balances."""
    exact = reference.configuration(network, sigma)
    names = [field.name for field in fields(stiffening(CriticalManifold(network).configuration(sigma)).value)]
    growth = reference.stiffening(network, exact)[names.index("C_B")]
    lengths = roots(dot(exact.bond_vectors, exact.bond_vectors))
    variances = [(v**2).mean() / v.mean() ** 2 - 1 for v in (lengths, numbers(sigma) * lengths)]
    bulk = reference.transition_moduli(network, exact)[0]
    return {"B_0": bulk, "C_B": growth, "V_L": variances[0], "V_tau": variances[1]}


@pytest.mark.parametrize("prefer", ["V_tau", "V_L", "least_change"])
def test_errors_of_targets_cover_those_of_the_values(prefer):
    ratios = []
    for network in NETWORKS:
        bulk = 0.9 * upper_bound(network, "B_0")
        for targets in ({"B_0": bulk}, {"B_0": bulk, "C_B": 0.1}, {"V_L": 0.1}, {"V_tau": 0.1}):
            found = design(network, targets, prefer="least_change" if prefer in targets else prefer, throw=False)
            exact = exact_values(network, found.value.sigma)
            truth = [exact[name] for name in targets]
            achieved = found.targets.values()
            ratios += bounds_over_errors([one.value for one in achieved], [one.error for one in achieved], truth)
    assert np.median(ratios) < 200


def test_bounds_hold_for_the_stored_stress():
    for seed in range(3):
        network = voronoi_network(16, seed=seed)
        value = design(network, {"B_0": 0.9 * upper_bound(network, "B_0")}).value
        exact = reference.configuration(network, value.sigma)
        off = reference.lengths(numbers(value.bond_vectors) - exact.bond_vectors).astype(float)
        assert (off <= value.bond_errors).all()
        error = reference.largest_error(value.coordinates, exact.coordinates)
        assert error <= value.error_bound < 100 * error
