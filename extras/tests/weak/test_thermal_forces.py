"""Temperature on critical networks: against free energies, averages over floppy motions, and chains in closed form."""

import numpy as np
import pytest
from refusals import refused
from scipy.integrate import quad
from scipy.special import j0, j1

from critflow import CriticalManifold, Network, Status, optimize, strain_path, three_bar_linkage, voronoi_network
from critflow_extras import AngleSprings, Temperature, weak_forces
from critflow_extras.weak.weak_equilibrium import weak_equilibrium

CRITICAL = optimize(voronoi_network(60, seed=1), "B_0").value
TEMPERATURES = np.array([1e-3, 1e-4, 1e-6, 1e-8])
STRAINS = np.array([-1e-2, -1e-3, 0.0, 1e-3, 1e-2])[:, None]
ALONG = [[1.0, 0.0], [0.0, 0.0]]


def chain(n):
    """n unit edges in a row between two pins."""
    if n == 3:
        network = three_bar_linkage()
    else:
        network = Network(
            np.stack([np.arange(n), np.arange(1, n + 1)], axis=1), pins={0: np.zeros(2), n: np.array([float(n), 0.0])}
        )
    return CriticalManifold(network.with_volume(float(n))).configuration(np.ones(n))


def test_springs_of_entropy_and_of_energy_are_in_series():
    # Dτ² − cγτ − N_f T/2 = 0 in closed form, and its moduli: c²/V over the sum D + N_f T/2τ².
    weak, n_floppy = weak_forces(CRITICAL, Temperature(), order="cubic").value, 29
    c, D, V = weak.work, weak.compliance, CRITICAL.network.volume * (1 + STRAINS)
    tau = (c * STRAINS + np.sqrt((c * STRAINS) ** 2 + 2 * D * n_floppy * TEMPERATURES)) / (2 * D)
    np.testing.assert_allclose(weak.tension(STRAINS, TEMPERATURES), tau, rtol=1e-12)
    np.testing.assert_allclose(weak.stress(STRAINS, TEMPERATURES), c * tau / V, rtol=1e-12)
    modulus = c**2 / V / (D + n_floppy * TEMPERATURES / (2 * tau**2))
    np.testing.assert_allclose(weak.modulus(STRAINS, TEMPERATURES), modulus, rtol=1e-12)
    np.testing.assert_allclose(weak.crossover(TEMPERATURES), np.sqrt(D * n_floppy * TEMPERATURES / 2) / c, rtol=1e-12)


def test_the_entropic_stress_is_that_of_free_energies():
    # E + ½T ln det H of relaxed springs, linear in T; deviations are proportional to strain.
    weak, h, V, T = weak_forces(CRITICAL, Temperature()).value, 1e-5, CRITICAL.network.volume, 1e-11
    deviations = []
    for gamma in (1e-3, 1e-2):
        path = strain_path(CRITICAL, [gamma - h, gamma + h]).value
        hessians = [each.factorize().multiply(np.eye(each.forces.size)) for each in path.states]
        ln_det = [np.linalg.slogdet(H)[1] for H in hessians]
        entropic = 0.5 * (ln_det[1] - ln_det[0]) / (2 * h)
        ours = (weak.stress(gamma, 2 * T) - weak.stress(gamma, T)) * V * (1 + gamma) / T
        deviations.append(abs(ours / entropic - 1))
    assert deviations[0] < 2e-3
    assert deviations[1] / deviations[0] == pytest.approx(10, rel=0.1)


@pytest.mark.parametrize("n", [20, 60])
def test_tensions_are_averages_over_floppy_motions_within_the_stated_errors(n):
    # Energies (cγ + y)²/2D of y = ½vᵀPv, whose number of states is y^{N_f/2 − 1}.
    weak = weak_forces(optimize(voronoi_network(n, seed=1), "B_0").value, Temperature(), order="cubic").value
    n_floppy = n // 2 - 1
    for T in TEMPERATURES[2:]:
        for place in (-2.0, -0.5, 0.0, 0.5, 2.0):
            gamma = place * weak.crossover(T)
            width, z = np.sqrt(weak.compliance * T), weak.work * gamma / np.sqrt(weak.compliance * T)
            weight = lambda u, power, z=z: u ** (n_floppy - 1 + power) * np.exp(-((z + u**2) ** 2) / 2)  # noqa: E731
            mean = quad(weight, 0, 8, args=(2,))[0] / quad(weight, 0, 8, args=(0,))[0]
            true = (weak.work * gamma + width * mean) / weak.compliance
            error = weak.error(gamma, T)
            # The estimate is the first order in 1/N_f.
            assert abs(weak.tension(gamma, T) - true) <= 1.2 * error
            assert error < 0.5 * true


def chain_force(n, length, T):
    """Mean force between the ends of n springs of unit rest length and stiffness in the plane, by Hankel transform."""
    r = 1 + np.sqrt(T) * np.linspace(-9, 9, 901)
    weight = r * np.exp(-((r - 1) ** 2) / (2 * T))
    nodes, weights = np.polynomial.legendre.leggauss(20)
    half = 4.5 / np.sqrt(T) / 500
    q = half * (np.arange(1, 1000, 2)[:, None] + nodes)
    one = (np.array([j0(part[:, None] * r) @ weight for part in q]) / weight.sum()) ** n * weights
    return T * np.sum(q**2 * one * j1(q * length)) / np.sum(q * one * j0(q * length))


# Longer and colder chains lose the digits of the transform.
@pytest.mark.parametrize(("n", "T"), [(3, 1e-4), (3, 1e-5), (5, 1e-4)])
def test_chains_pull_as_exact_averages_say_within_the_stated_errors(n, T):
    # All motions vary, not the floppy ones alone, and all orders of the energy count.
    leading, weak = (weak_forces(chain(n), Temperature(), ALONG, order=order).value for order in ("cubic", "full"))
    counted = 0
    for place in (-0.5, 0.0, 0.5, 2.0, 4.0):
        gamma = place * leading.crossover(T)
        true = chain_force(n, n * (1 + gamma), T)
        assert abs(leading.tension(gamma, T) - true) <= leading.error(gamma, T)
        if weak.status(gamma, T) == Status.ok:
            assert abs(weak.tension(gamma, T) - true) <= weak.error(gamma, T) < 0.1 * true
            counted += 1
    assert counted >= 2


BAD = {
    "zero": (lambda: weak_forces(CRITICAL, Temperature()).value.tension(0.0, 0.0), "temperature"),
    "negative": (lambda: weak_forces(CRITICAL, Temperature()).value.modulus(0.0, [1e-3, -1e-3]), "temperature"),
    "with angles": (lambda: weak_forces(CRITICAL, [AngleSprings(), Temperature()]), "alone"),
    "relaxed": (lambda: weak_equilibrium(CRITICAL, Temperature(), [0.0], 1e-3), "alone"),
}


test_bad_input_raises_one_sentence = refused(BAD)
