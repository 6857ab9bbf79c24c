"""Refined solutions and their bounds in other units of stiffness and length: the same steps and digits."""

from functools import partial

import numpy as np
from problems import NETWORKS, random_stress, strained
from units import same_in_units

from critflow import CriticalManifold, equilibrium
from critflow.double_double import extended
from critflow.refinement import (
    ExtendedGeometry,
    Refinement,
    exact_bond_vectors,
    exact_displacement,
    exact_forces,
    inverse_norm,
)


def refined(network, units, distance, signed=False):
    sigma = random_stress(network.n_edges, 6)
    sigma[::6] *= -0.3 if signed else 1.0
    manifold = CriticalManifold(network)
    start = manifold.balance(sigma * (1 + distance * np.random.default_rng(1).random(len(sigma))))
    found = Refinement(ExtendedGeometry(network), extended(sigma), start.factor, start.coordinates)
    return {
        "number": (found.certain, found.condition, found.steps),
        "length": (found.x, found.L, found.error, found.L_errors),
    }


def displaced(network, units, size, shift=0.0, gain=1.0):
    sigma, manifold = random_stress(network.n_edges, 1), CriticalManifold(network)
    x = manifold.configuration(sigma).coordinates.copy()
    x[network.free] += (
        size * units.length * np.random.default_rng(2).standard_normal((len(network.free), network.dimension))
    )
    solve = manifold.prestress.factorize(sigma, shift).solve
    found = exact_displacement(network, x, lambda _: sigma, lambda f: gain * solve(f), regularised=shift > 0)
    return {"length": (found.displacement, found.remainder, found.bond_vectors)}


def of_springs(network, units, gamma):
    state = equilibrium(strained(network, gamma)).value
    factor = state.factorize()
    found = state.exact_displacement(factor)
    L = exact_bond_vectors(state.network, state.coordinates, found.displacement)
    return {
        "length": (found.displacement, found.remainder, L.high, L.low),
        "force": (exact_forces(state.network, state.exact_stress(L), L),),
        "stiffness": (1 / inverse_norm(factor, state.coordinates[state.network.free].ravel()),),
    }


NETWORK = NETWORKS["voronoi, random stiffness"]
test_refinements_in_other_units = same_in_units(
    {f"from {distance}": (partial(refined, distance=distance), NETWORK) for distance in (0.0, 1e-6, 0.3, 3.0)}
    | {"signed": (partial(refined, distance=1e-6, signed=True), NETWORK)}
    | {name: (partial(refined, distance=0.0), NETWORKS[name]) for name in ("pinned grid", "own images", "voronoi 3D")}
    | {f"off {size}": (partial(displaced, size=size), NETWORK) for size in (1e-14, 1e-6, 0.1)}
    | {"regularised": (partial(displaced, size=1e-14, shift=100.0), NETWORK)}
    | {"growing": (partial(displaced, size=1e-3, gain=2.0), NETWORK)}
    | {f"springs at {gamma}": (partial(of_springs, gamma=gamma), NETWORK) for gamma in (0.1, 1e-9)}
)
