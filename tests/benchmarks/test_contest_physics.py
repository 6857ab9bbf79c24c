"""Contests of springs: references against decimals of 70 digits and other formulas, methods against references."""

from decimal import Decimal, localcontext

import numpy as np
import pytest

from critflow import Status, stiffening
from critflow.precision.double_double import extended, lengths
from workflows.benchmarks.speed_accuracy import coefficients as coefficient_tasks
from workflows.benchmarks.speed_accuracy import moduli as modulus_tasks
from workflows.benchmarks.speed_accuracy import strain as strain_tasks
from workflows.benchmarks.speed_accuracy.moduli import StressedSprings, random_critical
from workflows.benchmarks.speed_accuracy.springs import (
    extended_critical,
    extended_equilibrium,
    extended_moduli,
    extended_slopes,
    extended_transition_moduli,
    rest_lengths_at,
    slope_at_start,
    total,
)
from workflows.benchmarks.speed_accuracy.strain import StrainStep

# As small as a network of the contest gets; dense matrices of decimals are slow.
N_VERTICES, SEED = 24, 2
TASKS = {task.word: task for m in (strain_tasks, modulus_tasks, coefficient_tasks) for task in m.TASKS}


class Decimals:
    """A network's springs in decimals: strained boundaries, dense Newton, energies.  Shares no code with critflow."""

    def __init__(self, network, sigma):
        self.g, self.k = decimals(network.free_incidence.toarray()), decimals(network.stiffness)
        self.b, self.volume = decimals(network.boundary_vectors), Decimal(network.volume)
        sigma = decimals(sigma)
        P = self.g.T @ (sigma[:, None] * self.g)
        self.x = -solved(P, self.g.T @ (sigma[:, None] * self.b))
        self.rest = norms(self.g @ self.x + self.b)

    def relaxed(self, F):
        """Coordinates and energy after the deformation F of the critical configuration."""
        x, b = self.x @ F.T, self.b @ F.T
        for _ in range(60):
            L = self.g @ x + b
            length = norms(L)
            sigma = self.k * (length - self.rest) / length
            K = (self.k - sigma) / length**2
            H = decimals(np.zeros((2 * len(x), 2 * len(x))))
            for row in range(2):
                for col in range(2):
                    block = K * L[:, row] * L[:, col] + (sigma if row == col else 0)
                    H[row::2, col::2] = self.g.T @ (block[:, None] * self.g)
            u = solved(H, (self.g.T @ (sigma[:, None] * L)).reshape(-1, 1)).reshape(x.shape)
            x = x - u
            if abs(u).max() < Decimal("1e-45"):
                extension = norms(self.g @ x + b) - self.rest
                return x, sum(self.k * extension**2) / 2
        raise AssertionError("Newton's method in decimals did not end")

    def expanded(self, strain):
        size = (1 + strain).sqrt()
        return np.array([[size, Decimal(0)], [Decimal(0), size]])

    def sheared(self, strain):
        return np.array([[Decimal(1), strain / 2], [strain / 2, Decimal(1)]])


def decimals(values):
    return np.vectorize(Decimal, otypes=[object])(np.asarray(values, float))


def norms(vectors):
    return np.vectorize(Decimal.sqrt, otypes=[object])((vectors**2).sum(axis=1))


def solved(A, right):
    """A⁻¹ right by Gaussian elimination, for a positive definite A."""
    A, x = A.copy(), right.copy()
    for n in range(len(A)):
        part = A[n + 1 :, n] / A[n, n]
        A[n + 1 :, n:] -= part[:, None] * A[n, n:]
        x[n + 1 :] -= part[:, None] * x[n]
    for n in reversed(range(len(A))):
        x[n] = (x[n] - A[n, n + 1 :] @ x[n + 1 :]) / A[n, n]
    return x


def exactly(value):
    """An extended number, or an array of them, as decimals."""
    return decimals(value.high) + decimals(value.low)


@pytest.fixture(scope="module")
def by_hand():
    manifold, critical = random_critical(N_VERTICES, SEED)
    with localcontext(prec=70):
        yield Decimals(manifold.network, critical.sigma), manifold, critical


def test_sums_of_any_number_of_extended_numbers():
    for n in (1, 2, 3, 7, 64, 101):
        values = 1.0 / np.arange(1, n + 1)
        with localcontext(prec=40):
            assert abs(exactly(total(extended(values)))[0] - sum(decimals(values))) < Decimal("1e-29")


def test_slopes_of_polynomials():
    t = np.array([0.0, 0.1, 0.25, 0.5])
    values = [extended(np.array([3.0 - 2.0 * s + 5.0 * s**2 - s**3])) for s in t]
    assert slope_at_start(t, values).high[0] == pytest.approx(-2.0, rel=1e-14)


def test_references_of_configurations_and_equilibria(by_hand):
    hand, manifold, critical = by_hand
    x, L = extended_critical(critical)
    assert abs(exactly(x) - hand.x).max() < Decimal("1e-28")
    rest = lengths(L)
    assert abs(exactly(rest) - hand.rest).max() < Decimal("1e-27")
    for strain in (1e-3, 1e-5):
        state, _ = extended_equilibrium(manifold.network, rest_lengths_at(rest, strain), x.high, manifold.hessian)
        size = (1 + Decimal(strain)).sqrt()
        apart = exactly(state.x) * size - hand.relaxed(hand.expanded(Decimal(strain)))[0]
        # Rounding of 1e-31 in forces, over the softness 1/γ of the springs.
        assert abs(apart).max() < Decimal("1e-26") / Decimal(strain) ** 1


def test_references_of_moduli_are_differences_of_energies(by_hand):
    hand, manifold, critical = by_hand
    x, L = extended_critical(critical)
    strain, h = 1e-3, Decimal("1e-11")
    state, factor = extended_equilibrium(
        manifold.network, rest_lengths_at(lengths(L), strain), x.high, manifold.hessian
    )
    moduli = extended_moduli(state, factor)
    gamma = Decimal(strain)
    V, at = hand.volume * (1 + gamma), hand.expanded(gamma)
    middle = hand.relaxed(at)[1]
    # B is for the relative change of the strained volume.
    around = [hand.relaxed(hand.expanded((1 + gamma) * (1 + e) - 1))[1] for e in (-h, h)]
    assert exactly(moduli.bulk)[0] / ((sum(around) - 2 * middle) / (h * h * V)) - 1 == pytest.approx(0, abs=1e-17)
    around = [hand.relaxed(hand.sheared(e) @ at)[1] for e in (-h, h)]
    assert exactly(moduli.shear)[0] / ((sum(around) - 2 * middle) / (h * h * V)) - 1 == pytest.approx(0, abs=1e-15)


def test_references_at_the_transition_are_derivatives_of_the_energy(by_hand):
    hand, manifold, critical = by_hand
    # E(γ) past the transition is a polynomial Σ e_n γⁿ/n! from n = 2; six strains leave γ⁶ of it.
    h, n = Decimal("1e-6"), 6
    energies = np.array([hand.relaxed(hand.expanded(h * j))[1] for j in range(1, n + 1)])
    powers = np.array([[(h * j) ** m for m in range(2, n + 2)] for j in range(1, n + 1)])
    coefficients = solved(powers.T @ powers, (powers.T @ energies).reshape(-1, 1)).ravel()
    second, third = 2 * coefficients[0], 6 * coefficients[1]
    B_0 = extended_transition_moduli(critical).bulk
    assert exactly(B_0)[0] / (second / hand.volume) - 1 == pytest.approx(0, abs=1e-24)
    C_B, C_G = extended_slopes(critical, manifold)
    assert exactly(C_B)[0] / ((second + third) / hand.volume) - 1 == pytest.approx(0, abs=1e-18)
    # The exact formula in working precision agrees, and other strains give the same.
    exact = stiffening(manifold.network, critical).value
    assert (C_B.high[0], C_G.high[0]) == pytest.approx((exact.C_B, exact.C_G), rel=1e-12)
    for other, first in zip(extended_slopes(critical, manifold, 2e-3, 10), (C_B, C_G), strict=True):
        assert exactly(other)[0] / exactly(first)[0] - 1 == pytest.approx(0, abs=1e-18)


@pytest.fixture(scope="module")
def contestants():
    return {word: {c.name: c for c in task.contestants(40, 1)} for word, task in TASKS.items()}


def test_every_contestant_is_announced(contestants):
    for word, task in TASKS.items():
        # Small boxes have edges longer than half of them, which LAMMPS cannot take.
        assert set(contestants[word]) <= set(task.names)
        assert task.default in contestants[word]
        ours = [c for c in contestants[word].values() if c.package == "critflow"]
        assert {c.name for c in ours} == {name for name in task.names if not name.startswith(("LAMMPS", "ASE", "mats"))}


# Levels until rounding takes over, and the error that the last of them must reach.
EXPECTED = {
    ("strain_step", "Newton"): (6, 1e-12),
    ("strain_step", "FIRE"): (6, 1e-8),
    ("strain_step", "L-BFGS"): (3, 1e-4),
    ("moduli", "linear response"): (1, 1e-12),
    ("moduli", "differences of stress"): (4, 1e-6),
    ("moduli", "differences of energy"): (4, 1e-6),
    ("transition_moduli", "closed form"): (1, 1e-14),
    ("transition_moduli", "linear response at γ → 0"): (5, 1e-5),
    ("transition_moduli", "energy at γ → 0"): (5, 1e-6),
    ("transition_moduli", "self-stress at rest"): (1, 1e-13),
    ("coefficients", "exact"): (1, 1e-12),
    ("coefficients", "Richardson"): (3, 1e-8),
    ("coefficients", "line through 4"): (4, 1e-3),
    ("coefficients", "line through 16"): (4, 1e-3),
    ("coefficients", "parabola through 4"): (4, 1e-6),
    ("coefficients", "parabola through 16"): (4, 1e-6),
}


@pytest.mark.parametrize("word, name", EXPECTED)
def test_errors_fall_with_the_levels(contestants, word, name):
    contestant = contestants[word][name]
    n_levels, reached = EXPECTED[word, name]
    verdicts = [contestant.judge(contestant.run(level)) for level in contestant.levels[:n_levels]]
    # A rough answer may say that it knows no bound on its error.
    assert {v.status for v in verdicts} <= {Status.ok, Status.ill_conditioned}
    assert verdicts[-1].status is Status.ok
    errors = np.array([v.error for v in verdicts])
    assert errors[-1] < reached
    # A step of Newton's method may serve several tolerances, and one to the exact equilibrium all of them.
    assert (errors[1:] <= np.maximum(1.01 * errors[:-1], 1e-15)).all()
    assert n_levels == 1 or errors[-1] < max(3e-2 * errors[0], 1e-15)
    # Whoever claims a bound keeps it.
    assert not any(v.bound < v.error for v in verdicts)


@pytest.mark.parametrize("degree", [1, 2])
def test_the_bias_of_a_fit_falls_as_its_degree_says(contestants, degree):
    contestant = contestants["coefficients"][f"{('line', 'parabola')[degree - 1]} through 16"]
    errors = [contestant.judge(contestant.run(window)).error for window in (1e-3, 1e-4)]
    assert np.log10(errors[0] / errors[1]) == pytest.approx(degree, abs=0.1)


def test_answers_off_by_a_known_amount_have_that_error():
    step = StrainStep.of(40, 1)
    off = step.start.coordinates.copy()
    off[step.start.network.free] = step.reference.high
    # A drift and a wrap are no errors, an odd displacement is.
    side = step.start.network.cell[0, 0]
    wrapped = np.mod(off + np.array([0.3, -0.2]), side)
    assert step.judge_peer((wrapped, Status.ok, 1)).error < 1e-14
    wrapped[[3, 5], 0] += np.array([1e-5, -1e-5]) * step.unit
    assert step.judge_peer((wrapped, Status.ok, 1)).error == pytest.approx(1e-5, rel=1e-9)
    springs = StressedSprings.of(40, 1)
    exact = modulus_tasks.Measured(springs.reference.bulk.high[0], springs.reference.shear.high[0])
    assert springs.judge(exact).error < 1.2e-16
    wrong = modulus_tasks.Measured(exact.bulk, exact.shear * (1 + 1e-6))
    assert springs.judge(wrong).error == pytest.approx(1e-6, rel=1e-9)


# Peers


@pytest.mark.parametrize(
    "module, name, n_levels, reached",
    [
        ("lammps", "LAMMPS cg", 3, 1e-3),
        ("lammps", "LAMMPS cg forcezero", 5, 1e-8),
        ("lammps", "LAMMPS hftn", 3, 1e-3),
        ("lammps", "LAMMPS fire", 4, 1e-4),
        ("ase", "ASE LBFGS", 4, 1e-5),
        ("ase", "ASE BFGS", 2, 1e-2),
        ("ase", "ASE FIRE", 2, 1e-2),
    ],
)
def test_peers_take_the_same_step(module, name, n_levels, reached):
    pytest.importorskip(module)
    (task,) = strain_tasks.TASKS
    found = {c.name: c for c in task.contestants(60, 1)}
    verdicts = [found[name].judge(found[name].run(level)) for level in found[name].levels[:n_levels]]
    assert all(v.status is Status.ok for v in verdicts)
    assert verdicts[-1].error < reached
    # A second run starts where the first one did.
    again = found[name].judge(found[name].run(found[name].levels[0]))
    assert again.iterations == verdicts[0].iterations
    assert again.error == pytest.approx(verdicts[0].error, rel=1e-6)


@pytest.mark.parametrize("name, n_levels, reached", [("matscipy", 6, 1e-9), ("matscipy LU", 1, 1e-9)])
def test_matscipy_has_the_same_moduli(contestants, name, n_levels, reached):
    pytest.importorskip("matscipy")
    contestant = contestants["moduli"][name]
    errors = [contestant.judge(contestant.run(level)).error for level in contestant.levels[:n_levels]]
    assert errors[-1] < reached
    assert n_levels == 1 or errors[-1] < 1e-4 * errors[0]
