"""Configurations from lengths in other units of length: the same steps, statuses and digits."""

from functools import partial

import numpy as np
import pytest
from problems import NETWORKS, hung_ring, random_stress, slack_lattice, voronoi_3d
from units import Units, same_in_units

from critflow import CriticalManifold, critical_from_lengths, voronoi_network
from critflow.cones import fit_lengths
from critflow.lengths import iterate_lengths
from critflow.taut_edges import Boundary, OnsetState, newton_taut


def lengths(network, spread, seed=1):
    return np.exp(spread * np.random.default_rng(seed).standard_normal(network.n_edges))


def of_lengths(network, units, spread=0.05, seed=1):
    found = critical_from_lengths(network, 3 * units.length * lengths(network, spread, seed), throw=False)
    critical, stats = found.value, found.stats
    counts = (found.status, found.note, stats.steps, found.slack_edges)
    bounds = (stats.error_bound, critical.bond_errors, critical.rest_lengths)
    return {
        "number": (*counts, stats.condition, stats.residual, critical.sigma, found.ratio),
        "length": (critical.coordinates, critical.bond_vectors, *(b for b in bounds if b is not None)),
    }


def of_the_slack_lattice(network, units):
    found = critical_from_lengths(network, units.length * slack_lattice()[1], throw=False)
    return {"number": (found.slack_edges, found.value.sigma, found.ratio), "length": (found.value.coordinates,)}


def by_cone(network, units):
    found = fit_lengths(network.free_incidence, network.boundary_vectors, units.length * lengths(network, 0.3), 1e-12)
    return {"number": (found.outcome, found.steps, found.stressed, found.ratio), "length": (found.coordinates,)}


def by_newton(network, units):
    critical = CriticalManifold(network).configuration(random_stress(network.n_edges, 1))
    x, taut = critical.coordinates[network.free], np.ones(network.n_edges, bool)
    target = critical.lengths * lengths(network, 1e-3)
    path = Boundary(CriticalManifold(network))
    end = newton_taut(path, target, OnsetState(0.0, np.zeros(0), x, critical.sigma, taut))
    return {"number": (end.strain, end.error, end.steps, end.sigma), "length": (end.coordinates,)}


def by_iteration(network, units):
    ends = list(iterate_lengths(CriticalManifold(network), units.length * lengths(network, 0.05)))
    return {"number": (len(ends), ends[-1][0].sigma)}


NETWORK = partial(voronoi_network, 100, seed=1)
test_configurations_in_other_units = same_in_units(
    {
        **{f"spread {spread}": (partial(of_lengths, spread=spread), NETWORK) for spread in (0.05, 0.15, 0.3)},
        **{name: (of_lengths, NETWORKS[name]) for name in ("oblique", "pinned grid", "own images")},
        "ring": (of_lengths, hung_ring),
        "space": (partial(of_lengths, spread=0.3), voronoi_3d),
        "lattice": (of_the_slack_lattice, lambda: slack_lattice()[0]),
        "cone": (by_cone, NETWORK),
        "Newton": (by_newton, NETWORK),
        "iteration": (by_iteration, NETWORK),
    },
    rtol=1e-6,  # of the bound, an error of a regularised system
)


@pytest.mark.parametrize("spread", [0.05, 0.4])
@pytest.mark.parametrize("exponent", [-42, -33, 20, 42])
def test_the_unit_of_lengths_is_not_that_of_the_network(spread, exponent):
    # Ratios alone count; 0.4 leaves edges slack.
    network, unit = voronoi_network(40, seed=2), 2.0**exponent
    here, other = (critical_from_lengths(network, u * lengths(network, spread), throw=False) for u in (1.0, unit))
    taut = here.value.sigma > 0  # vertices off taut edges have no certain place
    np.testing.assert_allclose(other.value.bond_vectors[taut], here.value.bond_vectors[taut], rtol=0, atol=1e-13)
    assert other.status is here.status and other.ratio * unit == pytest.approx(here.ratio, rel=1e-13)
    np.testing.assert_array_equal(other.slack_edges, here.slack_edges)
    np.testing.assert_allclose(other.value.rest_lengths, here.value.rest_lengths, rtol=1e-13)


@pytest.mark.parametrize("exponent", [-42, -33, 42])
def test_error_bounds_in_units_of_any_size(exponent):
    network, unit = voronoi_network(40, seed=2), 2.0**exponent
    here = critical_from_lengths(network, lengths(network, 0.05))
    other = critical_from_lengths(Units(length=unit).network(network), unit * lengths(network, 0.05))
    assert other.stats.error_bound == unit * here.stats.error_bound > 0
