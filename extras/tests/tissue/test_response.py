"""Response of tissues: elasticity of states, and stiffening as the limit of paths."""

import numpy as np
import pytest
from responses import (
    STRAIN_PATHS,
    assert_affine,
    assert_limit_of_paths,
    assert_moduli_of_energies,
    assert_relaxations,
    assert_stress,
)
from tissues import disordered_tissue

from critflow import Status, elasticity, equilibrium, voronoi_network
from critflow_extras import critical_from_perimeters


@pytest.fixture(scope="module")
def case():
    """Faces of different perimeters and stiffnesses past their transition, and their response."""
    network, rng = voronoi_network(100, seed=1), np.random.default_rng(1)
    perimeters, stiffness = 1 + 0.03 * rng.standard_normal(50), rng.uniform(0.5, 2.0, 50)
    start = critical_from_perimeters(network, perimeters, stiffness=stiffness).value.at_rest()
    state = equilibrium(start.deformed(np.sqrt(1.03) * np.eye(2)), tolerance=1e-15).value
    response = elasticity(state)
    assert response.status is Status.ok
    return state, response


@pytest.mark.parametrize("strain", STRAIN_PATHS)
def test_moduli_are_second_derivatives_of_relaxed_energies(case, strain):
    assert_moduli_of_energies(*case, strain)


def test_responses_are_derivatives(case):
    assert_stress(*case)
    assert_relaxations(*case)
    assert_affine(*case)


@pytest.mark.parametrize("path", ["dilation", "simple_shear", "uniaxial"])
def test_exact_stiffening_is_the_limit_of_paths(path):
    assert_limit_of_paths(disordered_tissue(varied=True)[1].value, path)
