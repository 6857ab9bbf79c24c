"""Figures of a network in other units: the same lines in the frame of the cell."""

import numpy as np
from matplotlib.figure import Figure
from problems import NETWORKS, critical_of
from units import same_in_units

from critflow.pictures import draw_network, face_polygons, periodic_segments, unit_pressure_tensions


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


test_figures_in_other_units = same_in_units(
    {name: (lines, NETWORKS[name]) for name in ("voronoi", "oblique", "sheared")}
)
