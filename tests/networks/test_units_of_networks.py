"""What a network knows of its shape in other units of stiffness and length."""

import numpy as np
import pytest
from problems import NETWORKS
from units import same_in_units

from critflow import Network, voronoi_network
from critflow.checks import blocks, doubtful_offsets, opened_edges
from critflow.faces import planar_faces
from critflow.points import near_images, short_cell
from critflow.result import NetworkError


def shape(network, units):
    graph = network.edges, network.offsets, network.cell, network.pins, network.n_vertices
    x = np.random.default_rng(0).random((network.n_vertices, network.dimension)) * units.length
    return {
        "number": (opened_edges(*blocks(*graph)), len(network.free)),
        "length": (network.boundary_vectors, network.bond_vectors(x), network.spacing),
        "stiffness": (network.stiffness,),
    }


def periodic(network, units):
    L, (short, rows) = network.bond_vectors(network.positions), short_cell(network.cell)
    faces = planar_faces(network.edges, L, network.n_vertices)
    images = near_images(network.positions @ np.linalg.inv(network.cell), network.cell, 0.3 * units.length)
    doubtful = doubtful_offsets(network.edges, -network.offsets, network.cell, network.positions)
    copy = Network(network.edges, network.offsets, network.cell, positions=network.positions)
    return {
        "number": (faces.edges, faces.signs, faces.starts, rows, *images, *doubtful),
        "length": (short, copy.cell),
        "area": (network.volume,),
    }


test_shapes_in_other_units = same_in_units(
    {name: (shape, make) for name, make in NETWORKS.items()}
    | {
        "faces": (periodic, lambda: voronoi_network(100, seed=1)),
        "few faces": (periodic, lambda: voronoi_network(8, seed=3)),
    },
    rtol=1e-14,  # of the root of a volume
)


def test_pins_far_from_the_origin_are_refused_in_any_unit(units):
    """Their coordinates take the digits of the lengths: an onset in geographic coordinates was called floppy."""
    pins = np.array([[0.0, 0.0], [1.0, 0.5]])
    for distance, refused in ((1e3, False), (1e5, True)):
        named = dict(zip((0, 2), units.length * (pins + distance), strict=True))
        if refused:
            with pytest.raises(NetworkError, match="subtract their mean"):
                Network([[0, 1], [1, 2]], pins=named)
        else:
            assert Network([[0, 1], [1, 2]], pins=named).dimension == 2
