"""Bounds on an onset: forces that are not in balance prove less, by their moments over any admissible configuration."""

import numpy as np
import pytest

from critflow import CriticalManifold, Network
from critflow.deformation import deformation_of
from critflow.taut_edges import OnsetState
from critflow_extras.cables.boundary_path import BoundaryPath
from critflow_extras.cables.bounds import Forces, admissible

# Two cables in a row between pins at distance 1, of the lengths 0.5 and 0.7: taut at a strain of 0.2.
CHAIN, LENGTHS = Network([[0, 1], [1, 2]], pins={0: [0, 0], 2: [1, 0]}), np.array([0.5, 0.7])
PATH = BoundaryPath(CriticalManifold(CHAIN), deformation_of("uniaxial", 2))


def excess(tensions, strain, middle=0.45):
    """What forces of given tensions prove at a strain, at the configuration with a vertex in the middle."""
    x = np.array([[middle, 0.0]])
    state = OnsetState(0.0, np.zeros(0), x, np.array(tensions) / [middle, 1 - middle], np.ones(2, bool))
    return Forces(PATH, LENGTHS, state).excess(strain)


@pytest.mark.parametrize(
    "tensions, strain, exact",
    [
        # In balance: F b − Σ ℓ.
        ((1.0, 1.0), 0.21, 0.01),
        ((1.0, 1.0), 0.19, -0.01),
        # The second alone pulls the middle, which lies within 0.5 of the first pin: 1 − 0.7 proves nothing.
        ((0.0, 1.0), 0.0, 1 - 0.7 - 0.5),
        ((0.0, 1.0), 0.15, 1.15 - 0.7 - 0.5),
        # A tenth is out of balance.
        ((0.9, 1.0), 0.21, 1.21 - 0.7 - 0.9 * 0.5 - 0.1 * 0.5),
    ],
)
def test_forces_out_of_balance_prove_less(tensions, strain, exact):
    found = excess(tensions, strain)
    assert found == pytest.approx(exact, abs=1e-13) and found < exact


def test_a_configuration_is_admissible_beyond_its_rounding_only():
    middle = np.array([[0.5, 0.0]])
    for slack, inside in ((1e-12, True), (1e-15, False), (0.0, False), (-1e-12, False)):
        lengths = np.array([0.5 * (1 + slack), 0.7])
        assert admissible(PATH, lengths, 0.0, np.zeros(0), middle) is inside


@pytest.mark.parametrize("size", [1e-9, 1.0, 1e9])
def test_the_strain_at_which_a_cell_is_flat_in_any_unit(size):
    """A double root, which rounding may split into complex ones, and two complex roots."""
    for angle in np.linspace(0.1, 3.0, 20):
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        for matrix, flat in (([[-0.5, 0.5], [0.0, -0.5]], 2.0), ([[-0.5, 0.5], [-0.5, -0.5]], np.inf)):
            path = BoundaryPath(PATH.manifold, deformation_of(size * turn @ matrix @ turn.T, 2))
            assert size * path.flat_strain(0.0, np.zeros(0)) == pytest.approx(flat, rel=1e-6)
