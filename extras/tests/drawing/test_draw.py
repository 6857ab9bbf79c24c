"""Drawn networks and states: colours of stiffnesses, margins and fixed vertices, discs of vertices."""

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.collections import PathCollection
from problems import critical_of, pinned_grid, random_stress
from refusals import refused

from critflow import CriticalManifold, lattice, spring_state, voronoi_network
from critflow_extras import draw

NETWORKS = {
    "voronoi": lambda: voronoi_network(40, seed=1),
    "pinned": pinned_grid,
    "diamond": lambda: lattice("diamond", 2, 2, 2),
}


def stiff(network, low, high):
    k = np.geomspace(low, high, network.n_edges)
    return replace(network, stiffness=k), k


@pytest.mark.parametrize("name", NETWORKS)
@pytest.mark.parametrize(("low", "high"), [(0.04, 20.0), (1.0, 2.0)])
def test_a_network_at_rest_shows_its_stiffnesses(name, low, high):
    """Where no edge carries tension, colour and width are those of k, with a bar whose ends are those of k."""
    network, k = stiff(NETWORKS[name](), low, high)
    axes = draw(network)
    bar = axes.figure.axes[-1]
    assert bar.get_ylabel() == "stiffness k"
    assert bar.get_ylim() == pytest.approx((low if high > 10 * low else 0.0, high))
    widths = np.concatenate([lines.get_linewidths() for lines in axes.collections])
    assert len(set(widths.round(6))) >= network.n_edges // 2
    same = draw(replace(network, stiffness=np.full_like(k, 2.0)))
    assert len(same.figure.axes) == 1


def test_springs_at_rest_show_their_stiffness_and_springs_in_tension_their_tension():
    network, k = stiff(voronoi_network(40, seed=1), 0.1, 10.0)
    lengths = np.linalg.norm(network.bond_vectors(network.positions), axis=1)
    rest = draw(spring_state(network, lengths * (1 + 1e-15), network.positions))
    assert len(rest.figure.axes) == 2
    critical = CriticalManifold(network).configuration(random_stress(network.n_edges, 1))
    assert len(draw(critical).figure.axes) == 1
    assert len(draw(network, color=k).figure.axes) == 1


def test_pinned_networks_are_drawn_with_a_margin_and_their_pins(units):
    critical = critical_of(units.network(pinned_grid()))
    network, x = critical.network, critical.coordinates
    for thing in (critical, network):
        axes = draw(thing)
        x = critical.coordinates if thing is critical else network.positions
        margin = 0.03 * np.ptp(x, axis=0).max()
        for limits, along in ((axes.get_xlim(), x[:, 0]), (axes.get_ylim(), x[:, 1])):
            np.testing.assert_allclose(limits, (along.min() - margin, along.max() + margin), rtol=1e-12)
        drawn = np.concatenate([each.get_segments() for each in axes.collections if len(each.get_segments())])
        at = np.sort(x[network.edges].reshape(network.n_edges, -1), axis=0)
        np.testing.assert_allclose(np.sort(drawn.reshape(network.n_edges, -1), axis=0), at, rtol=1e-12)
        np.testing.assert_array_equal(axes.lines[0].get_xydata(), x[list(network.pins)])


@pytest.mark.parametrize("make", [pinned_grid, lambda: voronoi_network(20, seed=1)], ids=["pins", "cell"])
def test_values_of_vertices_are_areas_of_discs(make):
    network = make()
    values = np.linspace(-1.0, 2.0, network.n_vertices)
    axes = draw(network, vertices=values)
    discs = next(each for each in axes.collections if isinstance(each, PathCollection))
    sizes, fraction = discs.get_sizes(), np.clip(values, 0, None) / 2
    np.testing.assert_allclose(sizes, sizes.max() * fraction, rtol=1e-12)
    assert 10 < sizes.max() <= 90
    places = (
        network.positions
        if network.cell is None
        else network.positions @ np.linalg.inv(network.cell) % 1 @ network.cell
    )
    np.testing.assert_allclose(discs.get_offsets(), places, rtol=0, atol=1e-12)


test_things_that_cannot_be_drawn_are_refused = refused(
    {
        "nothing": (lambda: draw(3), "drawn"),
        "few colours": (lambda: draw(lattice("honeycomb", 2, 2), color=[1, 2]), "color"),
    }
)
