"""Figures of a network in other units: the same lines in the frame of the cell."""

import numpy as np
from matplotlib.figure import Figure
from problems import NETWORKS, critical_of
from units import same_in_units

from critflow import foam_network
from critflow.pictures import draw_in_depth, draw_network, face_polygons, periodic_segments, unit_pressure_tensions


def lines(network, units):
    critical = critical_of(network)
    graph = network.edges, network.offsets, network.cell
    segments, edge = periodic_segments(*graph, critical.coordinates)
    drawn = draw_network(Figure().add_subplot(), *graph, critical.coordinates, critical.tensions)
    polygons = face_polygons(network.faces, network.edges, critical.coordinates, critical.bond_vectors)
    tension = unit_pressure_tensions(critical.sigma, critical.lengths, network.volume)
    return {
        "number": (edge, drawn.get_linewidths()),
        "length": (segments, np.array(drawn.get_segments()), *drawn.get_clim(), np.concatenate(polygons), tension),
    }


def in_depth(network, units):
    critical, axes = critical_of(network), Figure().add_subplot()
    draw_in_depth(axes, network.edges, network.offsets, network.cell, critical.coordinates, critical.tensions)
    edges, frame = axes.collections
    return {
        "number": (edges.get_linewidths(), edges.get_colors()),
        "length": (np.array(edges.get_segments()), np.array(frame.get_segments())),
    }


test_figures_in_other_units = same_in_units(
    {name: (lines, NETWORKS[name]) for name in ("voronoi", "oblique", "sheared")}
    | {"space": (in_depth, lambda: foam_network(60, seed=1))},
)
