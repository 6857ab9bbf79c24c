"""The distance from given positions, of which designs take the gradient, against differences in sixty digits."""

import numpy as np
import pytest
from problems import random_stress, with_random_stiffness

from critflow import CriticalManifold, voronoi_network
from critflow_extras.targets.stresses import Stresses
from critflow_extras.targets.targets import nearness
from workflows.benchmarks import reference
from workflows.benchmarks.high_precision import MP, numbers


def test_the_distance_and_its_gradient_agree_with_sixty_digits():
    network = with_random_stiffness(voronoi_network(n_vertices=8, seed=1), seed=2)
    sigma, change = random_stress(network.n_edges, seed=5), np.random.default_rng(7).normal(size=network.n_edges)
    step = MP.mpf(10) ** -15

    def square(h):
        """Σ|x + c|² of the coordinates about their mean."""
        x = reference.configuration(network, numbers(sigma) + h * numbers(change)).coordinates
        return ((x - x.mean(axis=0)) ** 2).sum()

    stresses = Stresses(CriticalManifold(network), sigma, signs="any")
    size = sigma[0] / stresses.start[0]
    value, gradient = nearness(stresses, np.zeros((8, 2))).at(stresses.at(stresses.origin), stresses.origin)
    assert value == pytest.approx(float(square(0)) / (2 * 8), rel=1e-13)
    gradient = 2 * 8 * gradient / size
    expected = float((square(step) - square(-step)) / (2 * step))
    assert gradient @ change == pytest.approx(expected, rel=1e-12)
