"""What other folders of critflow-extras say of a tissue."""

import numpy as np
import pytest
from increments import assert_increments
from refusals import refused

from critflow import elasticity, equilibrium, lattice, voronoi_network
from critflow_extras import AngleSprings, critical_from_perimeters, design, weak_forces
from critflow_extras.hessian.splits import geometric_split, hookean_split

TISSUE = critical_from_perimeters(lattice("honeycomb", 3, 3), np.ones(9))
BAD = {
    "design": (lambda: design(TISSUE.value.at_rest(), {"B_0": 1.0}, change="stiffness"), "springs on edges"),
    "weak forces": (lambda: weak_forces(TISSUE, AngleSprings()), "not springs on edges"),
}
test_bad_input_raises_one_sentence = refused(BAD)


@pytest.mark.parametrize("split", [geometric_split, hookean_split])
def test_both_splits_are_the_hessian_of_tissues(split):
    state = TISSUE.value.at_rest().deformed(np.diag([1.1, 0.95]))
    state = state.moved(0.05 * np.random.default_rng(1).standard_normal(state.forces.shape))
    H = state.factorize().multiply(np.eye(state.forces.size))
    np.testing.assert_allclose(split(state).hessian.toarray(), H, rtol=0, atol=1e-12 * np.abs(H).max())


def test_increments_of_the_stress_are_those_of_relaxed_tissues():
    network, rng = voronoi_network(100, seed=1), np.random.default_rng(1)
    perimeters, stiffness = 1 + 0.03 * rng.standard_normal(50), rng.uniform(0.5, 2.0, 50)
    start = critical_from_perimeters(network, perimeters, stiffness=stiffness).value.at_rest()
    state = equilibrium(start.deformed(np.sqrt(1.03) * np.eye(2)), tolerance=1e-15).value
    assert_increments(state, elasticity(state))
