"""Uniqueness of the self-stress by directions around vertices, against counts by singular values."""

from dataclasses import replace

import numpy as np
import pytest
from problems import NETWORKS, random_stress, stressed_lines

from critflow import CriticalManifold, InputError, Network, elasticity, stiffening, voronoi_network
from critflow.manifold import CriticalConfiguration
from critflow.self_stress import Spectrum, only_self_stress


@pytest.mark.parametrize("n", [1, 2, 3, 4])
def test_hidden_self_stresses_are_counted(n):
    critical = stressed_lines(n)
    assert critical.network.n_edges - 2 * len(critical.network.free) <= 2
    assert not only_self_stress(critical)
    with pytest.raises(InputError, match="one self-stress"):
        stiffening(critical)


@pytest.mark.parametrize("name", NETWORKS)
@pytest.mark.parametrize("seed", [1, 2])
def test_criterion_agrees_with_the_count(name, seed):
    network = NETWORKS[name]()
    critical = CriticalManifold(network).configuration(random_stress(network.n_edges, seed))
    count = Spectrum(network, critical.coordinates).n_self_stresses
    assert only_self_stress(critical) == (count == 1)


ENDS = {0: [0, 0], 2: [2, 0]}


@pytest.mark.parametrize(
    "edges, pins, sigma, unique",
    [
        ([[0, 1], [1, 2], [3, 4], [4, 5]], ENDS | {3: [0, 1], 5: [2, 1]}, [1.0, 1, 1, 1], False),
        ([[0, 1], [1, 2], [0, 2]], ENDS, [1.0, 1, 1], False),
        ([[0, 1], [1, 2]], ENDS, [1.0, 2], True),
    ],
    ids=["two chains", "an edge between pins", "one chain"],
)
def test_disjoint_self_stresses_are_two(edges, pins, sigma, unique):
    """Chains between pins: each is in balance alone, and no free vertex is shared."""
    critical = CriticalManifold(Network(edges, pins=pins)).configuration(sigma)
    assert only_self_stress(critical) == unique


def test_directions_within_their_errors_are_parallel():
    critical = CriticalManifold(voronoi_network(40, seed=1)).configuration(np.ones(60))
    assert only_self_stress(critical)
    blurred = CriticalConfiguration(
        critical.network, critical.sigma, critical.coordinates, critical.bond_vectors, 0.1, 0.5 * critical.lengths
    )
    assert not only_self_stress(blurred)
    # The count decides.
    assert elasticity(blurred).value.bulk == elasticity(critical).value.bulk


def test_ambiguous_count_has_a_status():
    critical = stressed_lines(2)
    moved = critical.coordinates + 1e-9 * np.random.default_rng(0).standard_normal(critical.coordinates.shape)
    blurred = CriticalConfiguration(critical.network, critical.sigma, moved, critical.network.bond_vectors(moved))
    with pytest.raises(InputError, match="rounding"):
        stiffening(blurred)


@pytest.mark.parametrize("direction", [(1.0, 0.0), (0.6, 0.8)])
def test_parallel_edges_without_errors_are_not_taken_apart(direction):
    # Two springs to one pin and one to the other, on a line: two self-stresses.
    line = Network([[0, 1], [0, 1], [1, 2]], pins={0: [0.0, 0.0], 2: list(direction)})
    critical = replace(CriticalManifold(line).configuration(np.ones(3)), bond_errors=np.zeros(3))
    assert Spectrum(line, critical.coordinates).n_self_stresses == 2
    assert not only_self_stress(critical)


@pytest.mark.parametrize("height, proved", [(1e-3, True), (6e-8, False)])
def test_directions_out_of_a_plane_by_less_than_the_root_of_rounding_prove_nothing(height, proved):
    # The square of the height is an eigenvalue of 1.4e-14, which rounding of the directions may hide.
    ends = [[1, 0, height], [-1, 0, height], [0, 1, -height], [0, -1, -height]]
    star = Network([[4, 0], [4, 1], [4, 2], [4, 3]], pins=dict(enumerate(ends)))
    critical = replace(CriticalManifold(star).configuration(np.ones(4)), bond_errors=np.zeros(4))
    assert only_self_stress(critical) == proved
