"""Strains of a path from an onset count from it, and the path says which strains of the network these are."""

from dataclasses import astuple

import numpy as np
import pytest

from critflow import CriticalManifold, Deformation, equilibrium, spring_state, stiffening, strain_path, voronoi_network
from critflow.springs import Cable
from critflow_extras import critical_strain, fibre_network
from critflow_extras.cables.total_strain import strain_of

NETWORK = fibre_network("mikado", 60, z=3.4, seed=2)
LENGTHS = np.linalg.norm(NETWORK.bond_vectors(NETWORK.positions), axis=1)
# Rest lengths longer than those of a transition, so that all edges become taut together.
TAUT = (voronoi := voronoi_network(40, seed=1)), 1.05 * CriticalManifold(voronoi).configuration(np.ones(60)).lengths
TURN = np.array([[0.0, 0.4], [0.1, 0.0]])
# A deformation, and γ of the path for a total strain 0.05 past the onset.
DEFORMATIONS = {
    "uniaxial": lambda onset: (1.05 + onset) / (1 + onset) - 1,
    "dilation": lambda onset: (1.05 + onset) / (1 + onset) - 1,
    "pure_shear": lambda onset: (1.05 + onset) / (1 + onset) - 1,
    "simple_shear": lambda onset: 0.05,
    "exponential": lambda onset: 0.05,
}


@pytest.mark.parametrize("name", DEFORMATIONS)
def test_total_strains_are_those_of_the_network_as_given(name):
    deformation = Deformation.exponential(TURN) if name == "exponential" else name
    onset = critical_strain(NETWORK, LENGTHS, deformation)
    strain = DEFORMATIONS[name](onset.value.strain)
    found = strain_path(onset, [0.5 * strain, strain], deformation, measure="energy")
    total = found.value.total_strains
    assert total[1] == pytest.approx(onset.value.strain + 0.05, rel=1e-10)
    assert "strains count from the onset" in found.note and "total_strains" in repr(found)
    # Without a name the deformation is that of the onset.
    silent = strain_path(onset.value, [0.5 * strain, strain], measure="energy").value
    np.testing.assert_array_equal(silent.energy, found.value.energy)
    np.testing.assert_array_equal(silent.total_strains, total)
    # Cables of the network as given, relaxed at the total strain without a path.
    F = found.value.deformation.gradient(total[1])
    deformed = NETWORK.deformed(F)
    start = spring_state(deformed, LENGTHS, found.value.states[1].coordinates, Cable())
    assert equilibrium(start, throw=False).value.energy == pytest.approx(found.value.energy[1], rel=1e-8)


@pytest.mark.parametrize("name", ["simple_shear", "dilation"])
def test_coefficients_are_along_the_deformation_of_the_onset(name):
    onset = critical_strain(*TAUT, name)
    named = stiffening(onset.value.configuration, deformation=name).value
    other = stiffening(onset, deformation="uniaxial").value
    assert astuple(stiffening(onset).value) == astuple(stiffening(onset.value).value) == astuple(named)
    assert (
        astuple(other) == astuple(stiffening(onset.value.configuration, deformation="uniaxial").value) != astuple(named)
    )
    # They are those of the path, which has this deformation too.
    path = strain_path(onset, strains := 1e-4 * np.arange(1, 4)).value
    np.testing.assert_allclose(path.shear_modulus, named.shear_0 + named.C_G * strains, rtol=1e-3)
    # A configuration alone knows no onset.
    dilated = stiffening(onset.value.configuration, deformation="dilation").value
    assert astuple(stiffening(onset.value.configuration).value) == astuple(dilated)


def test_along_another_deformation_there_is_no_total_strain():
    onset = critical_strain(NETWORK, LENGTHS, "uniaxial")
    path = strain_path(onset, [0.01], "simple_shear", measure="energy").value
    assert np.isnan(path.total_strains).all()
    plain = strain_path(onset.value.configuration, [0.01], "uniaxial", measure="energy")
    np.testing.assert_array_equal(plain.value.total_strains, [0.01])
    assert plain.note == ""


def test_free_components_do_not_enter_the_total_strain():
    path = Deformation.uniaxial(2, sides="free")
    total = (1 + np.diag([0.0, 0.2])) * path.gradient(0.3)
    assert strain_of(path, total, 0.0) == pytest.approx(0.3, rel=1e-12)
    assert np.isnan(strain_of(Deformation.uniaxial(2), total, 0.0))
