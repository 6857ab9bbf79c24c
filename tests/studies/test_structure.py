"""Shape anisotropy and relative variances."""

import numpy as np
import pytest
from problems import random_stress, voronoi_3d

from critflow import CriticalManifold, InputError, voronoi_network
from workflows.shared.structure import face_anisotropy, force_anisotropy, polygon_anisotropy


def by_eigenvalues(corners):
    """κ = 2(λ_1⁴ + λ_2⁴)/(λ_1² + λ_2²)² − 1, λ being the eigenvalues of the gyration tensor about the centroid."""
    arm = corners - corners.mean(axis=0)
    eigenvalues = np.linalg.eigvalsh(arm.T @ arm / len(arm))
    return 2 * np.sum(eigenvalues**4) / np.sum(eigenvalues**2) ** 2 - 1


def test_point_has_no_shape():
    assert np.isnan(polygon_anisotropy(np.zeros((3, 2)), np.array([0, 3]))[0])


# Isosceles triangles of base a and height h: λ = a²/6 along the base and 2h²/9 across it.
@pytest.mark.parametrize(
    "corners, kappa",
    [
        ([(0, 0), (1, 0), (0.5, np.sqrt(3) / 2)], 0.0),
        ([(0, 0), (2, 0), (2, 2), (0, 2)], 0.0),
        ([(0, 0), (2, 0), (2, 1), (0, 1)], 2 * (4**4 + 1) / (4**2 + 1) ** 2 - 1),
        ([(0, 0), (2, 0), (1, 3)], 2 * ((4 / 6) ** 4 + 2**4) / ((4 / 6) ** 2 + 2**2) ** 2 - 1),
        ([(0, 0), (1, 0), (3, 0)], 1.0),
    ],
    ids=["triangle", "square", "two squares", "isosceles", "line"],
)
def test_values_by_hand(corners, kappa):
    sides = np.roll(corners, -1, axis=0) - np.array(corners)
    assert polygon_anisotropy(sides, np.array([0, len(sides)]))[0] == pytest.approx(kappa, rel=1e-12, abs=1e-15)


def test_faces_of_a_network():
    network = voronoi_network(60, seed=2)
    critical = CriticalManifold(network).configuration(random_stress(90, 1))
    found = face_anisotropy(critical)
    assert found.shape == (30,)
    faces = network.faces
    for f in range(30):
        walk = slice(faces.starts[f], faces.starts[f + 1])
        corners = np.cumsum(faces.signs[walk, None] * critical.bond_vectors[faces.edges[walk]], axis=0)
        assert found[f] == pytest.approx(by_eigenvalues(corners), rel=1e-9)


def test_force_triangles_by_the_eigenvalue_formula():
    network = voronoi_network(60, seed=2)
    critical = CriticalManifold(network).configuration(random_stress(90, 1))
    found = force_anisotropy(critical)
    vertices = network.free if network.pins else np.arange(network.n_vertices)
    assert found.shape == vertices.shape
    for value, vertex in zip(found, vertices, strict=True):
        ends = [(e, 1.0) for e in np.flatnonzero(network.edges[:, 0] == vertex)]
        ends += [(e, -1.0) for e in np.flatnonzero(network.edges[:, 1] == vertex)]
        pulls = np.array([s * critical.sigma[e] * critical.bond_vectors[e] for e, s in ends])
        np.testing.assert_allclose(np.sum(pulls, axis=0), 0, atol=1e-12)
        # Sides ordered by angle form the convex polygon.
        pulls = pulls[np.argsort(np.arctan2(pulls[:, 1], pulls[:, 0]))]
        assert value == pytest.approx(by_eigenvalues(np.cumsum(pulls, axis=0)), rel=1e-8)


def test_networks_without_faces_raise():
    solid = CriticalManifold(voronoi_3d()).configuration(np.ones(voronoi_3d().n_edges))
    with pytest.raises(InputError, match="planar_faces"):
        face_anisotropy(solid)
    with pytest.raises(InputError, match="dimensions"):
        force_anisotropy(solid)
