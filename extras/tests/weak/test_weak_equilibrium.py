"""Equilibria of springs with a weak energy: balance, stress as a derivative, a closed form, slack edges, bad input."""

import numpy as np
import pytest
from problems import dense_incidence, random_stress
from refusals import refused_changes

from critflow import CriticalManifold, Network, Status, lattice, optimize, voronoi_network
from critflow_extras import AngleSprings, SoftSprings, critical_strain, fibre_network
from critflow_extras.weak.weak_energies import weak_function
from critflow_extras.weak.weak_equilibrium import weak_equilibrium

NETWORK = voronoi_network(40, seed=2)
CRITICAL = optimize(NETWORK, "B_0").value


def test_forces_balance_and_the_stress_is_the_derivative_of_the_energy():
    h = 1e-5
    strains = np.array([-2e-3, -h, 0.0, h, 2e-3])
    found = weak_equilibrium(CRITICAL, AngleSprings(), strains, 1e-3, "uniaxial").value
    assert (found.status == Status.ok).all()
    U, g = weak_function(AngleSprings(), NETWORK), dense_incidence(NETWORK)
    for gamma, state in zip(strains, found.states, strict=True):
        F = np.array([[1 + gamma, 0], [0, 1]])
        L = g @ state.coordinates + NETWORK.offsets @ (NETWORK.cell @ F.T)
        length = np.linalg.norm(L, axis=1)
        force = g.T @ (((length - CRITICAL.lengths) / length)[:, None] * L) + 1e-3 * U(state.coordinates, F)[1]
        assert np.abs(force).max() < 2e-13
        energy = 0.5 * np.sum((length - CRITICAL.lengths) ** 2) + 1e-3 * U(state.coordinates, F)[0]
        assert energy == pytest.approx(state.energy, rel=1e-12)
    slope = (found.energy[3] - found.energy[1]) / (2 * h)
    assert found.stress[2] * NETWORK.volume == pytest.approx(slope, rel=1e-6)


def test_a_network_with_slack_edges_has_equilibria():
    network = fibre_network("mikado", 60, seed=1)
    rest = np.linalg.norm(network.bond_vectors(network.positions), axis=1)
    onset = critical_strain(network, 1.02 * rest, "dilation").value
    assert (onset.configuration.sigma == 0).any()
    found = weak_equilibrium(onset.configuration, AngleSprings(pairs="fibres"), [0.0, 5e-3], 1e-3, throw=False)
    assert all((state.sigma >= 0).all() for state in found.value.states)  # cables
    assert found.ok and (found.value.stress > 0).all() and np.diff(found.value.stress)[0] > 0


def test_a_branch_is_followed_from_tension_downwards():
    # A load along a line of two springs of rest length 1, −κ y²/2 across it: stable where 2 (1 − 1/(1 + γ)) > κ.
    def pushed(x, F):
        across = np.zeros_like(x)
        across[0, 1] = 1.0
        return -0.5 * float(x[0, 1]) ** 2, -across * x, -np.diag(across.ravel())

    network = Network([[1, 0], [0, 2]], pins={1: [-1.0, 0.0], 2: [1.0, 0.0]}).with_volume(1.0)
    critical = CriticalManifold(network).configuration([1.0, 1.0])
    strains = np.array([0.005, 0.02, 0.012])
    found = weak_equilibrium(critical, pushed, strains, 0.02, [[1.0, 0.0], [0.0, 0.0]], throw=False).value
    np.testing.assert_array_equal(found.status == Status.ok, [False, True, True])
    np.testing.assert_allclose(found.tension[1:], strains[1:], rtol=1e-9)


def growing(x, F):
    """An energy without force whose Hessian has further entries away from the transition."""
    return 0.0, 0 * x, 1e-3 * (np.eye(x.size) + (F[0, 0] < 1.004))


GOOD = {"critical": CRITICAL, "energy": AngleSprings(), "strains": [0.0], "kappa": 1e-3}
test_bad_input = refused_changes(
    lambda **changes: weak_equilibrium(**GOOD | changes),
    ({"kappa": 0.0}, "kappa"),
    ({"kappa": np.nan}, "kappa"),
    ({"strains": [[0.0]]}, "row"),
    ({"strains": [np.inf]}, "finite"),
    ({"deformation": "uniaxial_free"}, "fixed components"),
    ({"energy": AngleSprings(np.ones(3))}, "pair"),
    ({"energy": lambda x, F: (np.nan, 0 * x, np.eye(x.size))}, "energy of the weak energy <lambda> is not finite"),
    ({"energy": lambda x, F: (0.0, np.nan * x, np.eye(x.size))}, "gradient of the weak"),
    ({"energy": lambda x, F: (0.0, 0 * x, np.nan * np.eye(x.size))}, "Hessian of the weak"),
    ({"energy": growing}, "keeps its pattern"),
)


@pytest.mark.parametrize("name", ["square", "honeycomb", "kagome"])
def test_angles_whose_entries_vanish_at_first_keep_their_pattern(name):
    # Right angles and straight ones have entries of zero until the network bends.
    network = lattice(name, 3, 3)
    critical = CriticalManifold(network).configuration(np.ones(network.n_edges))
    for energy in (AngleSprings(), [AngleSprings(), SoftSprings([[0, 5], [1, 7]])]):
        found = weak_equilibrium(critical, energy, [0.01, 0.005], 1e-4, "uniaxial", throw=False)
        assert found.ok and (found.value.tension > 0).all()


def test_a_failure_is_a_status():
    # Forces that pull every vertex from its neighbours leave no equilibrium: the energy has no lower bound.
    def pushed(x, F):
        return -float(np.sum(x**4)), -4 * x**3, np.diag(-12 * x.ravel() ** 2)

    critical = CriticalManifold(NETWORK).configuration(random_stress(NETWORK.n_edges, 1))
    found = weak_equilibrium(critical, pushed, [0.0], 10.0, throw=False)
    assert found.status is not Status.ok
    assert np.isnan(found.value.tension).all() and np.isnan(found.value.energy).all()
