"""Paths of cables and in free cells in other units of stiffness and length: the same steps, statuses and digits."""

from dataclasses import replace
from functools import partial

from path_units import of_path, of_springs
from problems import slack_lattice, stiff_lattice
from units import same_in_units

from critflow import Cable, equilibrium, spring_state, strain_path
from critflow.manifold import critical_configuration


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


test_paths_in_other_units = same_in_units(
    {
        "cables": (floppy, lambda: slack_lattice()[0]),
        "free springs": (partial(of_springs, deformation="uniaxial_free"), lambda: stiff_lattice().network),
        "modulus next to slack cables": (modulus_next_to_slack_cables, lambda: slack_lattice()[0]),
    }
)
