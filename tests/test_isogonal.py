"""Isogonal modes keep directions and tensions, and so the tension variance and the largest bulk modulus."""

import numpy as np
import pytest

from critflow import (
    CriticalManifold,
    InputError,
    bulk_modulus_bound,
    honeycomb_network,
    isogonal_modes,
    transition_moduli,
    voronoi_network,
)
from critflow.structure import tension_variance


@pytest.fixture(scope="module")
def modes():
    network = voronoi_network(60, seed=3).with_stiffness(np.random.default_rng(1).uniform(0.5, 2.0, 90))
    return isogonal_modes(CriticalManifold(network).configuration(network.stiffness))


@pytest.mark.parametrize("n_vertices", [20, 60, 100])
def test_there_are_half_as_many_as_vertices_less_one(n_vertices):
    network = voronoi_network(n_vertices, seed=n_vertices)
    modes = isogonal_modes(CriticalManifold(network).configuration(np.ones(network.n_edges)))
    assert len(modes.elongations) == n_vertices // 2 - 1
    low, high = modes.gap
    assert low < 1e-12 and high > 1e-3


def test_the_walk_keeps_directions_tensions_and_bulk_modulus(modes):
    before = modes.critical
    rng = np.random.default_rng(2)
    for _ in range(5):
        step = rng.standard_normal(len(modes.elongations))
        shrink = (-(step @ modes.elongations) / before.lengths).max()
        after = modes.walk(0.8 / shrink * step)
        assert np.abs(after.lengths / before.lengths - 1).max() > 0.5
        assert after.residual < 1e-12
        unit = after.bond_vectors / after.lengths[:, None]
        np.testing.assert_allclose(unit, before.bond_vectors / before.lengths[:, None], rtol=0, atol=1e-12)
        ratio = after.tensions / before.tensions
        np.testing.assert_allclose(ratio, ratio[0], rtol=1e-12)
        assert abs(tension_variance(after) - tension_variance(before)) < 1e-12
        bound = bulk_modulus_bound(before.network)
        np.testing.assert_allclose(transition_moduli(after).bulk, bound, rtol=1e-12)


def test_a_walk_to_zero_length_is_refused_with_the_largest_scale(modes):
    step = np.ones(len(modes.elongations))
    with pytest.raises(InputError, match="would lose its length") as refusal:
        modes.walk(1e3 * step)
    largest = float(str(refusal.value).rsplit(" ", 1)[1]) * 1e3
    modes.walk(0.999 * largest * step)
    with pytest.raises(InputError):
        modes.walk(1.001 * largest * step)
    with pytest.raises(InputError, match="amplitudes"):
        modes.walk(np.ones(3))


def test_the_honeycomb_can_swell_one_of_its_cells():
    critical = CriticalManifold(honeycomb_network(3, 3)).configuration(np.ones(27))
    modes = isogonal_modes(critical)
    # A hexagon that swells: its sides grow, the six edges that radiate from it shrink as much.
    faces = critical.network.faces
    sides = faces.edges[faces.starts[4] : faces.starts[5]]
    swelling = np.zeros(27)
    swelling[sides] = 1.0
    corners = np.unique(critical.network.edges[sides])
    radiating = [e for e, ends in enumerate(critical.network.edges) if e not in sides and np.isin(ends, corners).any()]
    swelling[radiating] = -1.0
    fitted = np.linalg.lstsq(modes.elongations.T, swelling, rcond=None)[0] @ modes.elongations
    np.testing.assert_allclose(fitted, swelling, rtol=0, atol=1e-10)
