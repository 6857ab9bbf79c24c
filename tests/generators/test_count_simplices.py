"""Simplices counted with few periodic images: the same number as with many, also where points leave wide holes."""

import numpy as np
import pytest

from critflow import points as foams
from critflow.points import count_simplices, random_sequential_addition, voronoi_tessellation


def with_a_hole(seed):
    points = np.random.default_rng(seed).random((400, 3))
    return points[np.linalg.norm(points - 0.5, axis=1) > 0.3]


@pytest.mark.parametrize("seed", range(3))
def test_holes_are_counted_with_more_images(seed):
    points = with_a_hole(seed) - 0.5
    points -= np.floor(points)
    assert count_simplices(points) == voronoi_tessellation(points).n_vertices


def test_points_of_a_hard_core_need_few_images(monkeypatch):
    points = random_sequential_addition(100, 0.87 / 100 ** (1 / 3), np.random.default_rng(0), dimension=3)
    expected = voronoi_tessellation(points).n_vertices
    monkeypatch.setattr(foams, "LAYERS", None)
    assert count_simplices(points) == expected
