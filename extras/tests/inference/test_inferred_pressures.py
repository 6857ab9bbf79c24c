"""Tensions and pressures that positions determine, with their standard errors."""

import numpy as np
import pytest
from refusals import refused
from tissue_patches import loaded

import critflow_extras.tissue.pressures  # noqa: F401  # a service of it is used
from critflow import CriticalManifold, lattice
from critflow_extras import nearest_critical


def test_planted_tensions_and_pressures_are_recovered():
    deviations = []
    for seed in range(50):
        network, sigma, pressures = loaded(20, seed, 0.05)
        planted = CriticalManifold(network).configuration(sigma, pressures)
        noise = 1e-9 * np.random.default_rng(seed).standard_normal(planted.coordinates.shape)
        found = nearest_critical(network, planted.coordinates + noise, 1e-9, pressures=True)
        assert found.distance < 1e-10
        deviations.append((found.value.sigma - planted.sigma) / found.stress_error)
        deviations.append((found.value.pressures - planted.pressures) / found.pressure_error)
    deviation = np.concatenate(deviations)
    # Standard errors: a mean square of one, with few independent numbers a network, and no far outlier.
    assert np.mean(deviation**2) == pytest.approx(1, abs=0.15)
    assert np.abs(deviation).max() < 5


def test_standard_errors_are_those_of_differences():
    network, sigma, pressures = loaded(8)
    x = CriticalManifold(network).configuration(sigma, pressures).coordinates
    found, columns = nearest_critical(network, x, 1.0, pressures=True), []
    for entry in np.ndindex(x.shape):
        step = np.zeros_like(x)
        step[entry] = 1e-5
        ends = [nearest_critical(network, x + sign * step, pressures=True).value for sign in (1, -1)]
        # The scale of the standard errors: Σσ is kept.
        ends = [np.concatenate([end.sigma, end.pressures]) * found.value.sigma.sum() / end.sigma.sum() for end in ends]
        columns.append((ends[0] - ends[1]) / 2e-5)
    spread = np.linalg.norm(columns, axis=0)
    assert np.concatenate([found.stress_error, found.pressure_error]) == pytest.approx(spread, rel=1e-5)


def of_four_edges_a_vertex():
    return nearest_critical(lattice("square", 3, 3), lattice("square", 3, 3).positions, pressures=True)


def with_a_start():
    network, sigma, _ = loaded()
    return nearest_critical(network, network.positions, start=sigma, pressures=True)


test_bad_input_raises_one_sentence = refused(
    {"four edges a vertex": (of_four_edges_a_vertex, "three edges"), "a start": (with_a_start, "needs no start")}
)
