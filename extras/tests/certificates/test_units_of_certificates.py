"""Counts and certificates in other units of stiffness and length: the same singular values, spaces and statuses."""

from functools import partial

import numpy as np
import pytest
from problems import NETWORKS, critical_of, random_stress, stressed_lines, taut_rows, triangular_lattice
from units import same_in_units

from critflow import lattice, voronoi_network
from critflow.manifold import critical_configuration
from critflow.self_stress import edge_without_length, only_self_stress
from critflow_extras import certify, rigidity, self_stresses
from critflow_extras.certificates.counts import stiffness_error
from critflow_extras.certificates.spaces import zero_modes


def counted(network, x, **options):
    found, modes = rigidity(network, x, **options), zero_modes(network, x)
    counts = found.value
    numbers = (counts.n_self_stresses, counts.n_zero_modes, counts.largest_zero, counts.smallest_nonzero)
    return {"number": (found.status, found.note, *numbers, counts.self_stresses, counts.rigid, modes.value.modes)}


def of_a_transition(network, units):
    critical = critical_of(network)
    certificate, space = certify(critical), self_stresses(critical)
    numbers = (certificate.residual, certificate.rigid, *certificate.gap, certificate.least_tension)
    stresses = (space.value.dimension, space.value.basis, space.stats.residual, only_self_stress(critical))
    found = counted(network, critical.coordinates)
    return {"number": (*numbers, *stresses, *found["number"])}


def off_balance(network, units, size, **options):
    x = critical_of(network).coordinates
    noise = size * units.length * np.random.default_rng(3).standard_normal(x.shape)
    return counted(network, x + noise, **options)


def of_positions(network, units):
    return counted(network, network.positions)


def of_parts(critical, network, units):
    there = critical_configuration(network, critical.sigma, units.length * critical.coordinates)
    found = certify(there)
    return {"number": (found.n_self_stresses, found.n_slack, found.rigid, found.stressed_fraction, *found.gap)}


PARTS = {"rows": taut_rows, "lines": lambda: stressed_lines(3)}
test_certificates_in_other_units = same_in_units(
    {
        name: (of_a_transition, NETWORKS[name])
        for name in ("voronoi, random stiffness", "pinned grid", "oblique", "voronoi 3D")
    }
    | {f"off by {size}": (partial(off_balance, size=size), NETWORKS["voronoi"]) for size in (1e-9, 1e-6, 1e-3)}
    | {"sparse": (of_a_transition, lambda: voronoi_network(300, seed=1))}
    | {"sparse, off balance": (partial(off_balance, size=1e-6), lambda: voronoi_network(300, seed=1))}
    | {"honeycomb": (of_positions, lambda: lattice("honeycomb", 12, 12))}
    | {"triangular": (of_positions, lambda: triangular_lattice(4, 4)[0])}
    | {name: (partial(of_parts, make()), lambda make=make: make().network) for name, make in PARTS.items()}
)


@pytest.mark.parametrize("unit", [2.0**-40, 1.0, 2.0**40])
def test_an_edge_has_no_length_relative_to_the_others(unit):
    lengths = unit * np.ones(5)
    assert not edge_without_length(lengths)
    lengths[3] = 1e-13 * unit
    assert "edge 3 has no length" in edge_without_length(lengths)
    lengths[3] = 1e-3 * unit
    assert not edge_without_length(lengths)


@pytest.mark.parametrize("name", ["voronoi", "pinned grid", "voronoi 3D"])
def test_the_error_of_a_stiffness_is_that_of_turned_modes_and_changed_stresses(name):
    """z·P(σ)z changes by at most `stiffness_error`, and that is no more than thirty times a change that occurs."""
    network, rng, turned, largest = NETWORKS[name](), np.random.default_rng(1), 1e-4, 0.0
    sigma, g = random_stress(network.n_edges, 2), network.free_incidence.toarray()
    bound = stiffness_error(network, sigma, turned)
    P = g.T @ np.diag(sigma) @ g
    for z in [*rng.standard_normal((20, len(P))), np.linalg.eigh(P)[1][:, -1]]:
        z = z / np.linalg.norm(z)
        change = rng.standard_normal((10, len(z)))
        change *= turned / np.linalg.norm(change, axis=1)[:, None]
        changed_stress = sigma * (1 + turned * rng.choice([-1, 1], (10, len(sigma))))
        for one, stress in zip([*change, turned * z], [*changed_stress, (1 + turned) * sigma], strict=True):
            there = z + one
            largest = max(largest, abs(there @ (g.T @ np.diag(stress) @ g) @ there - z @ P @ z))
    assert largest <= bound <= 30 * largest
    assert stiffness_error(network, -2 * sigma, turned) == pytest.approx(2 * bound)
