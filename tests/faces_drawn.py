"""Drawn faces: each is a polygon of the configuration, red where its value is positive and blue where negative."""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.collections import PolyCollection
from scipy.spatial import cKDTree

from critflow import draw
from critflow.figures.plot import face_polygons


def _centre(corners):
    return corners.mean(axis=0)


def assert_colours_of_faces(thing, critical, values):
    """The drawing of a thing shades the faces of its configuration by their values."""
    network = critical.network
    shading = next(each for each in draw(thing).collections if isinstance(each, PolyCollection))
    polygons = face_polygons(network.faces, network.edges, critical.coordinates, critical.bond_vectors)
    inside = [np.mod(place @ np.linalg.inv(network.cell), 1.0) % 1.0 for place in map(_centre, polygons)]
    paths = [
        np.mod(_centre(path.vertices[:-1]) @ np.linalg.inv(network.cell), 1.0) % 1.0 for path in shading.get_paths()
    ]
    distance, face = cKDTree(inside, boxsize=1.0).query(paths)
    colours = shading.get_facecolors()
    redness, expected = colours[:, 0] - colours[:, 2], values[face]
    assert distance.max() < 1e-9 and len(colours) == len(paths)
    assert (redness[expected > 0.02] > 0.05).all() and (redness[expected < -0.02] < -0.05).all()
    assert (np.diff(redness[np.argsort(expected)]) > -0.01).all()
    plt.close("all")
