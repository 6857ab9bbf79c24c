"""Strain paths in other units of stiffness and length: the same steps, statuses and digits."""

from dataclasses import replace
from functools import partial

import numpy as np
from path_units import of_path, of_springs
from problems import NETWORKS, critical_of, partly_compressed, slack_lattice, stiff_lattice, voronoi_3d
from units import same_in_units

from critflow import CriticalManifold, WormLike, lattice, spring_state, strain_path
from critflow.deformation import deformation_of
from critflow.manifold import critical_configuration
from critflow.paths import balanced, keeps_lengths, loosened, relaxation, weakly_stressed


def from_transition(network, units, strains=(1e-6, 1e-3, 0.1), **options):
    return of_path(strain_path(critical_of(network), strains, throw=False, **options), units)


def of_a_branch(network, units, strains, **options):
    sigma = partly_compressed(20, 12).sigma
    return of_path(strain_path(CriticalManifold(network).configuration(sigma), strains, throw=False, **options), units)


def of_a_taut_part(network, units):
    critical = slack_lattice()[2]
    there = critical_configuration(network, critical.sigma, units.length * critical.coordinates)
    return of_path(strain_path(there, [1e-4, 1e-3], taut_only=True), units)


def stretched(network, size):
    x = network.positions
    return spring_state(network, size * np.linalg.norm(network.bond_vectors(x), axis=1), x)


def judged(network, units):
    """What is rounding: work that loosens, stresses of a strain, and corrections of a relaxation."""
    springs = stretched(network, 1 - 1e-9)
    shear = np.array([[0.0, 1.0], [0.0, 0.0]])
    loosens = [
        loosened(springs, springs.network.stiffness, deformation_of(shear - part * np.eye(2), 2), 1.0)
        for part in np.logspace(-20, 0, 41)
    ]
    rest = [stretched(network, 1 - part) for part in np.logspace(-16, -1, 31)]
    strains = np.logspace(-10, 0, 21)
    cells = [(1 + 0.5 * strain) * np.eye(2) for strain in strains]
    weak = [[weakly_stressed(one, cell), keeps_lengths(one, cell)] for one in rest for cell in cells]
    noise = units.length * np.random.default_rng(1).standard_normal(springs.forces.shape)
    at_rest = [balanced(one.moved(part * noise)) for part in strains for one in rest[::9]]
    # The Hessian of softer springs makes each correction larger than the one before it.
    tense = stretched(network, 0.9)
    others = [replace(tense, network=network.with_stiffness(part * network.stiffness)) for part in (0.25, 1, 1.5)]
    factors = [other.factorize() for other in others]
    relaxes = [np.isfinite(relaxation(tense, factor, tense.bond_vectors @ shear.T)[1]) for factor in factors]
    assert relaxes == [False, True, True]
    return {"number": (loosens, weak, at_rest, relaxes)}


NETWORK, BRANCH = NETWORKS["voronoi, random stiffness"], lambda: partly_compressed(20, 12).network
SHEAR = {"deformation": "pure_shear"}
test_paths_in_other_units = same_in_units(
    {
        "dilation": (from_transition, NETWORK),
        "energies": (partial(from_transition, measure="energy"), NETWORK),
        "moduli": (partial(from_transition, measure="moduli"), NETWORK),
        "shear": (partial(from_transition, **SHEAR), NETWORK),
        "exponential": (partial(from_transition, deformation=lambda e: np.diag([np.exp(e), 1 + e**2])), NETWORK),
        "worm-like": (partial(from_transition, law=WormLike(0.02), strains=(0.01, 0.03, 0.06)), NETWORK),
        "loosening": (partial(from_transition, strains=(-0.01, -0.02)), NETWORK),
        "below the cell": (partial(from_transition, strains=(1e-17,)), NETWORK),
        "branch": (partial(of_a_branch, strains=[0.1, 0.5]), BRANCH),
        "shear of a branch": (partial(of_a_branch, strains=[1e-7, 1e-4, 1e-2], **SHEAR), BRANCH),
        "springs": (of_springs, lambda: stiff_lattice().network),
        "judgements": (judged, lambda: lattice("honeycomb", 3, 4)),
        "no work": (partial(from_transition, deformation="simple_shear"), lambda: lattice("honeycomb", 3, 3)),
        "taut part": (of_a_taut_part, lambda: slack_lattice()[0]),
        "space": (from_transition, voronoi_3d),
    }
)
