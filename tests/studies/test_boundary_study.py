"""The boundary study: the box of the networks, and what a search for nearest images would take."""

import numpy as np

from critflow import CriticalManifold, voronoi_network
from workflows.boundary import nearest_images

STUDY = "boundary"


def test_the_volume_is_the_number_of_vertices(dataset):
    """V = N_v, as in the main text; the other size in the paper, side √N_b, is that of `critical_in_printed_box`."""
    cell = dataset.cell.transpose("seed", "cell_vector", "axis").values
    np.testing.assert_allclose(np.linalg.det(cell), dataset.sizes["vertex"], rtol=1e-12)
    np.testing.assert_allclose(cell[:, 0, 0], np.sqrt(2 / 3 * dataset.sizes["edge"]), rtol=1e-12)


def test_nearest_images_are_wrong_for_more_edges_at_larger_shears(dataset):
    wrong = dataset.nearest_image_wrong
    assert (wrong.isel(shear=-1) > wrong.isel(shear=0)).all()
    assert (wrong.diff("shear").sum("seed") >= 0).all()


def test_a_sheared_boundary_shears_the_configuration():
    network, F = voronoi_network(40, seed=0), np.array([[1.0, 1.5], [0.0, 1.0]])
    sigma = np.abs(np.random.default_rng(1).standard_normal(60))
    plain = CriticalManifold(network).configuration(sigma)
    deformed = network.deformed(F)
    sheared = CriticalManifold(deformed).configuration(sigma)
    np.testing.assert_allclose(sheared.bond_vectors, plain.bond_vectors @ F.T, rtol=0, atol=1e-12)
    nearest = nearest_images(sheared.coordinates, network.edges, deformed.cell)
    assert np.abs(nearest - sheared.bond_vectors).max() > 0.1
