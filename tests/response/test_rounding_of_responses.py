"""Rounding errors of relaxed moduli."""

import numpy as np
import pytest
from problems import NETWORKS, strained

from critflow import elasticity, equilibrium
from critflow.linear_response import accumulated_rounding, elasticity_of_form, form_rounding


@pytest.mark.parametrize("name", ["voronoi", "pinned grid", "voronoi 3D"])
def test_the_parts_of_the_first_error_are_those_of_its_sum(name):
    """Terms |T||dL| twice and k EPS|L̇|² of each edge, added in quadrature, are the error of V C_11 within √2."""
    state = equilibrium(strained(NETWORKS[name](), 0.1)).value
    rng, d, n = np.random.default_rng(1), state.network.dimension, state.network.n_edges
    speed, tension = rng.random((2, n)), rng.standard_normal((2, n))
    for size in (1e-6, 1.0, 1e6):  # velocities of vertices that do not matter, and that decide
        u = size * rng.standard_normal((2, d, len(state.network.free)))
        noise, first = form_rounding(state, speed, u, tension)
        assert 0.7 * noise[0, 0] <= accumulated_rounding(first) <= 1.0001 * noise[0, 0]


@pytest.mark.parametrize("name", ["voronoi", "voronoi 3D"])
def test_errors_far_from_the_transition_are_a_few_hundred_roundings(name):
    found = elasticity(equilibrium(strained(NETWORKS[name](), 0.1)).value).value
    size, errors = np.abs(found.tensor).max(), found.errors
    for error in (errors.tensor.max(), errors.bulk, errors.shear, errors.shear_stress_corrected):
        assert 1e-17 * size < error < 1e-12 * size


def test_the_energy_that_a_relaxation_leaves_is_an_error_of_its_modulus():
    state = equilibrium(strained(NETWORKS["voronoi"](), 0.1)).value
    volume, form, exact = state.network.volume, np.eye(3), np.zeros((3, 3))
    for strain, name in ((0, "bulk"), (2, "shear")):  # the first strain is the dilation, the last one the shear
        left = np.zeros((3, 3))
        left[strain, strain] = 4.0
        errors = (exact, np.zeros(state.network.n_edges), left)
        found = elasticity_of_form(state, volume, (0, 1, 2), form, form, errors).errors
        assert getattr(found, name) == pytest.approx(4 / volume, rel=1e-9)
