"""Drawn faces: each is a polygon of the configuration, red where its value is positive and blue where negative."""

import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.collections import PolyCollection
from scipy.spatial import cKDTree

from critflow import CriticalManifold, voronoi_network
from critflow.pictures import face_polygons
from critflow_extras import critical_from_perimeters, draw

NETWORK = voronoi_network(20, seed=1)
PRESSURES = np.linspace(-0.1, 0.1, NETWORK.faces.n_faces)


def pressed():
    configuration = CriticalManifold(NETWORK).configuration(np.ones(NETWORK.n_edges), PRESSURES)
    return configuration, configuration, PRESSURES


def tensed(at_rest=False):
    value = critical_from_perimeters(NETWORK, np.ones(NETWORK.faces.n_faces)).value
    return (value.at_rest() if at_rest else value), value.configuration, value.face_tensions * (not at_rest)


# What is drawn, the configuration of its faces, and their values.
DRAWN = {"pressures": pressed, "tensions": tensed, "at rest": lambda: tensed(at_rest=True)}


def centre(corners):
    return np.mod(corners.mean(axis=0) @ np.linalg.inv(NETWORK.cell), 1.0) % 1.0


@pytest.mark.parametrize("name", DRAWN)
def test_faces_have_the_colours_of_their_values(name):
    thing, critical, values = DRAWN[name]()
    shading = next(each for each in draw(thing).collections if isinstance(each, PolyCollection))
    polygons = face_polygons(NETWORK.faces, NETWORK.edges, critical.coordinates, critical.bond_vectors)
    drawn = [centre(path.vertices[:-1]) for path in shading.get_paths()]
    distance, face = cKDTree([centre(polygon) for polygon in polygons], boxsize=1.0).query(drawn)
    colours = shading.get_facecolors()
    redness, expected = colours[:, 0] - colours[:, 2], values[face]
    assert distance.max() < 1e-9 and len(colours) == len(drawn)
    assert (redness[expected > 0.02] > 0.05).all() and (redness[expected < -0.02] < -0.05).all()
    assert (np.diff(redness[np.argsort(expected)]) > -0.01).all()
    plt.close("all")
