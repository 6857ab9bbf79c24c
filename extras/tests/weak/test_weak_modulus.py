"""The modulus under weak forces as a quantity: gradients against differences of `weak_forces`, and designs."""

import numpy as np
import pytest
from derivatives import assert_derivative, first_derivative
from problems import hung_ring, random_stress

from critflow import CriticalManifold, InputError, optimize, voronoi_network
from critflow_extras import AngleSprings, SoftSprings, Temperature, foam_network, properties, weak_forces
from critflow_extras.weak.weak_equilibrium import weak_equilibrium
from critflow_extras.weak.weak_modulus import WeakModulus


def soft_springs(network):
    half = network.n_vertices // 2
    return SoftSprings(np.stack([np.arange(half), np.arange(half, 2 * half)], axis=1), 0.2, 0.1)


NETWORKS = {
    "Voronoi": (voronoi_network(20, seed=1), "dilation"),
    "pinned": (hung_ring(), "uniaxial"),
    "space": (foam_network(52, 1), "dilation"),
}
ANGLES = np.concatenate([np.random.default_rng(3).uniform(0.8, 2.8, 24), np.full(8, np.pi)])


@pytest.mark.parametrize("strain", [0.0, 1e-3])
@pytest.mark.parametrize("energy", ["angles", "soft springs", "temperature"])
@pytest.mark.parametrize("name", NETWORKS)
def test_gradient_is_that_of_differences(name, energy, strain):
    network, deformation = NETWORKS[name]
    angles = AngleSprings(ANGLES if name == "pinned" else None)
    weak = {"angles": angles, "soft springs": soft_springs(network), "temperature": Temperature()}[energy]
    kappa = 1e-3 if name == "Voronoi" and energy != "temperature" else 1e-5  # where the theory holds
    objective, manifold = WeakModulus(weak, kappa, strain, deformation), CriticalManifold(network)

    def modulus(stress):
        return weak_forces(manifold.configuration(stress), weak, deformation).value.modulus(strain, kappa)

    sigma = 2 * random_stress(network.n_edges, 3)
    balance = manifold.balance(sigma)
    value, partials = objective.evaluate(balance)
    gradient = balance.pull_back(*partials)[0]
    assert np.isfinite(value) and value == pytest.approx(modulus(sigma), rel=1e-13)
    directions = np.random.default_rng(0).standard_normal((2, len(sigma)))
    assert_derivative(modulus, gradient, sigma, directions, 2e-3, 0.0, 1e-6 * np.linalg.norm(gradient))
    # The scale of the stress does not matter.
    assert abs(gradient @ sigma) < 1e-7 * np.linalg.norm(gradient) * np.linalg.norm(sigma)


@pytest.mark.parametrize(("name", "strain"), [("Voronoi", 1e-3), ("pinned", 0.0)])
def test_derivatives_by_stiffness_are_those_of_differences(name, strain):
    network, deformation = NETWORKS[name]
    energy, sigma = AngleSprings(ANGLES if name == "pinned" else None), random_stress(network.n_edges, 3)

    def modulus(stiffness):
        critical = CriticalManifold(network.with_stiffness(stiffness)).configuration(sigma)
        return weak_forces(critical, energy, deformation).value.modulus(strain, 1e-4)

    k = random_stress(network.n_edges, 4) + 0.5
    objective = WeakModulus(energy, 1e-4, strain, deformation)
    critical = CriticalManifold(network.with_stiffness(k)).configuration(sigma)
    found = properties(critical, objective)
    row, u = found.by_stiffness[objective.name], np.random.default_rng(1).standard_normal(len(k))
    assert_derivative(modulus, row, k, [u], 2e-3, 0.0, 1e-6 * np.linalg.norm(row))
    # The error is that of the theory, and of differences along a strain.
    theory = weak_forces(critical, energy, deformation).value.modulus_error(strain, 1e-4)
    assert 1e-9 < (found.errors[objective.name] - theory) / found.values[objective.name] < 1e-7


def test_a_design_is_stiffer_than_the_largest_bulk_modulus_also_by_relaxed_energies():
    network, energy, kappa, step = voronoi_network(30, seed=1), AngleSprings(), 1e-3, 2e-4
    start = optimize(network, "B_0").value
    found = optimize(network, WeakModulus(energy, kappa), start=start.sigma, max_steps=15, throw=False)
    moduli = []
    for critical in (start, found.value):
        strains = step * np.array([-2, -1, 0, 1, 2])
        stress = weak_equilibrium(critical, energy, strains, kappa).value.stress * (1 + strains) ** 2
        relaxed = first_derivative(lambda gamma, stress=stress: stress[round(gamma / step) + 2], step)
        assert weak_forces(critical, energy).value.modulus(0.0, kappa) == pytest.approx(relaxed, rel=0.05)
        moduli.append(relaxed)
    assert moduli[1] > 1.05 * moduli[0]


def test_values_beyond_the_theory_are_nan():
    objective = WeakModulus(AngleSprings(), 1e-6, -0.2)
    found = properties(optimize(voronoi_network(20, seed=1), "B_0").value, objective)
    assert np.isnan(found.values[objective.name]) and np.isnan(found.by_stiffness[objective.name]).all()


def test_kappa_must_be_positive_and_the_equation_full():
    with pytest.raises(InputError, match="kappa must be positive"):
        WeakModulus(AngleSprings(), 0.0)
    critical = optimize(voronoi_network(20, seed=1), "B_0").value
    cubic = weak_forces(critical, AngleSprings(), order="cubic").value
    with pytest.raises(InputError, match="full equation"):
        cubic.modulus_derivatives(0.0, 1e-3)
