"""Pictures that scikit-image drew and segmented: skeletons of fibres and label masks (extra `pictures`)."""

import numpy as np
import pytest

from critflow import InputError, examine, network_from
from critflow.exchange.pictures import from_labels

morphology = pytest.importorskip("skimage.morphology")
draw = pytest.importorskip("skimage.draw")
segmentation = pytest.importorskip("skimage.segmentation")
pytest.importorskip("skan")


def drawn(lines, size):
    """A picture of straight fibres five pixels wide."""
    picture = np.zeros((size, size), np.uint8)
    for ends in lines:
        picture[draw.line(*ends)] = 1
    return morphology.dilation(picture, morphology.footprint_rectangle((5, 5)))


def test_three_fibres_are_three_edges_in_units_of_length():
    centre, tips = (60, 60), [(10, 60), (90, 15), (90, 105)]
    read = network_from(picture=drawn([(*centre, *tip) for tip in tips], 120), pixel=0.5, pins="degree")
    assert (read.network.n_edges, len(read.network.pins)) == (3, 3) and read.data.source == "skeleton"
    # x to the right, y upwards; ends of thick lines lose about half their width.
    middle = next(i for i in range(4) if i not in read.network.pins)
    np.testing.assert_allclose(read.positions[middle], [30, -30], atol=1.5)
    straight = np.linalg.norm(read.network.bond_vectors(read.positions), axis=1)
    expected = [0.5 * np.hypot(*np.subtract(tip, centre)) for tip in tips]
    np.testing.assert_allclose(np.sort(straight), np.sort(expected), atol=2.5)
    # Along pixels a slanted fibre is longer, by at most the factor of a staircase.
    assert (read.rest_lengths >= straight - 1e-12).all() and (read.rest_lengths < 1.1 * straight).all()
    assert examine(read, deformations=()).order == "first"


def test_a_grid_of_fibres_has_a_vertex_at_each_crossing():
    places = (20, 50, 80)
    lines = [(k, 5, k, 95) for k in places] + [(5, k, 95, k) for k in places]
    read = network_from(picture=drawn(lines, 100), pins="degree")
    assert (read.network.n_vertices, read.network.n_edges, len(read.network.pins)) == (21, 24, 12)
    inner = np.delete(read.positions, list(read.network.pins), axis=0)
    expected = [(x, -y) for x in places for y in places]
    np.testing.assert_allclose(sorted(map(tuple, inner.round())), sorted(expected), atol=1)


def test_neighbouring_pixels_of_a_junction_are_one_vertex_in_any_units():
    crossed = drawn([(10, 10, 90, 90), (10, 90, 90, 10)], 100)
    for pixel in (1.0, 10.0):
        read = network_from(picture=crossed, pins="degree", pixel=pixel)
        assert (read.network.n_vertices, read.network.n_edges) == (5, 4)


def test_a_segmented_tissue_is_the_network_of_its_borders():
    # Centres of regular hexagons with sides of 20 pixels.
    rows, columns = np.meshgrid(np.arange(8), np.arange(6), indexing="ij")
    centres = np.stack([30 * rows + 25, 34.64 * (columns + 0.5 * (rows % 2)) + 22], axis=-1).reshape(-1, 2)
    markers = np.zeros((260, 250), int)
    markers[tuple(centres.round().astype(int).T)] = np.arange(1, len(centres) + 1)
    distance = np.min(
        [np.hypot(*np.ogrid[-a : 260 - a, -b : 250 - b]) for a, b in centres.round().astype(int).tolist()], axis=0
    )
    labels = segmentation.watershed(distance, markers)
    read = network_from(labels=labels, pins="hull")
    inner = [
        e for e, ends in enumerate(read.network.edges) if not set(map(int, ends)) & set(read.network.pins)
        and ((read.positions[ends] > [25, -230]) & (read.positions[ends] < [220, -25])).all()
    ]  # fmt: skip
    length = np.linalg.norm(read.network.bond_vectors(read.positions), axis=1)[inner]
    assert len(length) > 60
    np.testing.assert_allclose(length, 20, atol=2.5)
    degree = np.bincount(read.network.edges[inner].ravel())
    assert degree.max() == 3


def test_pictures_without_a_network_are_one_sentence():
    for picture, word in ((np.zeros((9, 9)), "true on the fibres"), (np.ones((3, 3, 3)), "two-dimensional")):
        with pytest.raises(InputError, match=word):
            network_from(picture=picture)
    ring = drawn([], 80)
    ring[draw.circle_perimeter(40, 40, 25)] = 1
    with pytest.raises(InputError, match="itself"):
        network_from(picture=ring, pins=[0])
    with pytest.raises(InputError, match="three labels"):
        network_from(labels=np.arange(64).reshape(8, 8) // 64)


def test_every_border_of_two_labels_is_an_edge():
    # An island on the border of two labels, which therefore meet in two places.
    mask = np.repeat([[1] * 20 + [2] * 20], 40, axis=0)
    mask[15:25, 15:25] = 3
    found = from_labels(mask)
    heights = [sorted(-found.positions[ends, 1].round()) for ends in found.edges]
    assert found.n_edges == 6 and [0, 14] in heights and [24, 40] in heights
    # Islands inside one label touch nothing.
    mask[2:6, 2:6] = 4
    assert from_labels(mask).n_edges == 6 and "1 border" in from_labels(mask).notes[1]


def test_thick_fibres_that_cross_have_one_junction():
    crossed = drawn([(40, 10, 160, 190), (160, 10, 40, 190)], 200)
    crossed = morphology.dilation(crossed, morphology.disk(3))
    read = network_from(picture=crossed, pins="degree")
    assert (read.network.n_vertices, read.network.n_edges) == (5, 4) and "width of the fibres" in str(read)
