"""Paths of cables and in free cells in other units of stiffness and length: the same steps, statuses and digits."""

from dataclasses import replace
from functools import partial

import numpy as np
from path_units import of_path, of_springs
from problems import slack_lattice, stiff_lattice
from units import same_in_units

from critflow import Cable, critical_from_lengths, equilibrium, spring_state, strain_path, voronoi_network
from critflow.manifold import critical_configuration
from critflow_extras import critical_strain


def floppy(network, units, **options):
    """Slack cables next to taut ones."""
    critical = slack_lattice()[2]
    start = critical_configuration(network, critical.sigma, units.length * critical.coordinates)
    start = replace(start, rest_lengths=units.length * critical.rest_lengths)
    return of_path(strain_path(start, [1e-4, 1e-3], law=Cable(), throw=False, **options), units)


def modulus_next_to_slack_cables(network, units):
    critical = slack_lattice()[2]
    rest, x = 0.999 * units.length * critical.rest_lengths, units.length * critical.coordinates
    state = equilibrium(spring_state(network, rest, x, Cable())).value
    path = strain_path(state, [0.0], measure="energy").value
    return {"stiffness": (path.modulus, path.modulus_error)}


def onset(network, units):
    ratio = critical_from_lengths(network, np.full(network.n_edges, units.length), throw=False).ratio
    found = critical_strain(
        network, np.full(network.n_edges, 1.05 * ratio * units.length), "simple_shear", throw=False
    ).value
    return {"number": (found.strain, found.lower, found.upper, found.configuration.sigma)}


test_paths_in_other_units = same_in_units(
    {
        "cables": (floppy, lambda: slack_lattice()[0]),
        "free springs": (partial(of_springs, deformation="uniaxial_free"), lambda: stiff_lattice().network),
        "onset": (onset, partial(voronoi_network, 14, seed=1)),
        "modulus next to slack cables": (modulus_next_to_slack_cables, lambda: slack_lattice()[0]),
    }
)
