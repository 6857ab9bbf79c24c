"""Pictures that scikit-image drew and segmented: skeletons of fibres and label masks (extra `pictures`)."""

import numpy as np
import pytest
from PIL import Image, ImageDraw
from scipy.spatial import KDTree

from critflow import InputError, network_from, tissue
from critflow import draw as draw_network
from critflow.command.main import main
from critflow.extras.files.pictures import from_labels, from_skeleton

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


@pytest.mark.parametrize("width", [1, 3, 5, 9])
def test_straight_fibres_have_their_straight_lengths_at_every_angle(width):
    centre, rays = np.array([110.0, 110.0]), np.deg2rad([[a, a + 120, a + 240] for a in (0, 7, 15, 22.5, 30, 41, 52)])
    for angles in rays:
        picture = Image.new("L", (221, 221))
        tips = centre + 100 * np.stack([np.cos(angles), np.sin(angles)], axis=1)
        for tip in tips:
            ImageDraw.Draw(picture).line([*centre, *tip], fill=255, width=width)
        read = network_from(picture=np.array(picture), pixel=0.5, pins="degree")
        chord = np.linalg.norm(read.network.bond_vectors(read.positions), axis=1)
        assert (read.rest_lengths >= chord).all() and (read.rest_lengths < 1.01 * chord).all()
        # x to the right, y upwards; ends of thick lines lose about half their width.
        found = read.positions[sorted(read.network.pins)] @ [[1, 0], [0, -1]] / 0.5
        assert len(found) == 3 and KDTree(found).query(tips)[0].max() < 2 + width / 2


@pytest.mark.parametrize("width", [1, 3, 5])
def test_curved_fibres_have_the_lengths_of_their_curves(width):
    arc, wave = np.linspace(0, np.pi, 600), np.linspace(0, 400, 2000)
    along = {
        "arc": 20 + np.array([60 * (1 - np.cos(arc)), 60 * np.sin(arc)]).T,
        "wave": np.column_stack([100 + 8 * np.sin(wave * np.pi / 40), 10 + wave]),
    }
    for places in along.values():
        picture = np.zeros((200, 420), bool)
        for place in places:
            picture[draw.disk(place, max(width / 2, 0.6))] = True
        read = from_skeleton(picture)
        assert read.rest_lengths == pytest.approx([np.linalg.norm(np.diff(places, axis=0), axis=1).sum()], rel=0.015)


def test_pins_on_the_border_are_those_at_the_edges_of_the_picture():
    rng, missed, count = np.random.default_rng(1), 0, 0
    for width in (1, 3, 5, 9):
        picture = Image.new("L", (300, 300))
        for middle, angle in zip(rng.uniform(50, 250, (9, 2)), np.pi * rng.random(9), strict=True):
            away = 600 * np.array([np.cos(angle), np.sin(angle)])
            ImageDraw.Draw(picture).line([*(middle - away), *(middle + away)], fill=1, width=width)
        # One fibre ends inside.
        found = from_skeleton(np.array(picture))
        ends = np.flatnonzero(np.bincount(found.edges.ravel()) == 1)
        count, missed = count + len(ends), missed + len(set(ends) - set(found.border))
        inside = np.abs(found.positions - [150, -150]).max(axis=1) < 140
        assert not inside[list(found.border)].any()
    assert count > 60 and missed == 0
    with pytest.raises(InputError, match="border"):
        network_from(edges=[[0, 1]], positions=np.eye(2), pins="border")


def test_a_stack_of_pictures_is_a_network_in_space(tmp_path):
    stack = np.zeros((41, 41, 41), np.uint8)
    axes = np.eye(3, dtype=int)
    for axis in axes:
        stack[tuple((20 + np.outer(np.arange(-18, 19), axis)).T)] = 255
    pages = [Image.fromarray(page) for page in morphology.dilation(stack, morphology.ball(1))]
    pages[0].save(tmp_path / "fibres.tif", save_all=True, append_images=pages[1:])
    read = network_from(tmp_path / "fibres.tif", pixel=[2.0, 0.5, 0.5], pins="degree")
    assert (read.network.dimension, read.network.n_edges) == (3, 6)
    lengths = np.sort(read.rest_lengths)
    np.testing.assert_allclose(lengths, [9, 9, 9, 9, 36, 36], rtol=0.1)
    # Pages lie along z.
    tallest = read.network.bond_vectors(read.positions)[read.rest_lengths.argmax()]
    assert np.abs(tallest).argmax() == 2


def test_files_of_pictures_and_labels_in_python_and_in_the_command(tmp_path, capsys):
    lines = np.asarray(drawn([(60, 60, *tip) for tip in ((0, 60), (119, 0), (119, 119))], 120), bool)
    mask = brick_wall()
    np.save(tmp_path / "fibres.npy", lines)
    for name, array in {"fibres.png": 255 * lines.astype(np.uint8), "cells.png": mask.astype(np.uint16)}.items():
        Image.fromarray(array).save(tmp_path / name)
    Image.fromarray(np.stack([255 * lines.astype(np.uint8)] * 3, axis=-1)).save(tmp_path / "grey.png")
    whole = network_from(picture=lines, pixel=0.5, pins="border")
    for name in ("fibres.npy", "fibres.png", "grey.png"):
        found = network_from(tmp_path / name, pixel=0.5, pins="border")
        np.testing.assert_array_equal(found.rest_lengths, whole.rest_lengths)
        assert len(found.network.pins) == 3
        out = tmp_path / f"{name}.json"
        assert main(["convert", str(tmp_path / name), str(out), "--pixel", "0.5", "--pins", "border"]) == 0
        np.testing.assert_array_equal(network_from(out).rest_lengths, whole.rest_lengths)
    capsys.readouterr()
    cells, out = str(tmp_path / "cells.png"), str(tmp_path / "cells.json")
    assert main(["convert", cells, out]) == 2
    assert "--labels" in capsys.readouterr().err
    assert main(["convert", cells, out, "--labels", "--pixel", "2", "--pins", "hull"]) == 0
    np.testing.assert_array_equal(
        network_from(out).positions, network_from(labels=mask, pixel=2, pins="hull").positions
    )
    colours = np.stack([np.arange(9, dtype=np.uint8).reshape(3, 3) + shift for shift in range(3)], axis=-1)
    Image.fromarray(colours).save(tmp_path / "colours.png")
    with pytest.raises(InputError, match="colours"):
        network_from(tmp_path / "colours.png")


def brick_wall():
    """A mask of 4 × 4 cells of 20 pixels in a wall, whose rows are shifted."""
    rows, columns = np.mgrid[:80, :80]
    return 1 + 100 * (rows // 20) + (columns + 10 * ((rows // 20) % 2)) // 20


def test_whole_cells_are_faces_and_all_cells_have_sides():
    read = network_from(labels=brick_wall(), pins="hull")
    network, A = read.network, read.sides
    # Rows of 4, 5, 4, 5 cells; those at the edges of the picture have sides between fixed vertices.
    assert A.shape[0] == 18 and network.faces.n_faces == 5
    owned = {tuple(np.flatnonzero(row)) for row in A.toarray()}
    faces = network.faces
    assert {tuple(sorted(sides)) for sides in np.split(faces.edges, faces.starts[1:-1])} <= owned
    state = tissue(network, A @ np.linalg.norm(network.bond_vectors(read.positions), axis=1), sides=A)
    assert state.spring_lengths.shape == (18,) and draw_network(read.network) is not None
    # Cells without a label inside a tissue are holes, and no faces.
    hollow = brick_wall()
    hollow[hollow == hollow[30, 35]] = 0
    assert network_from(labels=hollow, pins="hull").network.faces.n_faces == 4


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
    for picture, word in (
        (np.zeros((9, 9)), "true on the fibres"),
        (np.ones(3), "dimensions"),
        (np.eye(9) + np.eye(9, k=3) / 2, "labels="),
    ):
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


GRID = [(k, 5, k, 95) for k in (20, 50, 80)] + [(5, k, 95, k) for k in (20, 50, 80)]
CROSSED = {  # fibres, size of the picture, further half width, vertices and edges
    "grid": (GRID, 100, 0, 21, 24),
    "neighbouring pixels": ([(10, 10, 90, 90), (10, 90, 90, 10)], 100, 0, 5, 4),
    "thick": ([(40, 10, 160, 190), (160, 10, 40, 190)], 200, 3, 5, 4),
}


@pytest.mark.parametrize("kind", CROSSED)
def test_fibres_that_cross_have_one_junction_in_any_units(kind):
    lines, size, thicker, *counts = CROSSED[kind]
    picture = morphology.dilation(drawn(lines, size), morphology.disk(thicker))
    for pixel in (1.0, 10.0):
        read = network_from(picture=picture, pins="degree", pixel=pixel)
        assert [read.network.n_vertices, read.network.n_edges] == counts
        assert ("width of the fibres" in str(read)) == (kind == "thick")
    if kind == "grid":
        inner = np.delete(read.positions, list(read.network.pins), axis=0) / pixel
        expected = sorted((x, -y) for x in (20, 50, 80) for y in (20, 50, 80))
        np.testing.assert_allclose(sorted(map(tuple, inner.round())), expected, atol=1)
