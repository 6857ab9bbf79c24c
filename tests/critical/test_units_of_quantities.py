"""Configurations, moduli, errors and modes in other units of stiffness and length: the same digits."""

from functools import partial

import numpy as np
from problems import NETWORKS, critical_of, random_stress, slack_lattice, voronoi_3d, with_random_stiffness
from units import same_in_units

from critflow import CriticalManifold, isogonal_modes
from critflow.isogonal import affine_bulk_modulus, face_modes
from critflow.manifold import critical_configuration
from critflow.quantities import (
    PenalisedModulus,
    TransitionModulus,
    flat_directions,
    pure_shear,
    transition_modulus_error,
)
from critflow.taut_part import backbone


def configuration(network, units, signed=False):
    sigma = random_stress(network.n_edges, 1)
    sigma[::6] *= -0.3 if signed else 1
    found = CriticalManifold(network).solve(sigma)
    critical = found.value
    return {
        "number": (found.status, found.negative_pivots, found.stats.condition, critical.sigma, critical.residual),
        "length": (critical.coordinates, critical.bond_vectors, critical.error_bound, critical.bond_errors),
    }


def moduli(network, units, signed=False):
    sigma = random_stress(network.n_edges, 1)
    sigma[::6] *= -0.3 if signed else 1
    d, critical = network.dimension, CriticalManifold(network).configuration(sigma)
    penalised = PenalisedModulus(TransitionModulus(pure_shear(d), "G_0"), 0.2).evaluate(critical)[0]
    modulus = "stiffness" if d == 2 else "pressure"
    error = transition_modulus_error(pure_shear(d), critical)
    return {modulus: (penalised, error, affine_bulk_modulus(critical))}


def error_of_a_modulus(network, units):
    return {"stiffness": (transition_modulus_error(pure_shear(network.dimension), critical_of(network)),)}


def modes(network, units):
    critical = critical_of(network)
    every, local = isogonal_modes(critical), face_modes(critical)
    step, flat = np.arange(1.0, 1 + every.n_independent), flat_directions(critical_of(network), "B_0")
    walked, far = every.walk(0.01 * units.length * step), every.towards(step)
    return {
        "number": (every.n_independent, local.n_independent, *every.gap, flat.n_flat, every.elongations, *flat.gap),
        "length": (walked.coordinates, far.coordinates, every.limit(step)),
        "stiffness": (flat.eigenvalues,),
    }


def largest(network, units):
    found = face_modes(critical_of(network)).largest(np.arange(network.n_edges), 0.05 * units.length)
    return {"length": (found.value.lengths, found.amplitudes)}


def of_a_backbone(network, units):
    critical = slack_lattice()[2]
    bone = backbone(critical_configuration(network, critical.sigma, units.length * critical.coordinates))
    part = bone.configuration
    return {
        "number": (bone.taut, part.sigma, bone.floppy_vertices, part.residual),
        "length": (part.coordinates, part.bond_vectors, part.bond_errors),
    }


NETWORK, SPACE = NETWORKS["voronoi, random stiffness"], lambda: with_random_stiffness(voronoi_3d(), 4)
test_the_transition_in_other_units = same_in_units(
    {name: (configuration, NETWORKS[name]) for name in ("oblique", "pinned grid", "own images")}
    | {"configuration, signed": (partial(configuration, signed=True), NETWORK)}
    | {"moduli": (moduli, NETWORK), "moduli, signed": (partial(moduli, signed=True), NETWORK)}
    | {"moduli in space": (moduli, SPACE), "modes": (modes, NETWORK)}
    | {"backbone": (of_a_backbone, lambda: slack_lattice()[0])},
    rtol=1e-14,
)
test_programs_in_other_units = same_in_units({"largest": (largest, NETWORK)}, 1e-9)
# The volume rounds otherwise in other units, and with it the rounding that is the error.
test_an_error_in_other_units = same_in_units(
    {"error of a modulus": (error_of_a_modulus, lambda: NETWORKS["pinned grid"]().with_volume(9.0))}, 0.05
)
