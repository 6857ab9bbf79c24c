"""Label masks: corners at which three labels meet are vertices, and labels are faces."""

import numpy as np
import pytest
from PIL import Image
from scipy.spatial import KDTree

from critflow import InputError
from critflow.command.main import main
from critflow_extras import draw as draw_network
from critflow_extras import nearest_critical, network_from, tissue
from critflow_extras.files.labels import from_labels


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
    labels = 1 + KDTree(centres.round()).query(np.stack(np.mgrid[:260, :250], axis=-1))[1]
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


def test_traced_borders_show_the_pressures_that_bend_them():
    # Cells argmin p |r − q|² have arcs of known tensions as sides (Noll, Streichan and Shraiman, 2020).
    rng = np.random.default_rng(3)
    q = 60.0 * np.stack(np.mgrid[:5, :5], axis=-1).reshape(-1, 1, 2) + rng.uniform(-12, 12, (25, 1, 2))
    p = 1 + 0.15 * rng.standard_normal((25, 1))
    pixels = np.stack(np.mgrid[:240, :240], axis=-1).reshape(-1, 2)
    labels = 1 + np.argmin(p * ((pixels - q) ** 2).sum(axis=-1), axis=0).reshape(240, 240)
    plain, read = (network_from(labels=labels, traced=n, pins="border") for n in (0, 2))
    np.testing.assert_array_equal(read.positions[: plain.network.n_vertices], plain.positions)
    # Distances of the vertices on the sides from the arcs, to first order.
    a, b = read.data.sides.T - 1
    middle = read.positions[read.network.edges[:, 0]][:, ::-1] * [-1, 1]
    level = [p[k, 0] * ((middle - q[k, 0]) ** 2).sum(axis=1) for k in range(25)]
    traced = read.network.edges[:, 0] >= plain.network.n_vertices
    slope = 2 * np.sqrt(p[a] * p[b])[:, 0] * np.linalg.norm(q[a] - q[b], axis=-1)[:, 0]
    off = np.abs(np.array(level)[a, np.arange(len(a))] - np.array(level)[b, np.arange(len(a))]) / slope
    assert traced.sum() > 60 and off[traced].max() < 0.5
    found = nearest_critical(read, read.positions, pressures=True)
    assert found.ok and found.freedom > 60
    first = np.unique(found.sides, return_index=True)[1]
    assert np.corrcoef(found.side_tensions, slope[first])[0, 1] > 0.8
    with pytest.raises(InputError, match="traced"):
        network_from(labels=labels, traced=-1)


def test_files_of_labels_in_python_and_in_the_command(tmp_path, capsys):
    mask = brick_wall()
    np.save(tmp_path / "cells.npy", mask)
    Image.fromarray(mask.astype(np.uint16)).save(tmp_path / "cells.png")
    grey = (mask % 251).astype(np.uint8)
    Image.fromarray(np.stack([grey] * 3, axis=-1)).save(tmp_path / "grey.png")
    whole = network_from(labels=mask, pixel=[2, 1], pins="border")
    for name in ("cells.npy", "cells.png", "grey.png"):
        read = network_from(labels=tmp_path / name, pixel=[2, 1], pins="border")
        np.testing.assert_array_equal(read.positions, whole.positions)
        assert read.network.pins.keys() == whole.network.pins.keys()
    # x to the right, y upwards.
    assert np.ptp(whole.positions, axis=0) == pytest.approx([80, 160], abs=4) and whole.positions[:, 1].max() == 1
    out = tmp_path / "cells.json"
    words = ["convert", str(tmp_path / "cells.png"), str(out)]
    assert main([*words, "--labels", "--pixel", "2 1", "--pins", "border"]) == 0
    np.testing.assert_array_equal(network_from(out).positions, whole.positions)
    assert main([*words, "--labels", "--traced", "1", "--pins", "border"]) == 0
    traced = network_from(labels=mask, traced=1, pins="border").network
    assert network_from(out).network.n_edges == traced.n_edges > whole.network.n_edges
    assert main(words) == 2
    assert "--labels for a mask" in capsys.readouterr().err


def test_what_is_no_mask_is_one_sentence(tmp_path):
    colours = np.stack([np.arange(9, dtype=np.uint8).reshape(3, 3) + shift for shift in range(3)], axis=-1)
    Image.fromarray(colours).save(tmp_path / "colours.png")
    pages = [Image.fromarray(np.full((4, 4), n, np.uint8)) for n in range(2)]
    pages[0].save(tmp_path / "pages.tif", save_all=True, append_images=pages[1:])
    inside = brick_wall() == np.roll(brick_wall(), 1, (0, 1))
    Image.fromarray(np.where(inside, 0, 255).astype(np.uint8)).save(tmp_path / "outlines.tif")
    labelled = r"label the cells first, .*label\(interior.* then .*expand_labels"
    apart = np.pad(np.kron(np.diag([1, 2, 3]), np.ones((5, 5), int)), 2)
    for labels, word in (
        (np.zeros((8, 8), int), labelled),
        (tmp_path / "outlines.tif", f"a picture of 2 values shows outlines .*: {labelled}"),
        (inside, labelled),
        (np.where(inside, 1, 255), labelled),
        (
            apart * (np.roll(apart, 1, 0) == apart),
            "three labels .*: give a segmentation of touching cells, .*expand_labels",
        ),
        (
            np.where(inside, brick_wall(), 0),
            "lines of label 0, .*: give a segmentation of touching cells, .*expand_labels",
        ),
        (np.zeros((9, 9)), "whole numbers"),
        (tmp_path / "colours.png", "colours"),
        (tmp_path / "pages.tif", "give a page"),
    ):
        with pytest.raises(InputError, match=word):
            network_from(labels=labels)
    with pytest.raises(InputError, match="2 of them"):
        network_from(labels=brick_wall(), pixel=[1, 2, 3])
    with pytest.raises(InputError, match="border"):
        network_from(edges=[[0, 1]], positions=np.eye(2), pins="border")
