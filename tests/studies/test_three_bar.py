"""The three-bar study end to end, coarse: its stored grids against elementary geometry of the linkage."""

import json

import numpy as np
import pytest
from matplotlib.figure import Figure

from critflow import Status
from workflows.three_bar.surfaces import clipped_polygons, draw_surfaces

SPAN = 2.0

STUDY = "three_bar"


def points(dataset, grid):
    """Every stress of a grid that has a tangent plane."""
    one = dataset.sel(grid=grid).stack(point=("row", "column"))
    return one.isel(point=np.flatnonzero(one.outcome == Status.ok))


def test_every_grid_was_computed_in_one_span(dataset):
    assert (dataset.status == Status.ok).all()
    assert set(dataset.grid.values) == {"chart", "middle", "stretched"} | {
        f"{kind}_{edge}" for kind in ("folded", "branch") for edge in (1, 2, 3)
    }
    np.testing.assert_allclose(dataset.coordinates.isel(vertex=3, axis=0).values[dataset.outcome == 0], SPAN, rtol=0)


def test_where_there_is_no_configuration_nothing_is_stored(dataset):
    bad = dataset.outcome.values == Status.singular
    for name in ("metric", "second_form", "principal_curvature", "tangents", "length"):
        values = dataset[name].values
        assert np.isnan(values[bad]).all(), name
        assert np.isfinite(values[~bad]).all(), name


def test_compatible_lengths_fulfil_the_polygon_inequality(dataset):
    """Four bars, the span among them, close if and only if none is longer than the others together."""
    L = np.sqrt(dataset.lattice_square.values)
    bars = np.stack([*np.meshgrid(L, L, L, indexing="ij"), np.full((len(L),) * 3, SPAN)])
    np.testing.assert_array_equal(2 * bars.max(axis=0) <= bars.sum(axis=0), dataset.lattice_compatible.values == 1)


def test_motions_keep_all_lengths(dataset):
    for example in range(dataset.sizes["example"]):
        frames = dataset.example_motion.values[example]
        frames = frames[np.isfinite(frames[:, 0, 0])]
        assert len(frames) == (0, 0, 8, 8)[example]
        rest = np.linalg.norm(np.diff(dataset.example_coordinates.values[example], axis=0), axis=1)
        for frame in frames:
            np.testing.assert_allclose(np.linalg.norm(np.diff(frame, axis=0), axis=1), rest, rtol=1e-12)


def test_claims_are_those_of_the_full_grids(folder):
    verdicts = {claim["key"]: claim["verdict"] for claim in json.loads((folder / "claims.json").read_text())}
    differs = {key for key, verdict in verdicts.items() if verdict == "differs"}
    assert differs == {"2FF", "3-barlinkage-G-regions", "3-barlinkage-G-floppy"}
    assert len(verdicts) == 18


def test_figures_are_drawn(folder, assert_picture):
    for name in ("manifold", "geometry", "curvature"):
        assert_picture(folder / "figures" / f"{name}.png", 20_000)


def test_clipped_polygons_lie_in_the_box():
    square = np.array([[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [2.0, 2.0, 0.0], [0.0, 2.0, 0.0]])
    (cut,) = clipped_polygons([square, square + 5.0], 1.5)
    assert cut.max() == 1.5
    # Shoelace area of the clipped square.
    x, y = cut[:, 0], cut[:, 1]
    assert abs(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))) / 2 == pytest.approx(2.25, rel=1e-14)
    # A corner cut off by a slanted edge.
    (triangle,) = clipped_polygons([np.array([[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 2.0, 0.0]])], 1.0)
    assert len(triangle) == 4


def test_surfaces_are_sorted_by_depth_and_keep_their_colours(tmp_path):
    figure = Figure()
    axes = figure.add_subplot(projection="3d")
    quad = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    # Both have the same normal, so the same shade.
    collection = draw_surfaces(axes, [([quad], "red", 1.0), ([quad + 0.5], "blue", 0.5)], light=(0, 0, 1))
    figure.savefig(tmp_path / "surfaces.png")
    assert sorted(map(tuple, np.round(collection.get_facecolor(), 12))) == [(0, 0, 1, 0.5), (1, 0, 0, 1)]
    assert len(axes.collections) == 1


def test_polygons_of_different_lengths_have_finite_limits(monkeypatch):
    axes = Figure().add_subplot(projection="3d")
    triangle, quad = np.eye(3), np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    monkeypatch.setattr(np, "empty", lambda shape, *_, **__: np.full(shape, 1e308))
    draw_surfaces(axes, [([triangle, quad], "red", 1.0)])
    assert np.abs([axes.get_xlim(), axes.get_ylim(), axes.get_zlim()]).max() < 2
