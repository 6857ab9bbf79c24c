"""Factors and solves in other units of stress and length: the same digits and verdicts."""

from functools import partial

import numpy as np
from problems import NETWORKS, dense_bond_vectors, random_stress
from units import same_in_units

from critflow.saddles import Saddle
from critflow.sparse import laplacian


def stress(network, units, signed=False):
    sigma = units.stiffness * random_stress(network.n_edges, 4)
    sigma[::6] *= -0.3 if signed else 1.0
    return sigma


def factor(network, units, signed=False):
    sigma, pattern = stress(network, units, signed), laplacian(network)
    right = np.random.default_rng(5).standard_normal((pattern.size, 2))
    found, (shifted, regular, n) = pattern.factorize(sigma), pattern.factorize_shifted(sigma)
    lone = sigma * ~(network.edges == network.free[1]).any(axis=1)
    loose = pattern.factorize_signed(lone)
    return {
        "number": (found.n_negative, found.singular, found.sound, regular, n, loose.singular, loose.n_negative),
        "softness": (found.solve(right), shifted.solve(right), found.solve_roughly(right, 1e-3)),
        "stiffness": (found.pivots, found.multiply(right)),
    }


def saddle(network, units, kind, signed=False):
    sigma = stress(network, units, signed)
    L, rng, system = dense_bond_vectors(network, sigma / units.stiffness), np.random.default_rng(5), kind(network)
    forces = units.force * rng.standard_normal((len(network.free), network.dimension))
    u, multipliers, error = system.factorize(sigma, L).solve(forces, units.length**2 * rng.standard_normal(len(L)))
    stable = (system.stable(sigma, L), system.stable(-sigma, L)) if kind is Saddle else ()
    return {"number": (error, *stable), "length": (u,), "stiffness": (multipliers,)}


NETWORK = NETWORKS["voronoi"]
test_factors_in_other_units = same_in_units(
    {
        "factor": (factor, NETWORK),
        "signed": (partial(factor, signed=True), NETWORK),
        "pins": (factor, NETWORKS["pinned grid"]),
        "saddle": (partial(saddle, kind=Saddle), NETWORK),
        "signed saddle": (partial(saddle, kind=Saddle, signed=True), NETWORK),
        "saddle in space": (partial(saddle, kind=Saddle), NETWORKS["voronoi 3D"]),
    },
)
