"""Random sequential addition: minimum distance and reproducibility."""

import numpy as np
import pytest
from problems import digest

from critflow import points as random_points
from critflow.points import STANDARD_HARD_CORE, points_in_cell, random_sequential_addition


def periodic_distances(points: np.ndarray) -> np.ndarray:
    """All pair distances in the periodic unit cube, with infinity on the diagonal."""
    step = points[:, None] - points[None]
    distance = np.linalg.norm(step - np.round(step), axis=2)
    np.fill_diagonal(distance, np.inf)
    return distance


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("n_points, distance, dimension", [(200, STANDARD_HARD_CORE / 200**0.5, 2), (100, 0.15, 3)])
def test_points_satisfy_the_minimum_distance(n_points, distance, dimension, seed):
    points = random_sequential_addition(n_points, distance, np.random.default_rng(seed), dimension)
    assert points.shape == (n_points, dimension)
    assert points.min() >= 0 and points.max() < 1
    assert periodic_distances(points).min() >= distance


@pytest.mark.parametrize(
    "n_points, hard_core, dimension, bits",
    [
        (1, 0.5, 2, "f47cf9d290788d07"),
        (30, 0.5, 1, "aaf320150c55756e"),
        (50, 0.82, 2, "661f5a69e3c54fff"),
        (2000, 0.82, 2, "c51a118a9809e9af"),
        (2000, 0.6, 2, "0fe2484b2aabd201"),
        (100, 0.85, 3, "6acfe489e6980cce"),
    ],
)
def test_points_are_frozen(n_points, hard_core, dimension, bits):
    # Sums, products and comparisons only, so every bit is the same on every machine; so are the next random numbers.
    rng = np.random.default_rng(7)
    points = random_sequential_addition(n_points, hard_core / n_points ** (1 / dimension), rng, dimension)
    assert digest(points, rng.random(3)) == bits


@pytest.mark.parametrize(
    "dimension, hard_core, total",
    [(2, 0.7, 2464.2206000330084), (3, 0.7, 6003.70028738539), (2, 0.82, 2577.0834777689943)],
)
def test_points_of_a_cell_are_frozen(dimension, hard_core, total):
    cell = np.array([[1.0, 0.1, 0.0], [0.7, 1.0, 0.2], [0.0, 0.3, 1.0]])[:dimension, :dimension]
    points = points_in_cell(60, hard_core, np.random.default_rng(4), cell)
    assert points @ np.arange(1.0, 1 + dimension) @ np.arange(60.0) == pytest.approx(total, rel=1e-12)


@pytest.mark.parametrize("dimension", [2, 3])
def test_trials_in_parts_give_the_same_points(dimension, monkeypatch):
    def points():
        return random_sequential_addition(400, 0.8 / 400 ** (1 / dimension), np.random.default_rng(3), dimension)

    at_once = points()
    monkeypatch.setattr(random_points, "_BLOCK", 100)
    np.testing.assert_array_equal(points(), at_once)
