"""Networks in space: every edge is drawn once, by depth, in any units."""

import numpy as np
from matplotlib.figure import Figure
from problems import critical_of, foam_network, random_stress
from units import same_in_units

from critflow import CriticalManifold
from critflow.pictures import network_figure
from critflow_extras.drawing.depth import draw_in_depth


def of_network(network):
    return network.edges, network.offsets, network.cell


def test_three_dimensional_networks_are_drawn_by_depth():
    network = foam_network(60, seed=1)
    sigma = random_stress(network.n_edges, 2)
    sigma[7] = -0.01
    critical = CriticalManifold(network).configuration(sigma)
    axes = Figure().add_subplot()
    bar = draw_in_depth(axes, *of_network(network), critical.coordinates, critical.tensions)
    edges, frame = axes.collections
    segments, widths = np.array(edges.get_segments()), np.asarray(edges.get_linewidths())
    assert len(segments) == len(widths) == network.n_edges
    assert len(frame.get_segments()) == 12
    # Projection on the plane of two unit vectors; the order of the edges is by depth.
    across, up = np.array([0.94, -0.34, 0]), np.array([0.09, 0.25, 0.96])
    drawn = np.linalg.norm(segments[:, 1] - segments[:, 0], axis=1)
    projected = np.hypot(critical.bond_vectors @ across, critical.bond_vectors @ up)
    np.testing.assert_allclose(np.sort(drawn), np.sort(projected), atol=1e-12)
    # Far edges come first and are pale; the compressed one is not blue.
    colours = np.asarray(edges.get_colors())[:, :3]
    assert colours[:50].mean() > colours[-50:].mean() + 0.2
    assert np.count_nonzero(colours[:, 0] > colours[:, 2] + 1e-3) == 1
    assert bar.norm.vmin == 0 and bar.norm.vmax > 0
    figure = network_figure(*of_network(network), critical.coordinates, critical.sigma, critical.lengths, "foam")
    figure.canvas.draw()
    assert len(figure.axes) == 2 and figure.axes[0].get_title() == "foam"


def in_depth(network, units):
    critical, axes = critical_of(network), Figure().add_subplot()
    draw_in_depth(axes, network.edges, network.offsets, network.cell, critical.coordinates, critical.tensions)
    edges, frame = axes.collections
    return {
        "number": (edges.get_linewidths(), edges.get_colors()),
        "length": (np.array(edges.get_segments()), np.array(frame.get_segments())),
    }


test_drawings_in_other_units = same_in_units({"space": (in_depth, lambda: foam_network(60, seed=1))})
