"""Moduli, stiffening coefficients and their errors in other units of stiffness and length: the same digits."""

from dataclasses import astuple, replace
from functools import partial

import numpy as np
from problems import NETWORKS, critical_of, slack_lattice, stiff_lattice, strained, voronoi_3d, with_random_stiffness
from units import Units, same_in_units

from critflow import (
    Cable,
    CriticalManifold,
    PowerLaw,
    WormLike,
    elasticity,
    equilibrium,
    lattice,
    spring_state,
    stiffening,
)
from critflow.linear_response import linear_response
from critflow.manifold import critical_configuration


def of_response(found, d, units):
    value, errors = found.value, found.value.errors
    moduli = (value.tensor, value.affine, value.stress, value.bulk, value.shear, value.shear_stress_corrected)
    known = (errors.tensor, errors.bulk, errors.shear, errors.shear_stress_corrected)
    return {
        "number": (found.status, found.note, found.stats.condition),
        "stiffness" if d == 2 else "pressure": (*moduli, *known),
    }


def at_transition(network, units):
    return of_response(elasticity(critical_of(network)), network.dimension, units)


def with_large_errors(network, units):
    critical = critical_of(network)
    return of_response(elasticity(replace(critical, bond_errors=0.1 * critical.lengths)), 2, units)


def under_stress(network, units, gamma, tolerance=1e-14, **options):
    state = equilibrium(strained(network, gamma), "newton" if tolerance < 1e-10 else "fire", tolerance).value
    found = linear_response(state, state.network.volume, **options)
    response = of_response(found, network.dimension, units)
    return response | {"length": (found.responses,), "number": (*response["number"], found.stats.residual)}


def compressed(network, units):
    state = stiff_lattice()
    springs = spring_state(network, units.length * state.rest_lengths, units.length * state.coordinates)
    return of_response(elasticity(equilibrium(springs).value), 2, units)


def with_floppy_parts(network, units):
    """Slack cables next to taut ones."""
    critical = slack_lattice()[2]
    rest, x = 0.999 * units.length * critical.rest_lengths, units.length * critical.coordinates
    state = equilibrium(spring_state(network, rest, x, Cable())).value
    return of_response(elasticity(state), 2, units)


def growth(network, units, **options):
    solution = stiffening(critical_of(network), throw=False, **options)
    rows = (astuple(solution.value), astuple(solution.stats.error_bound) if solution.ok else ())
    return {
        "number": (solution.status, solution.note),
        "stiffness" if network.dimension == 2 else "pressure": rows,
    }


def growth_of_a_taut_part(network, units):
    critical = slack_lattice()[2]
    found = stiffening(critical_configuration(network, critical.sigma, units.length * critical.coordinates))
    return {"stiffness": (astuple(found.value), astuple(found.stats.error_bound))}


NETWORK, SPACE = NETWORKS["voronoi, random stiffness"], lambda: with_random_stiffness(voronoi_3d(), 1)
test_responses_in_other_units = same_in_units(
    {
        "transition": (at_transition, NETWORK),
        "transition in space": (at_transition, SPACE),
        "large errors": (with_large_errors, NETWORK),
        **{f"strain {gamma}": (partial(under_stress, gamma=gamma), NETWORK) for gamma in (0.1, 1e-4, 1e-9)},
        "unfinished": (partial(under_stress, gamma=1e-2, tolerance=1e-8), NETWORK),
        "far from balance": (partial(under_stress, gamma=1e-4, tolerance=1e-3), NETWORK),
        "exact": (partial(under_stress, gamma=0.1, exact=True), NETWORK),
        "under stress in space": (partial(under_stress, gamma=0.1), SPACE),
        "compressed": (compressed, lambda: stiff_lattice().network),
        "floppy parts": (with_floppy_parts, lambda: slack_lattice()[0]),
        "affine": (partial(under_stress, gamma=0.1), lambda: lattice("honeycomb", 3, 3)),
        "stiffening": (growth, NETWORK),
        "stiffening in space": (growth, SPACE),
        "stiffening of a law": (partial(growth, law=PowerLaw(4.5), deformation="uniaxial"), NETWORK),
        "stiffening of worms": (partial(growth, law=WormLike(0.2)), lambda: lattice("honeycomb", 3, 3)),
        "stiffening of a taut part": (growth_of_a_taut_part, lambda: slack_lattice()[0]),
    },
)


def affine(network, units):
    """Of equal stresses: no vertex of a lattice moves relative to a dilation, but by rounding."""
    critical = CriticalManifold(network).configuration(np.ones(network.n_edges))
    state = spring_state(network, critical.lengths, critical.coordinates).deformed(np.sqrt(1.001) * np.eye(2))
    return of_response(linear_response(equilibrium(state).value, network.volume), 2, units)


# Displacements by rounding alone, in units in which they are far above 1 and far below it.
test_affine_responses_in_units_of_any_size = same_in_units(
    {"affine": (affine, lambda: lattice("honeycomb", 5, 7))},
    others=[Units(length=2.0**60), Units(length=2.0**-60)],
)
