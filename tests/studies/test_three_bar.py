"""The three-bar study, coarse: its stored grids against elementary geometry of the linkage."""

import numpy as np

from critflow import Status

SPAN = 2.0

STUDY = "three_bar"


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
        rest = np.linalg.norm(np.diff(dataset.example_position.values[example], axis=0), axis=1)
        for frame in frames:
            np.testing.assert_allclose(np.linalg.norm(np.diff(frame, axis=0), axis=1), rest, rtol=1e-12)
