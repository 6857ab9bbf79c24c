"""Images of lines that touch the cell, by hand and by translation."""

import numpy as np
import pytest

from critflow.points import images_in_cell


def sorted_rows(pieces):
    flat = np.round(pieces.reshape(len(pieces), -1), 9) + 0.0
    return flat[np.lexsort(flat.T)]


def test_lines_have_an_image_for_each_border_that_they_cross():
    inside, crossing = [[0.2, 0.3], [0.6, 0.5]], [[0.8, 0.5], [1.3, 0.6]]
    pieces, lines = images_in_cell(np.array([inside, crossing]))
    np.testing.assert_array_equal(np.sort(lines), [0, 1, 1])
    expected = [inside, crossing, np.array(crossing) - [1, 0]]
    np.testing.assert_allclose(sorted_rows(pieces), sorted_rows(np.array(expected)))


@pytest.mark.parametrize("dimension", [2, 3])
def test_images_do_not_depend_on_the_one_given(dimension):
    rng = np.random.default_rng(1)
    starts = rng.random((30, 1, dimension))
    ends = np.concatenate([starts, starts + rng.uniform(-1.4, 1.4, (30, 1, dimension))], axis=1)
    here = images_in_cell(ends)
    there = images_in_cell(ends + rng.integers(-3, 4, (30, 1, dimension)))
    np.testing.assert_allclose(sorted_rows(here[0]), sorted_rows(there[0]), atol=1e-8)
    np.testing.assert_array_equal(np.bincount(here[1]), np.bincount(there[1]))
    # Each piece meets the cell, and together they cover each line as often as its length has it.
    along = np.linspace(0, 1, 2001)[:, None, None]
    points = here[0][:, 0] + along * (here[0][:, 1] - here[0][:, 0])
    inside = ((points > 0) & (points < 1)).all(axis=2).mean(axis=0)
    np.testing.assert_allclose(np.bincount(here[1], inside), 1, atol=5e-3)
