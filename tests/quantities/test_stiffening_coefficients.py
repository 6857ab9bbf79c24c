"""Gradients of stiffening coefficients against differences of relaxed energies in sixty digits."""

import numpy as np
import pytest
from problems import random_stress, with_random_stiffness

from critflow import CriticalManifold, optimize, voronoi_network
from critflow.critical.derivatives import evaluate
from critflow.critical.transition import pure_shear
from critflow.networks.deformation import deformation_of
from critflow.quantities.stiffening import Stiffening
from workflows.benchmarks.high_precision import MP, dot, numbers, roots, solve


class Strained:
    """Energies in 60 digits of a periodic network at rest at the configuration of σ, strained by γ and then by s."""

    def __init__(self, network, sigma, k):
        self.k, self.b, self.volume = k, numbers(network.boundary_vectors), numbers(network.volume)
        self.g = numbers(network.incidence.toarray()[:, 1:])
        sg = sigma[:, None] * self.g
        self.L = self.b + self.g @ solve(self.g.T @ sg, -(sg.T @ self.b))
        self.rest = roots(dot(self.L, self.L))

    def energy(self, F, shift):
        """E after two Newton steps from an estimate of the bond displacements."""
        g, k = self.g, self.k
        bonds = self.L @ F.T + g @ shift
        for _ in range(2):
            length = roots(dot(bonds, bonds))
            tension = k * (length - self.rest)
            n = bonds / length[:, None]
            blocks = k[:, None, None] * n[:, :, None] * n[:, None, :]
            across = numbers(np.eye(2)) - n[:, :, None] * n[:, None, :]
            blocks = blocks + (tension / length)[:, None, None] * across
            # (free vertices, d, free vertices, d)
            K = sum(np.multiply.outer(np.multiply.outer(a, a), block) for a, block in zip(g, blocks, strict=True))
            K = K.transpose(0, 2, 1, 3).reshape(2 * g.shape[1], -1)
            force = (g.T @ (tension[:, None] * n)).reshape(-1, 1)
            bonds = bonds - g @ solve(K, force).reshape(-1, 2)
        length = roots(dot(bonds, bonds))
        return (k * (length - self.rest) ** 2).sum() / 2

    def along(self, A, response):
        """C of E(γ), F = 1 + γA, from γ = h and 2h: errors of order h."""
        h = MP.mpf(10) ** -13
        energies = [self.energy(numbers(np.eye(2)) + n * h * A, n * h * response) for n in (1, 2)]
        modulus = 2 * np.array(energies) / (self.volume * np.array([h, 2 * h]) ** 2)
        growth = 3 * (modulus[1] - modulus[0]) / h
        return growth - np.trace(A) * (2 * modulus[0] - modulus[1])

    def coefficients(self, responses):
        """C_B and C_G of E(γ, s), F = √(1 + γ) (1 + s A), from γ = h and 2h: errors of order h."""
        h, A = MP.mpf(10) ** -13, numbers(pure_shear(2))
        s, E = h / 1000, np.empty((2, 3), dtype=object)
        for i in range(2):
            for j in range(3):
                gamma, shear = (i + 1) * h, (j - 1) * s
                F = MP.sqrt(1 + gamma) * (numbers(np.eye(2)) + shear * A)
                E[i, j] = self.energy(F, gamma * responses[0] + shear * responses[1])
        modulus = 2 * E[:, 1] / (self.volume * np.array([h, 2 * h]) ** 2)
        growth = 3 * (modulus[1] - modulus[0]) / h
        # Per volume at γ.
        shear_modulus = (E[:, 0] - 2 * E[:, 1] + E[:, 2]) / (s**2 * self.volume * np.array([1 + h, 1 + 2 * h]))
        return growth + 2 * modulus[0] - modulus[1], (shear_modulus[1] - shear_modulus[0]) / h


@pytest.mark.parametrize("variable", ["stress", "stiffness"])
def test_gradients_agree_with_differences_in_sixty_digits(variable):
    network = with_random_stiffness(voronoi_network(n_vertices=8, seed=1), seed=2)
    manifold, sigma = CriticalManifold(network), random_stress(network.n_edges, seed=5)
    direction, t = np.random.default_rng(7).normal(size=network.n_edges), MP.mpf(1e-8)
    path = deformation_of([[0.8, 0.3], [0.1, -0.2]], 2)
    balance = manifold.balance(sigma)
    responses, along = (
        [numbers(response.displacement) for response in Stiffening(of)._energy(balance)[0].responses]
        for of in (None, path)
    )
    with MP.workdps(60):
        values = []
        for sign in (1, -1):
            moved = sign * t * numbers(direction)
            stress, k = numbers(sigma), numbers(network.stiffness)
            of_stress = variable == "stress"
            strained = Strained(network, stress + moved if of_stress else stress, k if of_stress else k + moved)
            C = strained.along(numbers(path.rate(0.0)), along[0])
            values.append([*strained.coefficients(responses), C])
        exact = [float((one - other) / (2 * t)) for one, other in zip(*values, strict=True)]
    for n, objective in enumerate((Stiffening(), Stiffening(of_shear=True), Stiffening(path))):
        found = evaluate(manifold, objective, sigma)
        assert found.value == pytest.approx(float(values[0][n]), rel=1e-6)
        gradient = found.gradient if variable == "stress" else objective.by_stiffness(balance)
        assert gradient @ direction == pytest.approx(exact[n], rel=1e-11)


def test_softening_can_be_optimised():
    manifold = CriticalManifold(voronoi_network(n_vertices=20, seed=2))
    least = optimize(manifold, "C_B", "lbfgs", throw=False, max_steps=150, tolerance=1e-6)
    stiffest = optimize(manifold, "B_0")
    # No network was found to soften more than the stiffest one, C_B = −B_0/2.
    assert -0.5 * stiffest.objective - 1e-6 < least.objective < -0.45 * stiffest.objective
