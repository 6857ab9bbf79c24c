"""Weak forces in other units of stiffness and length."""

from functools import partial

import numpy as np
import pytest
from problems import hung_ring, random_stress
from units import INVERSE, SCALED, Units, same_in_units

from critflow import CriticalManifold, InputError, voronoi_network
from critflow_extras import AngleSprings, PointForces, SoftSprings, Temperature, weak_forces
from critflow_extras.weak.weak_equilibrium import weak_equilibrium

STRAINS, KAPPA = np.array([-1e-3, 0.0, 2e-3]), 1e-4
PAIRS = np.stack([np.arange(10), np.arange(10, 20)], axis=1)


def energies(units):
    rng = np.random.default_rng(5)
    forces = rng.standard_normal((20, 2))
    return {
        "angles": AngleSprings(stiffness=units.energy),
        "soft": SoftSprings(PAIRS, 0.2 * units.stiffness, 0.5 * units.length),
        "loads": PointForces(0.1 * units.force * (forces - forces.mean(axis=0))),
    }


def measured(network, units, energy, deformation="dilation"):
    critical = CriticalManifold(network).configuration(random_stress(network.n_edges, 2))
    weak = weak_forces(critical, energies(units)[energy], deformation).value
    relaxed = weak_equilibrium(critical, energies(units)[energy], STRAINS, KAPPA, deformation, throw=False).value
    return {
        "number": (weak.status(STRAINS, KAPPA), relaxed.status),
        "stiffness": (
            *(weak.tension(STRAINS, KAPPA), weak.stress(STRAINS, KAPPA), weak.modulus(STRAINS, KAPPA)),
            *(weak.modulus(STRAINS, KAPPA, "simple_shear"), relaxed.stress),
        ),
        "length": (weak.displacement(STRAINS, KAPPA),),
    }


def errors(network, units, energy):
    """Estimates, which rounding moves more than values."""
    critical = CriticalManifold(network).configuration(random_stress(network.n_edges, 2))
    weak = weak_forces(critical, energies(units)[energy]).value
    named = weak.error, weak.stress_error, weak.modulus_error
    return {"stiffness": [function(STRAINS, KAPPA) for function in named]}


def warm(network, units):
    critical = CriticalManifold(network).configuration(random_stress(network.n_edges, 2))
    weak, T = weak_forces(critical, Temperature()).value, 1e-5 * units.energy
    return {"stiffness": (weak.stress(STRAINS, T), weak.stress_error(STRAINS, T), weak.modulus_error(STRAINS, T))}


NETWORK = partial(voronoi_network, 20, seed=1)
FAR = [SCALED, INVERSE, Units(length=2.0**-40), Units(stiffness=2.0**-60)]
KINDS = ("angles", "soft", "loads")
test_weak_forces_in_other_units = same_in_units(
    {name: (partial(measured, energy=name), NETWORK) for name in KINDS}, 1e-6, FAR
)
test_errors_in_other_units = same_in_units({name: (partial(errors, energy=name), NETWORK) for name in KINDS}, 1e-3, FAR)
test_temperature_in_other_units = same_in_units({"warm": (warm, NETWORK)}, 1e-6, FAR)


@pytest.mark.parametrize("unit", [1e-20, 1.0, 1e20])
def test_loads_balance_relative_to_their_size(unit):
    forces = np.random.default_rng(1).standard_normal((20, 2))
    PointForces(unit * (forces - forces.mean(axis=0))).on(NETWORK())
    with pytest.raises(InputError, match="sum to zero"):
        PointForces(unit * (forces - forces.mean(axis=0) + 1e-9)).on(NETWORK())
    PointForces(unit * np.ones((hung_ring().n_vertices, 2))).on(hung_ring())


@pytest.mark.parametrize("unit", [2.0**-40, 2.0**40])
def test_systems_of_weak_forces_are_refined_in_all_units(unit):
    """A load and elongations whose solution has all digits, whatever their units."""
    critical = CriticalManifold(NETWORK()).configuration(random_stress(30, 2))
    system = weak_forces(critical, AngleSprings()).value._model.system
    load, elongation = np.random.default_rng(3).standard_normal(system.rigidity.shape[1]), np.cos(np.arange(30))
    factor = system.factorize(2.0)
    here, there = factor.solve(load, elongation), factor.solve(unit * load, unit * elongation)
    np.testing.assert_array_equal(there[0], unit * here[0])
    np.testing.assert_array_equal(there[1], unit * here[1])
    elongated = system.rigidity @ here[0]
    null = critical.sigma / np.linalg.norm(critical.sigma)
    np.testing.assert_allclose(elongated, elongation - (null @ elongation) * null, rtol=0, atol=1e-13)
