"""Springs in other units of stiffness and length: the same steps, statuses and digits."""

from functools import partial

import numpy as np
from problems import NETWORKS, random_stress, triangular_lattice, voronoi_3d, with_random_stiffness
from units import same_in_units

from critflow import Cable, CriticalManifold, Hookean, PowerLaw, WormLike, equilibrium, lattice, spring_state
from critflow.equilibria import minimum_factor, stability_of


def springs(network, size=0.98, off=0.0, law=None):
    """Springs at the lengths of a critical configuration over `size`, and displaced from it."""
    critical = CriticalManifold(network).configuration(random_stress(network.n_edges, 1))
    noise = np.random.default_rng(3).standard_normal(critical.coordinates.shape)
    x = critical.coordinates + off * critical.lengths.mean() * noise
    return spring_state(network, size * critical.lengths, x, law or Hookean())


def relaxation(network, units, method="auto", tolerance=1e-14, max_steps=None, **start):
    end = equilibrium(springs(network, **start), method, tolerance, max_steps, throw=False)
    state, stats = end.value, end.stats
    return {
        "number": (end.status, end.note, stats.steps, stats.condition, state.taut(), state.unique),
        "length": (state.coordinates, state.bond_vectors, state.extension, stats.error_bound, state.length_scale),
        "force": (stats.residual, state.max_force, state.tension),
        "energy": (state.energy,),
        "stiffness": (state.sigma, state.largest_stiffness, state.stiffness_scale, state.stress_rounding),
    }


def matrices(network, units, **start):
    state = springs(network, **start)
    one = np.eye(state.forces.size)
    return {
        "number": (stability_of(state)[0], minimum_factor(state) is None),
        "stiffness": (state.factorize().multiply(one),),
    }


def compressed(network, units, part):
    state = spring_state(network, (1 + part) * np.full(network.n_edges, units.length), network.positions)
    ends = [equilibrium(state, method, throw=False) for method in ("newton", "fire")]
    return {
        "number": [
            *(end.status for end in ends),
            *(end.stats.condition for end in ends),
            *(e.stats.steps for e in ends),
        ],
        "length": [end.stats.error_bound for end in ends],
    }


NETWORK, LATTICE = NETWORKS["voronoi, random stiffness"], lambda: triangular_lattice(3, 3)[0]
RELAXATIONS = {
    "stretched": {},
    "of FIRE": {"method": "fire", "tolerance": 1e-6},
    "far away": {"off": 0.6},
    "slack": {"size": 1.05, "off": 0.02},
    "slack, of FIRE": {"size": 1.05, "method": "fire"},
    "worm-like": {"size": 0.95, "law": WormLike(0.3)},
    "power law": {"size": 0.95, "law": PowerLaw(4)},
    "cables": {"off": 0.2, "law": Cable()},
    "rough": {"tolerance": 1e-2, "off": 0.1},
    "below rounding": {"tolerance": 1e-25},
    "below rounding, weak": {"tolerance": 1e-25, "size": 0.95},
    "beyond reach": {"size": 0.98, "off": 0.1, "law": WormLike(0.01)},
    "unfinished": {"off": 0.6, "max_steps": 3},
}
test_springs_in_other_units = same_in_units(
    {name: (partial(relaxation, **start), NETWORK) for name, start in RELAXATIONS.items()}
    | {f"matrices, {size}": (partial(matrices, size=size), NETWORK) for size in (0.95, 1.0, 1.05)}
    | {"with pins": (relaxation, NETWORKS["pinned grid"])}
    | {f"lattice compressed by {part}": (partial(compressed, part=part), LATTICE) for part in (0.3, 0.02, 1e-9)}
    | {
        f"honeycomb {part}": (partial(compressed, part=part), lambda: lattice("honeycomb", 3, 3))
        for part in (0.05, 1e-14)
    }
    | {"in space": (relaxation, lambda: with_random_stiffness(voronoi_3d(), 2))}
)
