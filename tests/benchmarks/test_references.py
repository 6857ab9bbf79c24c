"""References of the benchmarks: mpmath against numpy, definitions and the library; double-double against mpmath."""

import mpmath
import numpy as np
import pytest
from problems import random_stress

from critflow import CriticalManifold, Network, critical_from_lengths, upper_bound, voronoi_network
from critflow.double_double import add, divide, lengths, square_root
from critflow.sparse import block_laplacian
from workflows.benchmarks import reference, references
from workflows.benchmarks.reference import MP

# Digits in which energies are differentiated.
DIGITS = 70


@pytest.fixture(scope="module")
def network():
    return voronoi_network(12, 3, hard_core=0.5)


@pytest.fixture(scope="module")
def manifold(network):
    return CriticalManifold(network)


@pytest.fixture(scope="module")
def exact(network):
    return reference.configuration(network, random_stress(network.n_edges, 1), digits=DIGITS)


# Linear systems


def test_systems_are_solved_and_singular_ones_refused():
    rng = np.random.default_rng(0)
    matrix, right = rng.standard_normal((2, 9, 9))
    matrix[0, 0] = 0.0  # needs an exchange of rows
    found = reference.solve(reference.numbers(matrix), reference.numbers(right))
    residual = reference.numbers(matrix) @ found - reference.numbers(right)
    np.testing.assert_allclose(found.astype(float), np.linalg.solve(matrix, right), rtol=1e-12)
    assert reference.largest(residual) < 1e-55
    matrix[1] = matrix[0]
    with pytest.raises(reference.Unknown):
        reference.solve(reference.numbers(matrix), reference.numbers(right))


def test_too_few_digits_are_detected_and_increased():
    """Two vertices joined by σ = 1e40: 20 digits lose their bonds to the rest, of σ = 1e-40."""
    a, b = reference.numbers([1e40, 1e-40])
    attempts = []

    @reference.precise
    def ends():
        attempts.append(MP.dps)
        matrix = np.array([[a + b, -a], [-a, a + b]], dtype=object)
        return reference.solve(matrix, np.array([[0 * b], [b]], dtype=object))

    # (a + b) x = a y and (a + b) y − a x = b have y = (a + b)/(2a + b), x = a/(2a + b).
    np.testing.assert_allclose(ends(digits=20).astype(float).ravel(), [0.5, 0.5], rtol=1e-15)
    assert attempts[0] == 20 and attempts[-1] > 80


def test_digits_lost_to_rounding_are_detected():
    """The Hilbert matrix of order 8 loses ten digits of 35, and 30 are required."""
    with MP.workdps(100):
        hilbert = np.array([[MP.one / (i + j + 1) for j in range(8)] for i in range(8)], dtype=object)
        right = hilbert.sum(axis=1)[:, None]
    with pytest.raises(reference.Unknown), MP.workdps(35):
        reference.solve(hilbert, right)
    assert reference.largest_error(np.ones((8, 1)), reference.solve(hilbert, right)) < 1e-40


def test_errors_of_doubles_are_exact():
    truth = np.array([MP.one, MP.mpf("2.000000000000000000000000000001")])
    assert reference.largest_error([1.0, 2.0], truth) == pytest.approx(1e-30, rel=1e-15)
    assert reference.largest_error([np.nan, 2.0], truth) == np.inf
    moved = reference.numbers([[0.0], [2.1]]) - reference.numbers([[0.0], [0.1]])
    assert reference.largest_error([[0.1], [2.1]], moved, moved=True) < 1e-50


def test_the_precision_of_other_users_of_mpmath_does_not_change():
    assert mpmath.mp.dps == 15
    assert MP.dps == reference.DIGITS


# mpmath against dense numpy, and against the library in well-conditioned cases


def test_the_largest_bulk_modulus_agrees_with_the_library(network):
    assert float(reference.largest_bulk_modulus(network)) == pytest.approx(upper_bound(network, "B_0"), rel=1e-13)


def test_critical_lengths_are_proportional_and_balanced(network, manifold):
    target = 1 + 0.05 * np.random.default_rng(2).standard_normal(network.n_edges)
    found = critical_from_lengths(manifold, target).value
    critical = reference.critical_from_lengths(network, target, found.sigma, found.coordinates)
    ratios = reference.lengths(critical.bond_vectors) / reference.numbers(target)
    assert reference.largest(ratios / ratios[0] - 1) < 1e-50
    force = reference.incidence(network).T @ (critical.sigma[:, None] * critical.bond_vectors)
    assert reference.largest(force) < 1e-50


def test_slack_edges_are_refused(network):
    sigma = np.ones(network.n_edges)
    sigma[3] = -1.0
    signed = reference.configuration(network, sigma)
    with pytest.raises(reference.Unknown, match="slack"):
        reference.critical_from_lengths(network, reference.lengths(signed.bond_vectors), sigma, signed.coordinates)


# mpmath against derivatives of its energy


class Energy:
    """The energy of springs at rest in a critical configuration after a deformation F of the boundary."""

    def __init__(self, network, critical):
        self.network, self.critical, self.rest = network, critical, reference.lengths(critical.bond_vectors)

    def relaxed(self, F):
        start = self.critical.coordinates @ F.T
        return reference.equilibrium(self.network, self.rest, start, F, digits=DIGITS)

    def __call__(self, F):
        return reference.energy(self.network, self.rest, self.relaxed(F).bond_vectors, digits=DIGITS)


def expanded(strain):
    """F of a relative change of the area."""
    return reference.numbers(np.eye(2)) * MP.sqrt(1 + strain)


def sheared(strain):
    return reference.numbers(np.eye(2)) + reference.numbers([[0.0, 0.5], [0.5, 0.0]]) * strain


def relative(found, expected):
    return abs(float(found / expected - 1))


@pytest.fixture
def springs(network, exact):
    with MP.workdps(DIGITS):
        yield Energy(network, exact)


def test_moduli_are_second_derivatives_of_the_energy(network, springs):
    strain, h = MP.mpf(1) / 1024, MP.mpf("1e-11")
    F = expanded(strain)
    # The same springs in a cell of the doubles that the network has: lengths in units of √(1 + γ).
    state = springs.relaxed(F)
    size = MP.sqrt(1 + strain)
    bulk, shear, corrected = reference.linear_response(network, state.bond_vectors / size, springs.rest / size)
    V, middle = reference.volume(network) * (1 + strain), springs(F)
    # B refers to the relative change of the strained volume.
    around = [springs(expanded((1 + strain) * (1 + e) - 1)) for e in (-h, h)]
    assert relative(bulk, (sum(around) - 2 * middle) / (h * h * V)) < 1e-17
    assert relative(shear - corrected, (around[1] - around[0]) / (4 * h * V)) < 1e-15
    around = [springs(sheared(e) @ F) for e in (-h, h)]
    assert relative(shear, (sum(around) - 2 * middle) / (h * h * V)) < 1e-15


def test_stiffening_coefficients_are_third_derivatives_of_the_energy(network, exact, springs):
    # E(γ) above the transition is Σ e_n γⁿ from n = 2; six strains leave an error of γ⁶.
    h, n = MP.mpf("1e-6"), 6
    energies = np.array([[springs(expanded(h * j)) / h**2] for j in range(1, n + 1)])
    powers = reference.numbers([[float(j**m) for m in range(2, n + 2)] for j in range(1, n + 1)])
    coefficients = reference.solve(powers, energies)[:, 0]
    second, third = 2 * coefficients[0], 6 * coefficients[1] / h
    V = reference.volume(network)
    B_0, _, C_B, _, _ = reference.stiffening(network, exact)
    assert relative(B_0, reference.transition_moduli(network, exact)[0]) < 1e-50
    assert relative(B_0, second / V) < 1e-24
    assert relative(C_B, (second + third) / V) < 1e-18


# Double-double arithmetic against mpmath


def error(found, truth):
    """Largest error of double-double numbers, relative to the largest number."""
    return reference.largest(reference.numbers(found.high, found.low) - truth) / reference.largest(truth)


def test_double_double_configurations(network, manifold, exact):
    x, L = references.configuration(manifold, random_stress(network.n_edges, 1))
    assert error(x, exact.coordinates[network.free]) < 1e-28
    assert error(L, exact.bond_vectors) < 1e-28


@pytest.mark.parametrize("strain", [1e-3, 1e-5])
def test_double_double_equilibria_and_moduli(network, manifold, exact, strain):
    x, L = references.configuration(manifold, random_stress(network.n_edges, 1))
    rest = divide(lengths(L), square_root(add(references.constant(1.0), references.constant(strain))))
    state, factor = references.equilibrium(network, rest, x.high, block_laplacian(network))
    rest_lengths = reference.lengths(exact.bond_vectors) / MP.sqrt(1 + MP.mpf(strain))
    truth = reference.equilibrium(network, rest_lengths, exact.coordinates)
    # Rounding of 1e-31 in forces, over the softness 1/γ of the springs.
    assert error(state.x, truth.coordinates[network.free]) < 1e-26 / strain
    moduli = references.moduli(state, factor)
    response = reference.linear_response(network, truth.bond_vectors, rest_lengths)
    volume = reference.volume(network) / reference.numbers(network.volume)
    for n, modulus in enumerate(moduli):
        assert error(modulus, response[n : n + 1] * volume) < 1e-26 / strain


@pytest.mark.parametrize("rest_length, minimum", [(0.4, True), (0.6, False)])
def test_a_straight_chain_is_a_minimum_in_tension_alone(rest_length, minimum):
    chain = Network([[0, 1], [1, 2]], pins={0: np.zeros(2), 2: np.array([1.0, 0.0])})
    exact = reference.equilibrium(chain, np.full(2, rest_length), np.array([[0, 0], [0.5, 0], [1, 0]]))
    assert reference.is_minimum(chain, exact, np.full(2, rest_length)) is minimum
