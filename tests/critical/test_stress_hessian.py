"""The Hessian of objectives over stress, and the flat directions at the largest bulk modulus."""

import numpy as np
import pytest
from problems import random_stress, with_random_stiffness

from critflow import CriticalManifold, InputError, isogonal_modes, lattice, voronoi_network
from critflow.quantities import flat_directions, stress_hessian


@pytest.mark.parametrize(("n_vertices", "seed"), [(60, 1), (80, 2), (100, 3)])
def test_flat_directions_of_the_largest_bulk_modulus(n_vertices, seed):
    network = with_random_stiffness(voronoi_network(n_vertices, seed=seed), seed)
    best = CriticalManifold(network).configuration(network.stiffness)
    modes = isogonal_modes(best)
    # The same at another maximiser, displaced by a random isogonal mode.
    step = np.random.default_rng(seed).standard_normal(len(modes.elongations))
    shrink = (-(step @ modes.elongations) / best.lengths).max()
    for critical in (best, modes.walk(0.5 / shrink * step)):
        flat = flat_directions(critical)
        assert flat.n_flat == n_vertices // 2
        assert flat.gap[0] < 1e-12 and flat.gap[1] > 1e-3
        # No positive curvature at a maximum.
        assert flat.eigenvalues[-1] < 1e-12 * abs(flat.eigenvalues[0])
        # At constant tension σ|L| an elongation e changes σ by −σ e/|L|.
        elongations = isogonal_modes(critical).elongations
        expected = np.concatenate([critical.sigma[None], -critical.sigma * elongations / critical.lengths])
        assert np.linalg.matrix_rank(expected) == n_vertices // 2
        outside = expected - (expected @ flat.directions.T) @ flat.directions
        assert np.abs(outside).max() < 1e-10 * np.abs(expected).max()


def test_no_flat_directions_below_the_maximum():
    network = voronoi_network(60, seed=1)
    flat = flat_directions(CriticalManifold(network).configuration(random_stress(90, 1)))
    assert flat.n_flat == 0
    assert flat.eigenvalues[0] < 0 < flat.eigenvalues[-1]


def test_large_networks_raise():
    network = lattice("honeycomb", 30, 24)
    critical = CriticalManifold(network).configuration(np.ones(network.n_edges))
    with pytest.raises(InputError, match="2000"):
        flat_directions(critical)
    # Products with vectors have no limit of size.
    assert np.abs(stress_hessian(critical) @ critical.sigma).max() < 1e-12
